"""Fits a feature volume to path-traced samples: light at the nodes by least squares, then the fewest features.

    min over T   Σ_i ω_i ‖Σ_p a_ip T_p - L_i‖² + Σ_e ν₁ ω_e ‖T_p - T_q‖² + Σ_b ν₂ ω_b ‖T_p - 2 T_q + T_r‖²
                 + Σ_o ω_o ‖Σ_p c_op T_p‖²

with ω reweighted for the symmetric relative error as in the solve of probes, e the edges of the grid, b three nodes in
a line, and o the places where air crosses a plane beyond the end of its wall, with c the difference of its sides.
Nodes without samples continue their neighbours linearly. Light is smooth over a distance in metres, and noise averages
over samples: with m samples in a cell, ν₁ grows with m^⅓ and ν₂ falls with it. The features are the leading singular
vectors of the nodes' light, each node divided by its size. Notation: I samples, S light states, P nodes, F features,
K bases.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix, diags, identity
from scipy.sparse.linalg import splu

from lightwell.probes.lattice import CORNERS, hat
from lightwell.probes.solve import Measure, SolveRows
from lightwell.probes.split.grid import SplitGrid
from lightwell.probes.split.volume import FeatureVolume

# Regularisation with one sample in a cell: ν₁ and ν₂ (two rooms with a doorway: relative error 0.052 at ν₂ = 0.01,
# 0.047 at 0.1, 0.065 at 2, where shadows blur).
SLOPE, BEND = 0.03, 0.16
# Weight of the difference between both sides of a plane where air crosses it, as that of one sample.
SEAM = 1.0
PASSES = 3
# Weight of the smoothness of log ω, which gives nodes without samples the ω of their neighbours, and of all nodes, so
# that parts without samples are dark.
SPREAD, FLOOR = 1e-3, 1e-9
LARGEST = 127


def fit_volume(grid: SplitGrid, rows: SolveRows, features: int, mix: np.ndarray | None = None) -> FeatureVolume:
    """Fit a volume.

    Args:
        grid: The grid.
        rows: Samples in air.
        features: F, at most 27 K.
        mix: [S, K] factors of the states in the bases; None for light that does not change.

    Returns:
        The volume, its features and decoder rounded as stored.
    """
    light = node_light(grid, rows)
    bases = light[0][..., None] if mix is None else np.einsum("spc,sk->pck", light, mix)
    return compressed(grid, bases.reshape(grid.count, -1), features)


def compressed(grid: SplitGrid, bases: np.ndarray, features: int) -> FeatureVolume:
    """Reduce the light of the nodes to features.

    Args:
        grid: The grid.
        bases: [P, 27 K] light of the nodes.
        features: F.

    Returns:
        The volume.
    """
    size = np.maximum(np.linalg.norm(bases, axis=1, keepdims=True), 1e-30)
    directions = np.linalg.svd(bases / size, full_matrices=False)[2][:features]
    decoder = directions.T.astype(np.float16).astype(np.float32)
    # The features that are best after the decoder was rounded.
    values = np.linalg.lstsq(decoder, bases.T, rcond=None)[0].T
    return FeatureVolume(grid, rounded(values), decoder)


def rounded(features: np.ndarray) -> np.ndarray:
    """Round features as a shading graph stores them.

    Args:
        features: [P, F] features.

    Returns:
        [P, F] float32: bytes times a step for each node.
    """
    step = np.abs(features).max(axis=1, keepdims=True).astype(np.float32) / np.float32(LARGEST)
    return (np.rint(features / np.maximum(step, 1e-30)) * step).astype(np.float32)


def node_light(grid: SplitGrid, rows: SolveRows) -> np.ndarray:
    """Solve for the light of the nodes.

    Args:
        grid: The grid.
        rows: Samples in air.

    Returns:
        [S, P, 27] float64 irradiance harmonics.
    """
    states = rows.light if rows.light.ndim == 4 else rows.light[None]
    # Places without any light lie outside or in a hollow; where they share a cell with a room, they are not of it.
    lit = np.flatnonzero(states.any(axis=(0, 2, 3)))
    states, system = states[:, lit], _System.of(grid, rows.place[lit])
    goal = np.moveaxis(states.astype(np.float64), 0, 1).reshape(states.shape[1], -1)
    measure = Measure(states.mean(axis=0))
    omega = measure.omega(states.mean(axis=0).reshape(-1, 27))
    found = np.zeros((grid.count, goal.shape[1]))
    for _ in range(PASSES):
        found = system.solved(omega, goal)
        omega = measure.omega((system.matrix @ found).reshape(len(goal), len(states), 27).mean(axis=1))
    return np.moveaxis(found.reshape(grid.count, len(states), 27), 1, 0)


@dataclass(frozen=True)
class _System:
    """Matrices of the least squares."""

    matrix: csr_matrix
    """[I, P] weights of the nodes."""
    slopes: csr_matrix
    """[edges, P] differences."""
    bends: csr_matrix
    """[lines, P] second differences."""
    seams: csr_matrix
    """[openings, P] differences between the sides of a plane."""
    density: float
    """Samples per cell with air."""

    @staticmethod
    def of(grid: SplitGrid, place: np.ndarray) -> _System:
        node, weight = grid.corners(place)
        lines, edges = grid.bends, _edges(grid)
        density = max(len(place), 1) / max(int((grid.first >= 0).sum()), 1)
        return _System(
            _sparse(node, weight, grid.count),
            _sparse(edges, np.broadcast_to([1.0, -1.0], edges.shape), grid.count),
            _sparse(lines, np.broadcast_to([1.0, -2.0, 1.0], lines.shape), grid.count),
            _seams(grid),
            density,
        )

    def solved(self, omega: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """[P, 27 S] minimiser for given ω [I]."""
        gram = self.matrix.T @ diags(omega) @ self.matrix
        at = self._spread(omega)
        scale = np.cbrt(self.density)
        for rows, weight in ((self.slopes, SLOPE * scale), (self.bends, BEND / scale), (self.seams, SEAM)):
            # ω of a row is the geometric mean over its nodes, so that a dark room is as smooth as a bright one.
            share = abs(rows)
            mean = np.exp((share @ at) / np.maximum(np.asarray(share.sum(axis=1)).ravel(), 1))
            gram = gram + weight * (rows.T @ diags(mean) @ rows)
        system = gram + FLOOR * diags(np.exp(at))
        return splu(csc_matrix(system)).solve(self.matrix.T @ (omega[:, None] * goal))

    def _spread(self, omega: np.ndarray) -> np.ndarray:
        """[P] log ω at the nodes: the mean of their samples, continued to nodes without samples."""
        total = np.asarray(self.matrix.sum(axis=0)).ravel()
        known = (total > FLOOR).astype(float)
        mean = np.log(np.maximum(self.matrix.T @ omega, 1e-300) / np.maximum(total, FLOOR)) * known
        system = diags(known) + SPREAD * (self.slopes.T @ self.slopes) + FLOOR * identity(len(total))
        return splu(csc_matrix(system)).solve(mean)


def _sparse(columns: np.ndarray, values: np.ndarray, count: int) -> csr_matrix:
    """[N, count] matrix of rows with a few entries [N, M]."""
    at = np.repeat(np.arange(len(columns)), columns.shape[1])
    return coo_matrix((values.ravel(), (at, columns.ravel())), (len(columns), count)).tocsr()


def _seams(grid: SplitGrid) -> csr_matrix:
    """[M, P] light on side 0 minus light on side 1 at the openings."""
    first = grid.first[grid.openings[:, 0].astype(np.int64)]
    weight = hat(grid.openings[:, None, 1:] - CORNERS)
    node = np.concatenate([grid.nodes[first], grid.nodes[first + 1]], axis=1)
    return _sparse(node, np.concatenate([weight, -weight], axis=1), grid.count)


def _edges(grid: SplitGrid) -> np.ndarray:
    """[E, 2] nodes that are neighbours in a side of a cell."""
    low = [(k, k | bit) for bit in (1, 2, 4) for k in range(len(CORNERS)) if not k & bit]
    edges = np.sort(np.concatenate([grid.nodes[:, pair] for pair in low]), axis=1)
    return np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0)
