"""Support points: the same low-discrepancy pattern in every cell, and the graph that connects neighbours.

A probe's cube is the eight cells around its node, so that all cubes have the same 8 · 512 points and neighbouring
probes share points, validity and edges. Notation: K points per cell, E edges per cell, M edges inside a cube,
lengths in units of the spacing h.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from lightwell.probes.lattice import CORNERS, hat

POINTS = 512
NEIGHBOURS = 14
# Steps of the R3 sequence: powers of the root of x⁴ = x + 1 (Roberts 2018).
R3 = 1.2207440846057596 ** -np.arange(1.0, 4.0)


@dataclass(frozen=True)
class Pattern:
    """Points of a cell and of a cube, and the edges between them."""

    points: np.ndarray
    """[K, 3] in [0, 1): the points of a cell."""
    u: np.ndarray
    """[8 K, 3] points of a cube in probe-local coordinates [-1, 1], cell by cell in the order of ``CORNERS``."""
    hat: np.ndarray
    """[8 K] trilinear weight of the cube's probe."""
    start: np.ndarray
    """[E] index of the first point of each edge of a cell."""
    end: np.ndarray
    """[E] index of the second point."""
    step: np.ndarray
    """[E, 3] cell of the second point relative to that of the first."""
    length: np.ndarray
    """[E] length."""
    cube_edges: np.ndarray
    """[M, 4] int32 edges inside a cube: first and second point of the cube, corner (0-7) and index of the edge."""

    @property
    def median(self) -> float:
        """The median edge length s."""
        return float(np.median(self.length))

    def weights(self) -> np.ndarray:
        """Return the weights of the edges in the diffusion of trust.

        Returns:
            [E] exp(-d² / 2 s²), in (0, 1].
        """
        return np.exp(-0.5 * (self.length / self.median) ** 2)

    def decay(self, reach: float) -> float:
        """Return the decay λ for which diffused trust falls by a factor of e over a distance: λ = <d²>_w / 6 ℓ².

        Args:
            reach: The distance ℓ, units of the spacing.

        Returns:
            λ > 0.
        """
        w = self.weights()
        return float((w * self.length**2).sum() / w.sum() / (6 * reach**2))

    @property
    def octant(self) -> np.ndarray:
        """[8 K] octant of each point of the cube, see ``octants``."""
        return octants(self.u)


def octants(u: np.ndarray) -> np.ndarray:
    """Find the octants of points in a probe's cube, which is divided into 4³.

    Args:
        u: [..., 3] probe-local positions in [-1, 1].

    Returns:
        [...] int64 indices from 0 to 63, x fastest.
    """
    at = np.clip(np.floor((u + 1) * 2), 0, 3).astype(np.int64)
    return (at[..., 2] * 4 + at[..., 1]) * 4 + at[..., 0]


@lru_cache(maxsize=4)
def pattern(points: int = POINTS, neighbours: int = NEIGHBOURS) -> Pattern:
    """Create the pattern; each point has edges to its nearest neighbours, also in other cells.

    Args:
        points: Number of points per cell.
        neighbours: Number of neighbours per point.

    Returns:
        The pattern; equal arguments give the same object.
    """
    inside = (0.5 + np.arange(1, points + 1)[:, None] * R3) % 1.0
    u = (inside[None] + (CORNERS - 1)[:, None]).reshape(-1, 3)
    start, end, step = _edges(inside, neighbours)
    length = np.linalg.norm(inside[end] + step - inside[start], axis=1)
    cube = []
    for corner in range(8):
        other = CORNERS[corner] + step
        rows = np.flatnonzero(np.all((other >= 0) & (other <= 1), axis=1))
        there = other[rows] @ np.array([1, 2, 4])
        cube.append(
            np.stack([corner * points + start[rows], there * points + end[rows], 0 * rows + corner, rows], axis=1)
        )
    return Pattern(inside, u, hat(u), start, end, step, length, np.concatenate(cube).astype(np.int32))


def _edges(points: np.ndarray, neighbours: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Undirected edges of the periodic pattern, each once."""
    shifts = np.array([[x, y, z] for z in (-1, 0, 1) for y in (-1, 0, 1) for x in (-1, 0, 1)])
    images = (points[None] + shifts[:, None]).reshape(-1, 3)
    _, near = cKDTree(images).query(points, k=neighbours + 1)
    a = np.repeat(np.arange(len(points)), neighbours)
    b, shift = near[:, 1:].ravel() % len(points), shifts[near[:, 1:].ravel() // len(points)]
    # Keep one direction of each edge: the greater step, or the greater index within a cell.
    key = shift @ np.array([1, 3, 9])
    turn = (key < 0) | ((key == 0) & (b < a))
    a, b, shift = np.where(turn, b, a), np.where(turn, a, b), np.where(turn[:, None], -shift, shift)
    rows = np.unique(np.column_stack([a, b, shift]), axis=0)
    return rows[:, 0], rows[:, 1], rows[:, 2:]
