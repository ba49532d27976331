"""Cuts the cells of a lattice by walls: at most one plane for each cell, found from segments that walls block.

A cell is cut where most of the blocked segments inside it cross one plane and few of the free ones do. Notation: C
cells of the lattice, K points and E edges of a cell's pattern, R cut cells, f a position in a cell in [0, 1]³.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from lightwell.probes import rays
from lightwell.probes.lattice import CORNERS, _grid
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
# Segments of a cell that are counted, about: every second or third one where there are more.
COUNTED = 1024


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
    segments, planes = _Segments(support), planes_of(scene, support, support.covered)
    for _ in range(CONTINUED):
        planes = _continued(support, segments, planes)
    row = np.where(planes.any(axis=1), np.cumsum(planes.any(axis=1)) - 1, -1).astype(np.int32)
    return Cuts(row, planes[row >= 0])


def planes_of(scene: Scene, support: Support, cells: np.ndarray) -> np.ndarray:
    """Find the planes of some cells, each by its own segments.

    Args:
        scene: The scene.
        support: Points in air and free segments.
        cells: Indices of covered cells.

    Returns:
        [C, 4] unit normal and constant, n · f + d, in units of the cell; 0: no plane.
    """
    segments = _Segments(support)
    cell, place = _walls(scene, support, cells)
    planes = np.zeros((support.lattice.cell_count, 4))
    order = np.argsort(cell, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(cell[order])) + 1):
        if len(rows) >= LEAST:
            planes[cell[rows[0]]] = _plane(place[rows], segments, int(cell[rows[0]]))
    return planes


class _Segments:
    """Segments with an end in a cell, in its coordinates, both of whose ends lie in air."""

    def __init__(self, support: Support) -> None:
        layout = support.pattern
        self._support = support
        self._counted = np.arange(0, len(layout.start), max(1, len(layout.start) // COUNTED))
        step = layout.step[self._counted]
        self._across = self._counted[(step != 0).any(axis=1)]
        points, own, other = layout.points, self._counted, self._across
        start, end = points[layout.start[own]], points[layout.end[own]] + step
        # Those that start in a cell, then those from other cells that end in it.
        self.start = np.concatenate([start, points[layout.start[other]] - layout.step[other]])
        self.end = np.concatenate([end, points[layout.end[other]]])

    def of(self, cell: int) -> tuple[np.ndarray, np.ndarray]:
        """[E] bool: segments of a cell whose ends do not see each other, and those whose ends do."""
        support, layout, own, other = self._support, self._support.pattern, self._counted, self._across
        here, corner = support.slot[cell], support.lattice.cell_corner(np.array(cell))
        there, before = _rows(support, corner + layout.step[own]), _rows(support, corner - layout.step[other])
        known = support.valid[here, layout.start[own]] & support.valid[there, layout.end[own]] & (there >= 0)
        from_ = support.valid[before, layout.start[other]] & support.valid[here, layout.end[other]] & (before >= 0)
        free = np.concatenate([support.free[here, own], support.free[before, other] & (before >= 0)])
        return np.concatenate([known, from_]) & ~free, free

    def crossing(self, planes: np.ndarray, blocked: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """[T] numbers of blocked and of free segments that cross each plane [T, 4] inside the cell."""
        known = np.flatnonzero(blocked | free)
        start, end = self.start[known], self.end[known]
        a, b = (side @ planes[:, :3].T + planes[:, 3] for side in (start, end))
        segment, plane = np.nonzero((a > 0) != (b > 0))
        a, b = a[segment, plane], b[segment, plane]
        at = start[segment] + (a / (a - b))[:, None] * (end[segment] - start[segment])
        inside = (np.abs(at - 0.5) <= 0.5).all(axis=1)
        segment, plane = segment[inside], plane[inside]
        cut = blocked[known[segment]]
        return tuple(np.bincount(plane[part], minlength=len(planes)) for part in (cut, ~cut))


def _rows(support: Support, at: np.ndarray) -> np.ndarray:
    """[...] rows of cells at integer coordinates [..., 3]; -1: outside, or not covered."""
    cell = support.lattice.cell_number(at)
    return np.where(cell >= 0, support.slot[np.maximum(cell, 0)], -1)


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
            if inside and _agrees(*(int(v[0]) for v in segments.crossing(moved[k : k + 1], *segments.of(int(k))))):
                out[k] = moved[k]
    return out


def _walls(scene: Scene, support: Support, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[M] cell and [M, 3] place in it: the middle of what blocks each segment, in some cells."""
    layout, lattice, h = support.pattern, support.lattice, support.lattice.spacing
    asked = np.zeros(lattice.cell_count, bool)
    asked[cells] = True
    # Segments begin in a cell or in one of its neighbours.
    near = lattice.cell_number(lattice.cell_corner(cells)[:, None] + _grid((3, 3, 3)) - 1)
    from_ = np.intersect1d(near, support.covered)
    corner, here = lattice.cell_corner(from_), support.slot[from_]
    there = _rows(support, corner[:, None] + layout.step)
    known = support.valid[here][:, layout.start] & support.valid[there, layout.end] & (there >= 0)
    row, edge = np.nonzero(known & ~support.free[here])
    a = lattice.origin + h * (corner[row] + layout.points[layout.start[edge]])
    b = lattice.origin + h * (corner[row] + layout.points[layout.end[edge]] + layout.step[edge])
    length = np.linalg.norm(b - a, axis=1, keepdims=True)
    d = (b - a) / length
    (hit, t), (back, u) = rays.ends(scene, a, d, h * 2), rays.ends(scene, b, -d, h * 2)
    middle = (a + 0.5 * (t[:, None] + length - u[:, None]) * d)[hit & back]
    at, f = lattice.locate(middle)
    cell = lattice.cell_number(at)
    mine = asked[cell]
    return cell[mine], f[mine]


def _plane(place: np.ndarray, segments: _Segments, cell: int) -> np.ndarray:
    """The plane [4] through some of the places [M, 3] that separates the blocked segments best; 0 where none does."""
    tried = _tried(place, cell)
    near = np.abs(place @ tried[:, :3].T + tried[:, 3]) < CLOSE
    good = np.flatnonzero(near.sum(axis=0) >= SEPARATED * len(place))
    if not len(good):
        return np.zeros(4)
    planes = np.concatenate([[tried[k], _least_squares(place[near[:, k]])] for k in good])
    cut, lost = segments.crossing(planes, *segments.of(cell))
    best = int((cut - lost).argmax())
    found = planes[best] * _agrees(int(cut[best]), int(lost[best]))
    # The largest component is positive: neighbours of one wall have the same side 1.
    return found * np.sign(found[np.abs(found[:3]).argmax()])


def _tried(place: np.ndarray, seed: int) -> np.ndarray:
    """[T, 4] planes through three of the places, and the one of least squares."""
    a, b, c = np.swapaxes(place[np.random.default_rng(seed).integers(len(place), size=(TRIED, 3))], 0, 1)
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    good = size > 1e-6
    normal = normal[good] / size[good, None]
    return np.concatenate([np.column_stack([normal, -(normal * a[good]).sum(axis=1)]), [_least_squares(place)]])


def _least_squares(place: np.ndarray) -> np.ndarray:
    mean = place.mean(axis=0)
    normal = np.linalg.svd(place - mean, full_matrices=False)[2][-1]
    return np.append(normal, -normal @ mean)
