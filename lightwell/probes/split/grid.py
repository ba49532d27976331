"""A grid of features whose nodes are split where walls cut their cells; its query in NumPy is the definition.

    f(x) = Σ_c hat_c(x) T[node(cell, side, c)]

A cell that a wall cuts has a plane, and nodes of its own on each side of it. Copies of one lattice node are one node
where the air around it is connected, so that the grid is continuous in the air, ends at walls, and opens at the end of
a wall as a crack does in the extended finite element method (Moës, Dolbow and Belytschko 1999; Molino, Bao and Fedkiw
2004 call the copies virtual nodes). Notation: C cells, S sides of cells, P nodes, N points.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from lightwell.probes.lattice import CORNERS, ProbeLattice, hat
from lightwell.probes.pattern import pattern
from lightwell.probes.split.cut import Cuts, find_cuts
from lightwell.probes.support import Support, bake_support
from lightwell.scenes.scene import Scene

# Points of a cell.
POINTS = 128
# Two sides of neighbouring cells are connected if at least this part of the segments between them is free.
CONNECTED = 0.5
# Cells without a point in air continue a neighbour, as many times as a corner of a room has walls.
GROWN = 3


@dataclass(frozen=True)
class SplitGrid:
    """Cells, their planes, and the nodes of their sides."""

    lattice: ProbeLattice
    cuts: Cuts
    first: np.ndarray
    """[C] int32 row in ``nodes`` of side 0; side 1 follows. -1: no air."""
    nodes: np.ndarray
    """[S, 8] int32 nodes at the corners of a side, in the order of ``CORNERS``."""
    bends: np.ndarray
    """[M, 3] int32 neighbouring nodes in a line, across a face that two sides share."""
    openings: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    """[M, 4] cell, and place in it, where air crosses a plane beyond the end of its wall: light has no seam there."""

    @property
    def count(self) -> int:
        """P, the number of nodes."""
        return int(self.nodes.max(initial=-1)) + 1

    @property
    def irregular(self) -> tuple[int, int]:
        """Numbers of the cells with a corner that is not the first copy of its lattice node, and of their sides."""
        lattice, used = self.lattice, np.flatnonzero(self.first >= 0)
        own = np.full(len(lattice), self.count)
        at = lattice.node_number(lattice.cell_corner(used)[:, None] + CORNERS)
        cut = (self.cuts.row[used] >= 0).astype(np.int64)
        for side in (0, 1):
            np.minimum.at(own, at, self.nodes[self.first[used] + side * cut])
        odd = np.zeros(len(used), bool)
        for side in (0, 1):
            odd |= (self.nodes[self.first[used] + side * cut] != own[at]).any(axis=1)
        return int(odd.sum()), int((1 + cut[odd]).sum())

    def corners(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the nodes around some points.

        Args:
            x: [N, 3] points, metres.

        Returns:
            [N, 8] nodes, and [N, 8] weights with sum 1; 0 where there is no air.
        """
        at, f = self.lattice.locate(x)
        cell = self.lattice.cell_number(at)
        row = self.first[cell]
        weight = hat(f[:, None] - CORNERS) * (row >= 0)[:, None]
        return self.nodes[np.maximum(row, 0) + self.cuts.side(cell, f) * (row >= 0)], weight


def split_grid(scene: Scene, lattice: ProbeLattice) -> tuple[SplitGrid, Support]:
    """Cast the rays of a lattice, cut its cells, and split its nodes.

    Args:
        scene: The scene.
        lattice: The lattice.

    Returns:
        The grid, and the points in air and segments that it was made from.
    """
    support = bake_support(scene, lattice, pattern(POINTS), nodes=np.zeros(0, np.int64))
    return grid_of(support, find_cuts(scene, support)), support


def grid_of(support: Support, cuts: Cuts) -> SplitGrid:
    """Split the nodes of a lattice.

    Args:
        support: Points in air and free segments; all cells are covered.
        cuts: Planes of the cells.

    Returns:
        The grid.
    """
    lattice = support.lattice
    points = np.repeat(np.arange(lattice.cell_count), len(support.pattern.points))
    f = np.tile(support.pattern.points, (lattice.cell_count, 1))
    side = cuts.side(points, f).reshape(lattice.cell_count, -1)
    air = np.stack([(support.valid & (side == k)).any(axis=1) for k in (0, 1)], axis=1)
    joined = _joined(support, cuts, side)
    label = _labels(lattice, joined)
    # [C, 2] row of each side; sides without a point in air continue neighbours.
    rows = np.where(air, np.cumsum(air).reshape(air.shape) - 1, -1)
    rows, table = _continued(lattice, cuts, rows, label[air])
    grid = _numbered(lattice, cuts, rows, table, _bends(label, joined))
    return replace(grid, openings=_openings(support, cuts))


def _openings(support: Support, cuts: Cuts) -> np.ndarray:
    """[M, 4] cell and place where free segments inside cut cells cross the plane."""
    layout, cells = support.pattern, np.flatnonzero(cuts.row >= 0)
    inside = np.flatnonzero((layout.step == 0).all(axis=1))
    height = cuts.plane[:, :3] @ layout.points.T + cuts.plane[:, 3:]
    a, b = height[:, layout.start[inside]], height[:, layout.end[inside]]
    row, edge = np.nonzero(((a > 0) != (b > 0)) & support.free[cells][:, inside])
    start, end = layout.points[layout.start[inside][edge]], layout.points[layout.end[inside][edge]]
    t = (a[row, edge] / (a[row, edge] - b[row, edge]))[:, None]
    return np.column_stack([cells[row], start + t * (end - start)])


def _joined(support: Support, cuts: Cuts, side: np.ndarray) -> np.ndarray:
    """[J, 4] connected sides (2 · cell + side) across a quarter of a face: the lower and the higher side, the axis, and
    the corner of the lower cell. Each quarter decides for its own corner, so that a wall may end within a face."""
    lattice, layout, found = support.lattice, support.pattern, []
    cells, main = np.arange(lattice.cell_count), cuts.main
    for axis in range(3):
        step = np.eye(3, dtype=np.int64)[axis]
        other = lattice.cell_number(lattice.cell_corner(cells) + step)
        low, high = cells[other >= 0], other[other >= 0]
        edges = np.flatnonzero((layout.step == step).all(axis=1))
        start, end = layout.start[edges], layout.end[edges]
        known = support.valid[low][:, start] & support.valid[high][:, end]
        free = support.free[low][:, edges]
        pair = 2 * side[low][:, start] + side[high][:, end]
        # Along one wall only equal sides meet: what crosses its plane beyond its end goes through other cells.
        one_wall = (main[low] == main[high]) & (main[low] >= 0) & (main[low] != axis)
        corner = _crossed(layout.points[start], layout.points[end] + step, axis)
        names, quarter = np.unique(corner, return_inverse=True)
        quarters = np.eye(len(names), dtype=np.float32)[quarter]
        for k in range(4):
            seen = (pair == k) & ~(one_wall & (k in (1, 2)))[:, None]
            row, q = _open(seen & known, seen & free, quarters)
            sides = (2 * low[row] + k // 2, 2 * high[row] + k % 2)
            found.append(np.stack([*sides, 0 * row + axis, names[q]], axis=1))
    return np.concatenate(found)


def _open(known: np.ndarray, free: np.ndarray, quarters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and quarters of faces that are open, from segments [N, E] and the quarter [E, 4] that each crosses."""
    every, seen = known @ quarters, free @ quarters
    good = (seen > 0) & (seen >= CONNECTED * every)
    # A quarter without air follows the others: nodes behind a wall are shared like those in front of it.
    return np.nonzero(good | ((every == 0) & good.any(axis=1, keepdims=True)))


def _crossed(start: np.ndarray, end: np.ndarray, axis: int) -> np.ndarray:
    """[E] corner of the upper face of a cell that is nearest to where segments [E, 3] cross it."""
    t = ((1 - start[:, axis]) / (end[:, axis] - start[:, axis]))[:, None]
    at = np.clip(np.rint(start + t * (end - start)), 0, 1).astype(np.int64)
    return at @ np.array([1, 2, 4]) | 1 << axis


def _labels(lattice: ProbeLattice, joined: np.ndarray) -> np.ndarray:
    """[C, 2, 8] labels of the corners of all sides: the same corners of connected sides have one."""
    low, high, axis, corner = joined.T
    size = 16 * lattice.cell_count
    graph = coo_matrix((np.ones(len(low)), (8 * low + corner, 8 * high + corner - (1 << axis))), (size, size))
    return connected_components(graph, directed=False)[1].reshape(-1, 2, 8)


def _continued(lattice: ProbeLattice, cuts: Cuts, rows: np.ndarray, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``rows`` and ``table`` with sides that hold no point in air: they repeat the nodes of a neighbour's face, so that
    light is constant across what little air they have."""
    cut, cells = cuts.row >= 0, np.arange(lattice.cell_count)
    main, rows, parts = cuts.main, rows.copy(), [table]
    for _ in range(GROWN):
        before, known = rows.copy(), np.concatenate(parts)
        for axis, sign, side in product(range(3), (1, -1), (0, 1)):
            other = lattice.cell_number(lattice.cell_corner(cells) + sign * np.eye(3, dtype=np.int64)[axis])
            inside, other = other >= 0, np.maximum(other, 0)
            # Away from the plane any neighbour without a plane; along it the same side of a neighbour that it cuts.
            away = ~cut | ((main == axis) & (sign == (1 if side else -1)))
            along = cut & cut[other] & (main != axis)
            source = np.where(along, before[other, side], np.where(away & ~cut[other], before[other, 0], -1))
            mine = np.flatnonzero(inside & (rows[:, side] < 0) & (source >= 0) & (cut | (side == 0)))
            bit = 1 << axis
            face = np.arange(8) & ~bit | (bit if sign < 0 else 0)
            rows[mine, side] = sum(len(part) for part in parts) + np.arange(len(mine))
            parts.append(known[source[mine]][:, face])
    return rows, np.concatenate(parts)


def _numbered(lattice: ProbeLattice, cuts: Cuts, rows: np.ndarray, table: np.ndarray, lines: np.ndarray) -> SplitGrid:
    """The grid of labelled corners ``table``, of which each side of a cell has a row; labels become numbers."""
    cut, used = cuts.row >= 0, (rows >= 0).any(axis=1)
    # A side that continues nothing is the other one.
    rows = np.where(rows >= 0, rows, rows[:, ::-1])
    kept = np.stack([used, used & cut], axis=1)
    count = kept.sum(axis=1)
    first = np.where(used, np.cumsum(count) - count, -1).astype(np.int32)
    label = table[rows[kept]]
    names, nodes = np.unique(label, return_inverse=True)
    lines = np.searchsorted(names, lines[np.isin(lines, names).all(axis=1)])
    return SplitGrid(lattice, cuts, first, nodes.reshape(-1, 8).astype(np.int32), lines.astype(np.int32))


def _bends(label: np.ndarray, joined: np.ndarray) -> np.ndarray:
    """[M, 3] labels of three corners in a line across each face."""
    low, high, axis, corner = joined.T
    corners, bit = label.reshape(-1, 8), 1 << axis
    line = (corners[low, corner - bit], corners[low, corner], corners[high, corner])
    return np.unique(np.stack(line, axis=1), axis=0)
