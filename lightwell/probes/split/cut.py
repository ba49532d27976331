"""Cuts the cells of a lattice by walls: at most one plane for each cell, found from segments that walls block.

A cell is cut where most of the blocked segments inside it cross one plane and few of the free ones do. Notation: C
cells of the lattice, K points and E edges of a cell's pattern, R cut cells, f a position in a cell in [0, 1]³.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from lightwell.probes import rays
from lightwell.probes.lattice import CORNERS
from lightwell.probes.support import Support
from lightwell.scenes.scene import Scene

# Planes through three places that are tried for each cell, beside the one of least squares.
TRIED = 48
# A plane cuts a cell if this part of the cell's places of walls lies close to it, and of the segments that cross it in
# the cell at least this part is blocked. A cell with fewer places has no wall that can be located.
SEPARATED, BLOCKED, LEAST = 0.5, 0.2, 4
# Cells through which a plane continues where they hold too few segments to find it. One cell more, beyond the end of a
# wall, gives 0.9 dB at a doorway, and steps of a third of the light to what moves through it.
CONTINUED = 2
# Places within this distance of a plane, in units of the spacing, belong to its wall.
CLOSE = 0.05


@dataclass(frozen=True)
class Cuts:
    """Planes of cut cells; side 1 of a cell is where the plane is positive."""

    row: np.ndarray
    """[C] int32 row of a cut cell; -1 for others."""
    plane: np.ndarray
    """[R, 4] unit normal and constant: n · f + d, in units of the cell."""

    @property
    def main(self) -> np.ndarray:
        """[C] axis that each plane's normal is nearest to; -1 in cells without a plane."""
        if not len(self.plane):
            return np.full(len(self.row), -1)
        return np.where(self.row >= 0, np.abs(self.plane[self.row, :3]).argmax(axis=1), -1)

    def side(self, cell: np.ndarray, f: np.ndarray) -> np.ndarray:
        """Find the side of the cell's plane on which points lie.

        Args:
            cell: [N] indices of cells.
            f: [N, 3] positions in the cells, in [0, 1].

        Returns:
            [N] int64, 0 or 1; 0 in cells without a plane.
        """
        row = self.row[cell]
        plane = self.plane[np.maximum(row, 0)] if len(self.plane) else np.zeros((len(row), 4))
        return ((f * plane[:, :3]).sum(axis=1) + plane[:, 3] > 0).astype(np.int64) * (row >= 0)


def find_cuts(scene: Scene, support: Support) -> Cuts:
    """Find the planes of all cells.

    Args:
        scene: The scene.
        support: Points in air and free segments; all cells are covered.

    Returns:
        The planes.
    """
    segments = _Segments(support)
    cell, place = _walls(scene, support)
    planes = np.zeros((support.lattice.cell_count, 4))
    order = np.argsort(cell, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(cell[order])) + 1):
        if len(rows) >= LEAST:
            planes[cell[rows[0]]] = _plane(place[rows], segments, int(cell[rows[0]]))
    for _ in range(CONTINUED):
        planes = _continued(support, segments, planes)
    row = np.where(planes.any(axis=1), np.cumsum(planes.any(axis=1)) - 1, -1).astype(np.int32)
    return Cuts(row, planes[row >= 0])


class _Segments:
    """Segments with an end in a cell, in its coordinates, both of whose ends lie in air."""

    def __init__(self, support: Support) -> None:
        layout = self._layout = support.pattern
        self._support = support
        self._across = np.flatnonzero((layout.step != 0).any(axis=1))
        start, end = layout.points[layout.start], layout.points[layout.end] + layout.step
        # Those that start in a cell, then those from other cells that end in it.
        back = layout.step[self._across]
        self.start = np.concatenate([start, start[self._across] - back])
        self.end = np.concatenate([end, end[self._across] - back])

    def of(self, cell: int) -> tuple[np.ndarray, np.ndarray]:
        """[E] bool: segments of a cell whose ends do not see each other, and those whose ends do."""
        support, layout, across = self._support, self._layout, self._across
        corner = support.lattice.cell_corner(np.array(cell))
        there, before = (support.lattice.cell_number(corner + step) for step in (layout.step, -layout.step[across]))
        known = support.valid[cell, layout.start] & support.valid[there, layout.end] & (there >= 0)
        from_ = support.valid[before, layout.start[across]] & support.valid[cell, layout.end[across]] & (before >= 0)
        free = np.concatenate([support.free[cell], support.free[before, across] & (before >= 0)])
        return np.concatenate([known, from_]) & ~free, free

    def crossing(self, plane: np.ndarray, blocked: np.ndarray, free: np.ndarray) -> tuple[int, int]:
        """Count the blocked and the free segments that cross a plane [4] inside the cell."""
        a, b = self.start @ plane[:3] + plane[3], self.end @ plane[:3] + plane[3]
        t = np.clip(a / np.where(a == b, 1, a - b), 0, 1)[:, None]
        at = self.start + t * (self.end - self.start)
        cross = ((a > 0) != (b > 0)) & (np.abs(at - 0.5) <= 0.5).all(axis=1)
        return int((cross & blocked).sum()), int((cross & free).sum())


def _agrees(cut: int, lost: int) -> bool:
    """Whether a plane that separates ``cut`` blocked and ``lost`` free segments is a wall."""
    return cut >= BLOCKED * (cut + lost)


def _continued(support: Support, segments: _Segments, planes: np.ndarray) -> np.ndarray:
    """Planes [C, 4] with those of neighbours where nothing contradicts them: a wall crosses a cell of which its points
    see little, such as one with little air."""
    lattice, cells, out = support.lattice, np.arange(support.lattice.cell_count), planes.copy()
    for axis, sign in product(range(3), (1, -1)):
        step = sign * np.eye(3, dtype=np.int64)[axis]
        other = lattice.cell_number(lattice.cell_corner(cells) + step)
        moved = planes[np.maximum(other, 0)]
        moved = moved - np.append(np.zeros(3), 1.0) * (moved[:, :3] @ step)[:, None]
        for k in np.flatnonzero(~out.any(axis=1) & (other >= 0) & moved[:, :3].any(axis=1)):
            side = CORNERS @ moved[k, :3] + moved[k, 3] > 0
            inside = side.any() and not side.all()
            if inside and _agrees(*segments.crossing(moved[k], *segments.of(int(k)))):
                out[k] = moved[k]
    return out


def _walls(scene: Scene, support: Support) -> tuple[np.ndarray, np.ndarray]:
    """[M] cell and [M, 3] place in it: the middle of what blocks each segment."""
    layout, lattice, h = support.pattern, support.lattice, support.lattice.spacing
    cells = lattice.cell_corner(np.arange(lattice.cell_count))
    there = lattice.cell_number(cells[:, None] + layout.step)
    known = support.valid[:, layout.start] & support.valid[there, layout.end] & (there >= 0)
    row, edge = np.nonzero(known & ~support.free)
    a = lattice.origin + h * (cells[row] + layout.points[layout.start[edge]])
    b = lattice.origin + h * (cells[row] + layout.points[layout.end[edge]] + layout.step[edge])
    length = np.linalg.norm(b - a, axis=1, keepdims=True)
    d = (b - a) / length
    (hit, t), (back, u) = rays.ends(scene, a, d, h * 2), rays.ends(scene, b, -d, h * 2)
    middle = (a + 0.5 * (t[:, None] + length - u[:, None]) * d)[hit & back]
    at, f = lattice.locate(middle)
    return lattice.cell_number(at), f


def _plane(place: np.ndarray, segments: _Segments, cell: int) -> np.ndarray:
    """The plane [4] through some of the places [M, 3] that separates the blocked segments best; 0 where none does."""
    best, found = -np.inf, np.zeros(4)
    blocked, free = segments.of(cell)
    for plane in _tried(place, cell):
        near = np.abs(place @ plane[:3] + plane[3]) < CLOSE
        if near.sum() < SEPARATED * len(place):
            continue
        for one in (plane, _least_squares(place[near])):
            cut, lost = segments.crossing(one, blocked, free)
            if cut - lost > best:
                best, found = cut - lost, one * _agrees(cut, lost)
    # The largest component is positive: neighbours of one wall have the same side 1.
    return found * np.sign(found[np.abs(found[:3]).argmax()])


def _tried(place: np.ndarray, seed: int) -> list[np.ndarray]:
    """Planes [4] through three of the places, and the one of least squares."""
    a, b, c = np.swapaxes(place[np.random.default_rng(seed).integers(len(place), size=(TRIED, 3))], 0, 1)
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    good = size > 1e-6
    normal = normal[good] / size[good, None]
    return [*np.column_stack([normal, -(normal * a[good]).sum(axis=1)]), _least_squares(place)]


def _least_squares(place: np.ndarray) -> np.ndarray:
    mean = place.mean(axis=0)
    normal = np.linalg.svd(place - mean, full_matrices=False)[2][-1]
    return np.append(normal, -normal @ mean)
