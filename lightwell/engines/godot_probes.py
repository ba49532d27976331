"""Probes for Godot's LightmapGIData: tetrahedra, and the tree of planes by which Godot finds the one of a point.

Every cell of the lattice is cut into six tetrahedra along its diagonal (Kuhn's subdivision). Planes between cells, then
the planes x = y, y = z and x = z of a cell, separate all of them without cutting one.
"""

from __future__ import annotations

import itertools

import numpy as np

from lightwell.probes.lattice import ProbeLattice

# BSPNode::EMPTY_LEAF of Godot.
EMPTY = -(2**31)
# Planes of a cell: a point is over where the first coordinate exceeds the second.
PAIRS = ((0, 1), (1, 2), (0, 2))


def tetrahedra(lattice: ProbeLattice) -> np.ndarray:
    """List the tetrahedra.

    Args:
        lattice: Lattice of the probes.

    Returns:
        [6 C, 4] int32 numbers of probes: cell by cell, x fastest, in the order of the permutations of the axes by
        falling coordinate.
    """
    cells = lattice.cell_corner(np.arange(lattice.cell_count))
    parts = []
    for order in itertools.permutations(range(3)):
        steps = np.zeros((4, 3), int)
        for k, axis in enumerate(order):
            steps[k + 1 :, axis] = 1
        parts.append(lattice.node_number(cells[:, None] + steps))
    return np.stack(parts, axis=1).reshape(-1, 4).astype(np.int32)


class Tree:
    """The tree of planes: nodes of normal, distance, and what lies over and under."""

    def __init__(self, lattice: ProbeLattice) -> None:
        """Build the tree.

        Args:
            lattice: Lattice of the probes.
        """
        self.lattice = lattice
        self.rows: list[tuple[float, float, float, float, int, int]] = []
        shape = lattice.shape
        self._split((0, 0, 0), (shape[0] - 1, shape[1] - 1, shape[2] - 1))

    def numbers(self) -> np.ndarray:
        """Return the tree as Godot stores it.

        Returns:
            [N, 6] int32: the bits of the plane's four floats, then the children.
        """
        planes = np.array([row[:4] for row in self.rows], np.float32).view(np.int32)
        children = np.array([row[4:] for row in self.rows], np.int64).astype(np.int32)
        return np.concatenate([planes, children], axis=1)

    def _add(self, normal: np.ndarray, distance: float) -> int:
        x, y, z = normal.tolist()
        self.rows.append((x, y, z, distance, EMPTY, EMPTY))
        return len(self.rows) - 1

    def _set(self, node: int, over: int, under: int) -> int:
        self.rows[node] = (*self.rows[node][:4], over, under)
        return node

    def _split(self, low: tuple[int, int, int], high: tuple[int, int, int]) -> int:
        """Node of the cells from low to high (exclusive)."""
        size = [b - a for a, b in zip(low, high)]
        axis = int(np.argmax(size))
        if size[axis] == 1:
            return self._cell(low)
        middle = low[axis] + size[axis] // 2
        normal = np.eye(3)[axis]
        node = self._add(normal, float(self.lattice.origin[axis] + self.lattice.spacing * middle))
        upper = (*low[:axis], middle, *low[axis + 1 :])
        lower = (*high[:axis], middle, *high[axis + 1 :])
        return self._set(
            node, self._split((upper[0], upper[1], upper[2]), high), self._split(low, (lower[0], lower[1], lower[2]))
        )

    def _cell(self, cell: tuple[int, int, int]) -> int:
        """Node of the six tetrahedra of a cell."""
        number = int(self.lattice.cell_number(np.array(cell)))
        leaves = {order: -(6 * number + i) - 1 for i, order in enumerate(itertools.permutations(range(3)))}
        corner = self.lattice.origin + self.lattice.spacing * np.array(cell)
        return self._order(corner, leaves, 0)

    def _order(self, corner: np.ndarray, leaves: dict[tuple[int, ...], int], pair: int) -> int:
        """Node that separates orders of the coordinates by the pairs from ``pair`` on; a leaf where one is left."""
        if len(leaves) == 1:
            return next(iter(leaves.values()))
        a, b = PAIRS[pair]
        over = {order: leaf for order, leaf in leaves.items() if order.index(a) < order.index(b)}
        under = {order: leaf for order, leaf in leaves.items() if order not in over}
        if not over or not under:
            return self._order(corner, leaves, pair + 1)
        normal = (np.eye(3)[a] - np.eye(3)[b]) / np.sqrt(2)
        node = self._add(normal, float(normal @ corner))
        return self._set(node, self._order(corner, over, pair + 1), self._order(corner, under, pair + 1))
