"""Values of the published recipe: the integral of the Laplacian over each point's Voronoi cell.

The Laplacian is constant within a pixel, so that the integral is a sum over pixels of charge × the area of the cell
within the pixel. A pixel that only one point can reach belongs to it as a whole; the others are clipped exactly.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

# Half the diagonal of a pixel; most points that may share a pixel.
HALF_DIAGONAL, MOST_SHARING = np.sqrt(0.5), 24


def _clip(polygon: list[tuple[float, float]], nx: float, ny: float, d: float) -> list[tuple[float, float]]:
    """Clip a convex polygon to n·p ≤ d (Sutherland and Hodgman)."""
    out = []
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1]):
        a, b = nx * ax + ny * ay - d, nx * bx + ny * by - d
        if a <= 0:
            out.append((ax, ay))
        if (a < 0 < b) or (b < 0 < a):
            t = a / (a - b)
            out.append((ax + t * (bx - ax), ay + t * (by - ay)))
    return out


def _area(polygon: list[tuple[float, float]]) -> float:
    return 0.5 * abs(sum(ax * by - bx * ay for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1])))


def shares(points: np.ndarray, x: float, y: float, near: np.ndarray) -> np.ndarray:
    """Compute the share of a pixel that is nearest to each of some points.

    Args:
        points: Offsets (x, y) of all points [n, 2].
        x: Centre x of the pixel.
        y: Centre y of the pixel.
        near: Indices of the points to consider [k].

    Returns:
        Shares of the area [k], sum 1.
    """
    square = [(x - 0.5, y - 0.5), (x + 0.5, y - 0.5), (x + 0.5, y + 0.5), (x - 0.5, y + 0.5)]
    areas = np.zeros(len(near))
    for i, a in enumerate(near):
        cell = square
        for b in near:
            if b != a and cell:
                nx, ny = points[b] - points[a]
                middle = 0.5 * (points[a] + points[b])
                cell = _clip(cell, nx, ny, nx * middle[0] + ny * middle[1])
        areas[i] = _area(cell) if len(cell) > 2 else 0.0
    return areas / areas.sum()


def integrate_cells(charges: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Integrate charges over the Voronoi cell of every point, exactly.

    Args:
        charges: Charges of a kernel [odd, odd].
        points: Offsets (x, y) of the points [n, 2].

    Returns:
        Values [n] whose sum is Σ f, which is 0 for the charges of a kernel.
    """
    rows, columns = np.nonzero(charges)
    x, y = columns - charges.shape[1] // 2, rows - charges.shape[0] // 2
    f = charges[rows, columns]
    tree = cKDTree(points)
    count = min(MOST_SHARING, len(points))
    distance, near = tree.query(np.stack([x, y], 1).astype(float), k=count)
    if count == 1:
        return np.array([f.sum()])
    # A point may own a part of the pixel only if it is within a diagonal of the nearest one.
    sharing = distance <= distance[:, :1] + 2 * HALF_DIAGONAL
    whole = sharing.sum(1) == 1
    values = np.bincount(near[whole, 0], f[whole], len(points))
    for i in np.nonzero(~whole)[0]:
        mine = near[i][sharing[i]]
        np.add.at(values, mine, f[i] * shares(points, float(x[i]), float(y[i]), mine))
    return values


def integrate_labels(charges: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Integrate charges over cells of whole pixels: every pixel belongs to its nearest point.

    Args:
        charges: Charges of a kernel [odd, odd].
        points: Offsets (x, y) of the points [n, 2].

    Returns:
        Values [n].
    """
    rows, columns = np.nonzero(charges)
    at = np.stack([columns - charges.shape[1] // 2, rows - charges.shape[0] // 2], 1).astype(float)
    return np.bincount(cKDTree(points).query(at)[1], charges[rows, columns], len(points))
