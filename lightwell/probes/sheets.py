"""Sheets: walls thinner than a record can resolve, each a plane in a cell, and the corners that count on either side.

A ReLU field of 4³ vertices falls from 1 to 0 within a fiftieth of the spacing at best. Beside a wall without thickness
it trusts the wrong side, or none, for some centimetres. In a cell that such a wall crosses a plane separates both sides
exactly, and the record of a probe that counts on one side alone is free on the other. Notation: C cells of a lattice, T
planes, K points and X places at surfaces of a cell, B chosen nodes, N points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes.lattice import CORNERS, ProbeLattice
from lightwell.probes.split.cut import planes_of
from lightwell.probes.support import CLOSE, Support
from lightwell.scenes.scene import Scene

# A corner counts on a side where its mean trust is above this.
LEAST_TRUST = 0.02
# All eight corners on both sides: a plane that changes nothing.
ALL_CORNERS = 0xFFFF
# Cells that are processed together.
BATCH = 1024


@dataclass(frozen=True)
class Sheets:
    """Planes of the cells of a lattice."""

    row: np.ndarray
    """[C] int32 row of a cell's plane; -1: none."""
    plane: np.ndarray
    """[T, 4] float32 unit normal and constant, n · f + d with f in [0, 1]³, rounded to half floats."""
    corners: np.ndarray
    """[T] uint16: bit k, corner k counts where the plane is not positive; bit 8 + k, where it is."""

    @staticmethod
    def none(cells: int) -> Sheets:
        """Return sheets without a plane.

        Args:
            cells: C.

        Returns:
            The sheets.
        """
        return Sheets(np.full(cells, -1, np.int32), np.zeros((0, 4), np.float32), np.zeros(0, np.uint16))

    @staticmethod
    def of_cells(plane: np.ndarray, corners: np.ndarray) -> Sheets:
        """Number the planes of a lattice.

        Args:
            plane: [C, 4] planes; 0: none.
            corners: [C] uint16 corners that count.

        Returns:
            The sheets, without planes that change nothing.
        """
        used = plane.any(axis=1) & (corners != ALL_CORNERS)
        row = np.where(used, np.cumsum(used) - 1, -1).astype(np.int32)
        return Sheets(row, plane[used].astype(np.float32), corners[used].astype(np.uint16))

    def of_all(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the planes and corners of all cells.

        Returns:
            [C, 4] float32 planes, 0: none; and [C] uint16 corners.
        """
        plane, corners = np.zeros((len(self.row), 4), np.float32), np.full(len(self.row), ALL_CORNERS, np.uint16)
        used = self.row >= 0
        plane[used], corners[used] = self.plane, self.corners
        return plane, corners

    def counted(self, row: np.ndarray, f: np.ndarray) -> np.ndarray:
        """Find the corners that count at some points.

        Args:
            row: [N] rows of planes; -1: none.
            f: [N, 3] positions in the cells, in [0, 1].

        Returns:
            [N, 8] bool, in the order of ``CORNERS``.
        """
        out = np.ones((len(row), len(CORNERS)), bool)
        mine = np.flatnonzero(row >= 0)
        plane = self.plane[row[mine]]
        over = (f[mine] * plane[:, :3]).sum(axis=1) + plane[:, 3] > 0
        bits = self.corners[row[mine]] >> np.where(over, 8, 0).astype(np.uint16)
        out[mine] = bits[:, None] >> np.arange(8, dtype=np.uint16) & 1
        return out


def find_sheets(
    scene: Scene,
    support: Support,
    nodes: np.ndarray,
    target: np.ndarray,
    cells: np.ndarray | None = None,
    kept: Sheets | None = None,
) -> Sheets:
    """Find the planes of a level, or only those of some cells.

    Args:
        scene: The scene.
        support: Points in air and free segments.
        nodes: [n] sorted indices of the nodes with a target.
        target: [n, 8 K + 8 X] trust of the nodes, see ``support.trust``.
        cells: Sorted indices of the cells to compute; None: all that are covered.
        kept: Planes of the other cells; required with ``cells``.

    Returns:
        The planes.
    """
    asked = support.covered if cells is None else cells
    known = Sheets.none(support.lattice.cell_count) if kept is None else kept
    plane, corners = known.of_all()
    found = planes_of(scene, support, asked)[asked].astype(np.float16).astype(np.float32)
    plane[asked], corners[asked] = found, ALL_CORNERS
    cut = asked[found.any(axis=1)]
    for start in range(0, len(cut), BATCH):
        part = cut[start : start + BATCH]
        corners[part] = _corners(support, nodes, target, part, plane[part])
    return Sheets.of_cells(plane, corners)


def _corners(
    support: Support, nodes: np.ndarray, target: np.ndarray, cells: np.ndarray, plane: np.ndarray
) -> np.ndarray:
    """[B] uint16: the corners of cells that are trusted on each side of their planes [B, 4]. A side without points in
    air has all of them."""
    layout, rows, k = support.pattern, support.slot[cells], len(support.pattern.points)
    air = np.concatenate([support.valid[rows], support.source[rows] >= 0], axis=1)
    over = _over(plane, layout.points, support.near[rows])
    sides = [(air & (over == side)).astype(np.float32) for side in (False, True)]
    node = support.lattice.node_number(support.lattice.cell_corner(cells)[:, None] + CORNERS)
    out = np.zeros(len(cells), np.uint16)
    for corner in range(8):
        at = np.minimum(np.searchsorted(nodes, node[:, corner]), len(nodes) - 1)
        mine, j = target[at] * (nodes[at] == node[:, corner])[:, None], 7 - corner
        near = mine[:, 8 * k + j * CLOSE : 8 * k + (j + 1) * CLOSE]
        trust = np.concatenate([mine[:, j * k : (j + 1) * k], near], axis=1).astype(np.float32)
        for side, weight in enumerate(sides):
            count = weight.sum(axis=1)
            good = ((trust * weight).sum(axis=1) > LEAST_TRUST * count) | (count == 0)
            out |= (good.astype(np.uint16) << np.uint16(8 * side + corner)).astype(np.uint16)
    return out


def _over(plane: np.ndarray, points: np.ndarray, near: np.ndarray) -> np.ndarray:
    """[B, K + X] bool: points [K, 3] and places [B, X, 3] of cells on the positive side of their planes [B, 4]."""
    inside = plane[:, :3] @ points.T + plane[:, 3:]
    return np.concatenate([inside, np.einsum("bxk,bk->bx", near, plane[:, :3]) + plane[:, 3:]], axis=1) > 0


def cut_off(sheets: Sheets, support: Support, nodes: np.ndarray) -> np.ndarray:
    """Find the points of some cubes at which their probe does not count.

    Args:
        sheets: Planes of the support's lattice.
        support: The geometry.
        nodes: [B] indices of nodes.

    Returns:
        [B, 8 K + 8 X] bool: at the points of the cube, then at its places at surfaces.
    """
    k, cells = len(support.pattern.points), support.lattice.node_cells(nodes)
    out = np.zeros((len(nodes), 8 * (k + CLOSE)), bool)
    for j in range(8):
        row = np.where(cells[:, j] >= 0, sheets.row[np.maximum(cells[:, j], 0)], -1)
        mine = np.flatnonzero(row >= 0)
        if not len(mine):
            continue
        near = support.near[support.slot[cells[mine, j]]]
        over = _over(sheets.plane[row[mine]], support.pattern.points, near)
        bits = sheets.corners[row[mine], None] >> np.where(over, 15 - j, 7 - j).astype(np.uint16)
        off = bits & 1 == 0
        out[mine, j * k : (j + 1) * k] = off[:, :k]
        out[mine, 8 * k + j * CLOSE : 8 * k + (j + 1) * CLOSE] = off[:, k:]
    return out


def changed_nodes(lattice: ProbeLattice, before: Sheets, after: Sheets) -> np.ndarray:
    """Find the nodes of cells whose planes differ.

    Args:
        lattice: The lattice.
        before: Planes of its cells.
        after: Planes of its cells after a change.

    Returns:
        Sorted indices of nodes.
    """
    (a, b), (c, d) = before.of_all(), after.of_all()
    cells = np.flatnonzero((a != c).any(axis=1) | (b != d))
    return np.unique(lattice.node_number(lattice.cell_corner(cells)[:, None] + CORNERS))
