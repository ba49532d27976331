"""Which texels the triangles of an atlas cover, by their centres.

A centre on an edge that two triangles share belongs to one of them.
"""

from __future__ import annotations

import numpy as np

# Texels that are listed at a time.
LISTED = 1 << 22


def coverings(corners: np.ndarray, width: int, height: int) -> np.ndarray:
    """Count the triangles that cover each texel's centre.

    Args:
        corners: [K, 3, 2] triangles, in texels.
        width: Texels of a row.
        height: Rows.

    Returns:
        [height, width] counts.
    """
    _, y, left, right = _spans(corners, width, height)
    hits = np.zeros((height, width + 1), np.int32)
    for x, sign in ((left, 1), (right, -1)):
        np.add.at(hits, (y, x), sign)
    return hits.cumsum(axis=1)[:, :width]


def texel_hits(uv: np.ndarray, chart: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Count the triangles that cover each texel's centre, and name the chart of the last one.

    Args:
        uv: Corners of the triangles [T, 3, 2], in [0, 1].
        chart: Chart of each triangle [T].
        size: Texels along each edge.

    Returns:
        Counts [size, size], and the chart of the last triangle there [size, size], -1 where there is none.
    """
    corners = uv.astype(np.float64) * size
    triangle, y, left, right = _spans(corners, size, size)
    last = np.full(size * size, -1, np.int64)
    length = right - left
    ends = np.cumsum(length)
    parts = np.searchsorted(ends, np.arange(0, ends[-1] if len(ends) else 0, LISTED))
    for start, stop in zip(parts, [*parts[1:], len(ends)]):
        count = length[start:stop]
        row = np.repeat(np.arange(start, stop), count)
        x = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + left[row]
        np.maximum.at(last, y[row] * size + x, triangle[row])
    owner = np.where(last >= 0, np.asarray(chart)[last] if len(chart) else -1, -1).astype(np.int32)
    return coverings(corners, size, size), owner.reshape(size, size)


def _spans(corners: np.ndarray, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """List the parts of texel rows that triangles cover: triangle, row, first column and the column after the last."""
    corners = corners.astype(np.float64) - 0.5
    low = np.clip(np.ceil(corners[..., 1].min(axis=1)), 0, height).astype(np.int64)
    high = np.clip(np.ceil(corners[..., 1].max(axis=1)), 0, height).astype(np.int64)
    count = high - low
    row = np.repeat(np.arange(len(corners)), count)
    y = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + low[row]
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for k in range(3):
        # Always from the lower end, so that both triangles of an edge compute the same point.
        ends = corners[:, [k, (k + 1) % 3]]
        order = np.lexsort((ends[..., 0], ends[..., 1]), axis=1)
        p, q = (np.take_along_axis(ends, order[:, [j]][..., None], axis=1)[:, 0][row] for j in (0, 1))
        meets = (p[:, 1] <= y) & (q[:, 1] > y)
        x = p[:, 0] + (q[:, 0] - p[:, 0]) * ((y - p[:, 1]) / np.where(meets, q[:, 1] - p[:, 1], 1.0))
        left, right = np.where(meets, np.minimum(left, x), left), np.where(meets, np.maximum(right, x), right)
    some = np.isfinite(left)
    first, last = (np.clip(np.ceil(x[some]), 0, width).astype(np.int64) for x in (left, right))
    return row[some], y[some], first, last
