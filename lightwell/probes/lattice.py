"""The probe lattice: nodes at the corners of cubic cells. Notation: P nodes, C cells, N points, h the spacing.

Node (i, j, k) has the number (k · ny + j) · nx + i; cells are numbered the same way with nx - 1, ny - 1, nz - 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Corners of a cell in the order of their bits: x is bit 0.
CORNERS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
# Whole cells between the outermost surface and the border: a volume cut to the room's air fails silently.
PADDING = 1
MAX_NODES = 1 << 22


@dataclass(frozen=True)
class Lattice:
    """A regular lattice of probes."""

    origin: np.ndarray
    """[3] float64 place of the first node, metres."""
    spacing: float
    """h, metres."""
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
    def around(bounds: np.ndarray, spacing: float, offset=(0.0, 0.0, 0.0)) -> Lattice:
        """A lattice that covers ``bounds`` [2, 3] and one whole cell more on every side.

        offset   [3] in [0, 1): where in a cell the lattice starts; one lucky place can hide a wall.
        """
        if not (spacing > 0 and np.isfinite(spacing)):
            raise ValueError(f"probes: --spacing {spacing} is not a length; give metres, such as 1m")
        low, high = np.asarray(bounds, np.float64)
        origin = low - spacing * (PADDING + np.asarray(offset, np.float64))
        cells = np.ceil((high - origin) / spacing - 1e-9).astype(np.int64) + PADDING
        return Lattice(origin, float(spacing), tuple(cells + 1))

    def __len__(self) -> int:
        return int(np.prod(self.shape))

    @property
    def cells(self) -> tuple[int, int, int]:
        """Cells along x, y, z."""
        return tuple(n - 1 for n in self.shape)

    @property
    def cell_count(self) -> int:
        """C."""
        return int(np.prod(self.cells))

    def nodes(self) -> np.ndarray:
        """[P, 3] float64 places of the nodes."""
        return self.origin + self.spacing * _grid(self.shape)

    def cell_corner(self, cell: np.ndarray) -> np.ndarray:
        """[..., 3] int64 coordinates of the least node of cells [...]."""
        cx, cy, _ = self.cells
        cell = np.asarray(cell)
        return np.stack([cell % cx, cell // cx % cy, cell // (cx * cy)], axis=-1)

    def node_number(self, at: np.ndarray) -> np.ndarray:
        """[...] numbers of nodes at integer coordinates [..., 3]."""
        nx, ny, _ = self.shape
        return (at[..., 2] * ny + at[..., 1]) * nx + at[..., 0]

    def cell_number(self, at: np.ndarray) -> np.ndarray:
        """[...] numbers of cells at integer coordinates [..., 3]; -1 outside."""
        size = np.array(self.cells)
        inside = np.all((at >= 0) & (at < size), axis=-1)
        return np.where(inside, (at[..., 2] * size[1] + at[..., 1]) * size[0] + at[..., 0], -1)

    def node_cells(self, nodes: np.ndarray) -> np.ndarray:
        """[K, 8] numbers of the cells round nodes [K], in the order of ``CORNERS``; -1 beyond the border."""
        nx, ny, _ = self.shape
        at = np.stack([nodes % nx, nodes // nx % ny, nodes // (nx * ny)], axis=-1)
        return self.cell_number(at[:, None] + CORNERS - 1)

    def locate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cell [N, 3] int64 of points [N, 3], and the place in it [N, 3] in [0, 1]; outside: the nearest border."""
        at = (np.asarray(x, np.float64) - self.origin) / self.spacing
        at = np.clip(at, 0, np.array(self.cells))
        cell = np.minimum(np.floor(at), np.array(self.cells) - 1).astype(np.int64)
        return cell, at - cell

    def corners(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Node numbers [N, 8], trilinear weights (hat) [N, 8] and probe-local places u [N, 8, 3] in [-1, 1]."""
        cell, f = self.locate(x)
        node = self.node_number(cell[:, None] + CORNERS)
        u = f[:, None] - CORNERS
        return node, hat(u), u


def _grid(shape) -> np.ndarray:
    """[prod(shape), 3] integer coordinates, x fastest."""
    nx, ny, nz = shape
    z, y, x = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)


def hat(u: np.ndarray) -> np.ndarray:
    """[...] trilinear weight of probe-local places [..., 3]."""
    return np.maximum(0, 1 - np.abs(u)).prod(axis=-1)
