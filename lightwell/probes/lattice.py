"""The probe lattice: nodes at the corners of cubic cells. Notation: P nodes, C cells, N points, h the spacing.

Node (i, j, k) has the index (k · ny + j) · nx + i; cells are numbered in the same way with nx - 1, ny - 1, nz - 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# Corners of a cell; bit 0 of the index is x, bit 1 y, bit 2 z.
CORNERS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
# Whole cells between the outermost surface and the border, so that every surface has probes on both sides.
PADDING = 1
MAX_NODES = 1 << 22
# Edges of a room, relative to its longest one: scenes have as many nodes by default as such a room has. How many times
# closer nodes stand for that at most, and the factor of a step.
ROOM, MOST_CLOSER, CLOSER = (1.0, 0.5, 1.0), 4.0, 0.97


@dataclass(frozen=True)
class ProbeLattice:
    """A regular lattice of probes."""

    origin: np.ndarray
    """[3] float64 position of the first node, metres."""
    spacing: float
    """Distance h of the nodes, metres."""
    shape: tuple[int, int, int]
    """(nx, ny, nz) nodes, at least 2 each."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", np.asarray(self.origin, np.float64).reshape(3))
        object.__setattr__(self, "shape", tuple(int(n) for n in self.shape))
        if not (self.spacing > 0 and np.isfinite(self.spacing) and np.isfinite(self.origin).all()):
            raise ValueError(f"probes: spacing {self.spacing} is not a length; give metres, such as 1m")
        if min(self.shape) < 2 or len(self.shape) != 3 or len(self) > MAX_NODES:
            raise ValueError(
                f"probes: {self.shape} nodes, expected 2 or more a side and {MAX_NODES} in all; use --spacing"
            )

    @staticmethod
    def around(bounds: np.ndarray, spacing: float, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> ProbeLattice:
        """Create a lattice that covers a box and one whole cell more on every side.

        Args:
            bounds: [2, 3] least and greatest corner, metres.
            spacing: Distance of the nodes, metres, > 0.
            offset: [3] start of the lattice within a cell, in [0, 1); benchmarks average over several, because the
                error depends on where walls lie between the nodes.

        Returns:
            The lattice.

        Raises:
            ValueError: The spacing is not a positive number.
        """
        if not (spacing > 0 and np.isfinite(spacing)):
            raise ValueError(f"probes: --spacing {spacing} is not a length; give metres, such as 1m")
        low, high = np.asarray(bounds, np.float64)
        origin = low - spacing * (PADDING + np.asarray(offset, np.float64))
        cells = np.ceil((high - origin) / spacing - 1e-9).astype(np.int64) + PADDING
        return ProbeLattice(origin, float(spacing), tuple(cells + 1))

    def __len__(self) -> int:
        return int(np.prod(self.shape))

    @property
    def cells(self) -> tuple[int, int, int]:
        """Cells along x, y, z."""
        x, y, z = self.shape
        return x - 1, y - 1, z - 1

    @property
    def cell_count(self) -> int:
        """C, the number of cells."""
        return int(np.prod(self.cells))

    def nodes(self) -> np.ndarray:
        """Return the positions of all nodes.

        Returns:
            [P, 3] float64, metres.
        """
        return self.origin + self.spacing * _grid(self.shape)

    def cell_corner(self, cell: np.ndarray) -> np.ndarray:
        """Return the coordinates of the least node of some cells.

        Args:
            cell: [...] indices of cells.

        Returns:
            [..., 3] int64.
        """
        cx, cy, _ = self.cells
        cell = np.asarray(cell)
        return np.stack([cell % cx, cell // cx % cy, cell // (cx * cy)], axis=-1)

    def node_number(self, at: np.ndarray) -> np.ndarray:
        """Return the indices of nodes.

        Args:
            at: [..., 3] integer coordinates inside the lattice.

        Returns:
            [...] indices.
        """
        nx, ny, _ = self.shape
        return (at[..., 2] * ny + at[..., 1]) * nx + at[..., 0]

    def cell_number(self, at: np.ndarray) -> np.ndarray:
        """Return the indices of cells.

        Args:
            at: [..., 3] integer coordinates of their least nodes.

        Returns:
            [...] indices; -1 outside of the lattice.
        """
        size = np.array(self.cells)
        inside = np.all((at >= 0) & (at < size), axis=-1)
        return np.where(inside, (at[..., 2] * size[1] + at[..., 1]) * size[0] + at[..., 0], -1)

    def node_cells(self, nodes: np.ndarray) -> np.ndarray:
        """Return the eight cells around some nodes.

        Args:
            nodes: [K] indices of nodes.

        Returns:
            [K, 8] indices of cells in the order of ``CORNERS``; -1 outside of the lattice.
        """
        nx, ny, _ = self.shape
        at = np.stack([nodes % nx, nodes // nx % ny, nodes // (nx * ny)], axis=-1)
        return self.cell_number(at[:, None] + CORNERS - 1)

    def locate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the cells of some points; points outside are moved to the nearest border.

        Args:
            x: [N, 3] points, metres.

        Returns:
            [N, 3] int64 coordinates of the cell, and [N, 3] position in it in [0, 1].
        """
        at = (np.asarray(x, np.float64) - self.origin) / self.spacing
        at = np.clip(at, 0, np.array(self.cells))
        cell = np.minimum(np.floor(at), np.array(self.cells) - 1).astype(np.int64)
        return cell, at - cell

    def corners(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Find the eight nodes around some points.

        Args:
            x: [N, 3] points, metres.

        Returns:
            [N, 8] indices of the nodes, [N, 8] trilinear weights (hat), and [N, 8, 3] positions relative to the nodes
            (probe-local, u) in [-1, 1], units of the spacing.
        """
        cell, f = self.locate(x)
        node = self.node_number(cell[:, None] + CORNERS)
        u = f[:, None] - CORNERS
        return node, hat(u), u


def default_spacing(bounds: np.ndarray, along: int) -> float:
    """Choose the distance of nodes in a box: a share of its longest edge, and less in a box that is flat or long.

    A town of one floor, or a corridor, has as many nodes as a room then: an eighth of a corridor's length is wider than
    the corridor (pyraxia-hallway: 5.3 m in a hall of 3 m).

    Args:
        bounds: [2, 3] least and greatest corner, metres.
        along: Nodes along the longest edge of a room.

    Returns:
        Distance, metres.
    """
    edges = np.asarray(bounds, np.float64)[1] - np.asarray(bounds, np.float64)[0]
    room = len(ProbeLattice.around(np.array([(0.0, 0.0, 0.0), ROOM]), 1 / along))
    spacing = widest = float(edges.max()) / along
    while len(ProbeLattice.around(bounds, spacing)) < room and spacing > widest / MOST_CLOSER:
        spacing *= CLOSER
    return spacing


def _grid(shape: tuple[int, int, int]) -> np.ndarray:
    """[prod(shape), 3] integer coordinates, x fastest."""
    nx, ny, nz = shape
    z, y, x = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)


def hat(u: np.ndarray) -> np.ndarray:
    """Compute the trilinear weight of a node.

    Args:
        u: [..., 3] probe-local positions, units of the spacing.

    Returns:
        [...] weights in [0, 1].
    """
    return np.maximum(0, 1 - np.abs(u)).prod(axis=-1)
