"""Pack charts by their bounding boxes in rows: seconds for a hundred thousand charts, where xatlas takes minutes.

The rows are filled with boxes of decreasing height (next-fit decreasing height; Coffman et al. 1980). Charts that are
not rectangles waste the rest of their box, so that xatlas fills the square better where it has the time.

Notation: see ``atlas_charts``; N charts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightwell.scenes.packer import Packing
from lightwell.scenes.welding import components

# Halvings of the interval that holds the largest scale.
HALVINGS = 16
# Points [V, 2], triangles [K, 3] and number of charts of a piece.
Laid = tuple[np.ndarray, np.ndarray, int]


def shelved(laid: Sequence[Laid], size: int, pad: int) -> tuple[float, Packing] | None:
    """Search the largest scale at which the boxes of charts fit a square.

    Args:
        laid: Points, triangles and number of charts of every piece.
        size: Texels along each edge.
        pad: Texels of padding around each chart.

    Returns:
        Scale and packing, as those of ``atlas_charts.fitted``; None where none fits.
    """
    chart, low, edges = _boxes(laid)
    wide = edges[:, 0] < edges[:, 1]
    # Boxes lie on their longer edge.
    lying = np.where(wide[:, None], edges[:, ::-1], edges)
    best, least, most = None, 0.0, size / np.sqrt(max(float(edges.prod(axis=1).sum()), 1e-30))
    room = size - pad - 1
    for _ in range(HALVINGS):
        scale = (least + most) / 2
        place = _rows(lying * scale + pad, room)
        if place is None:
            most = scale
        else:
            best, least = (scale, place), scale
    if best is None:
        return None
    scale, place = best
    meshes = []
    for (points, corners, _), rows in zip(laid, chart):
        used = rows >= 0
        local = points.astype(np.float64) - low[rows]
        local = np.where(wide[rows][:, None], local[:, ::-1], local) * scale + place[rows]
        meshes.append((np.where(used[:, None], local, 0).astype(np.float32), corners))
    return scale, Packing(room, room, 1, len(edges), tuple(meshes))


def _boxes(laid: Sequence[Laid]) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """The chart of every point (-1: of none), and low corners and edges [N, 2] of the boxes of charts."""
    numbers, low, high, count = [], [], [], 0
    for points, corners, _ in laid:
        chart = np.full(len(points), -1, np.int64)
        chart[corners] = components(corners.astype(np.int64), len(points))[:, None]
        used = np.flatnonzero(chart >= 0)
        order = used[np.argsort(chart[used], kind="stable")]
        start = np.flatnonzero(np.diff(chart[order], prepend=-1))
        low.append(np.minimum.reduceat(points[order].astype(np.float64), start))
        high.append(np.maximum.reduceat(points[order].astype(np.float64), start))
        numbers.append(np.where(chart >= 0, chart + count, -1))
        count += len(start)
    lowest = np.concatenate(low)
    return numbers, lowest, np.concatenate(high) - lowest


def _rows(edges: np.ndarray, room: float) -> np.ndarray | None:
    """Place boxes [N, 2] in rows of a square; returns their low corners, None where they do not fit."""
    order = np.argsort(-edges[:, 1], kind="stable")
    right = np.cumsum(edges[order, 0])
    place, first, y = np.zeros((len(edges), 2)), 0, 0.0
    while first < len(order):
        before = right[first - 1] if first else 0.0
        end = int(np.searchsorted(right, before + room, side="right"))
        height = edges[order[first], 1]
        if end == first or y + height > room:
            return None
        rows = order[first:end]
        place[rows, 0] = right[first:end] - edges[rows, 0] - before
        place[rows, 1] = y
        first, y = end, y + height
    return place
