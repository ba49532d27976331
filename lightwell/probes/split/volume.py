"""A feature volume: the light in the air as features of a split grid, decoded by one linear layer without a bias.

    E(x, n) = max(0, ⟨Y(n), D f(y)⟩)    f(y) = Σ_c hat_c(y) T[node_c]    y = x + offset n

A room a thousand times darker is decoded as precisely, and light stays linear: it can be scaled and mixed. Hidden units
have nothing to gain: with twelve features the error is that of all 27 harmonics. Notation: P nodes, F features, K
bases, N points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lightwell.probes import sh
from lightwell.probes.split.grid import SplitGrid

# Offset of queries on surfaces along the normal, units of the spacing: a wall's plane is in its middle, so that it need
# not be large.
OFFSET = 0.2
# Bytes in a file: the step of a node's features; the number of copies of a lattice node; the flag of a cell; the
# record's number of a cell whose corners are not all first copies, and eight numbers of copies for each side of it;
# four half floats of a plane.
STEP, NODE, CELL, RECORD, COPIES, PLANE = 2, 1, 1, 2, 4, 8


@dataclass(frozen=True)
class FeatureVolume:
    """Features at the nodes of a split grid, and their decoder."""

    grid: SplitGrid
    features: np.ndarray
    """[P, F] float32, rounded as stored: bytes with a step for each node."""
    decoder: np.ndarray
    """[27 K, F] float32 weights, rounded to half floats; rows are harmonic, colour, basis, the last one fastest."""
    offset: float = OFFSET
    """Offset of queries along the normal, units of the spacing."""

    @property
    def rank(self) -> int:
        """K."""
        return len(self.decoder) // 27

    def in_air(self) -> FeatureVolume:
        """Return the same volume without the offset along the normal, for objects that move.

        Returns:
            The volume.
        """
        return replace(self, offset=0.0)

    @property
    def bytes(self) -> dict[str, float]:
        """Return the size in a file by part: features, tables of the grid, and decoder in half floats."""
        lattice, grid = self.grid.lattice, self.grid
        odd, sides = grid.irregular
        tables = NODE * len(lattice) + CELL * lattice.cell_count + RECORD * odd + COPIES * sides
        return {
            "features": float(len(self.features) * (self.features.shape[1] + STEP)),
            "tables": float(tables + PLANE * len(grid.cuts.plane)),
            "decoder": 2.0 * self.decoder.size,
        }

    def harmonics(self, y: np.ndarray) -> np.ndarray:
        """Decode the light at points.

        Args:
            y: [N, 3] points with the offset along the normal applied, metres.

        Returns:
            [N, 9, 3, K] float64 irradiance harmonics of the bases.
        """
        node, weight = self.grid.corners(y)
        f = np.einsum("nk,nkf->nf", weight, self.features[node])
        return (f @ self.decoder.T).reshape(len(f), 9, 3, self.rank)


def query(volume: FeatureVolume, x: np.ndarray, n: np.ndarray, factors: np.ndarray | None = None) -> np.ndarray:
    """Compute the irradiance at some points.

    Args:
        volume: The volume.
        x: [N, 3] points, metres.
        n: [N, 3] unit normals.
        factors: [K] mixing factors of the bases; None: 1 each.

    Returns:
        [N, 3] irradiance, ≥ 0.
    """
    y = np.asarray(x, np.float64) + volume.offset * volume.grid.lattice.spacing * np.asarray(n, np.float64)
    e = volume.harmonics(y) @ (np.ones(volume.rank) if factors is None else factors)
    return np.maximum(sh.evaluate(e, n), 0)
