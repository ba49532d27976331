"""Solves for the light of the probes, given the run-time weights.

    min over L   Σ_i ω_i ‖Σ_p a_ip L_p - L_i‖² + Σ_p μ_p ‖L_p - L_p⁰‖² + Σ_pq ν_pq ‖L_p - L_q‖²

with ω reweighted so that the sum becomes the symmetric relative error (IRLS; Holland and Welsch 1977). One weight
per row allows one factorisation for all 27 columns. Notation: I rows (radiance samples), P nodes (fine probes
included), S states of a declared light.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import splu

from lightwell.probes import sh
from lightwell.probes.volume import ORPHAN, ProbeVolume, coefficients

PASSES = 8
# Regularisation towards the traced light, and towards neighbours, relative to the diagonal.
TO_TRACED, TO_NEIGHBOUR = 0.1, 0.01
# ω = 1 / (D^RELATIVE max(r, …)): 1 is the relative error itself, 0 the absolute one. The relative error of noisy rows
# is least at their median, which is below the mean where light is uneven and so too dark. At this value held-out
# places have the least error and dark leak (two rooms, against 1: symmetric relative error 0.062 -> 0.053, dark leak
# relative to line of sight 1.6 -> 1.0).
RELATIVE = 0.3
# ε of the relative error, relative to the mean irradiance.
EPSILON = 1e-3
# Number of directions in which the error of a row is measured.
DIRECTIONS = 20
# Lower bound of a row's error in ω, relative to its size. With a smaller bound, strong noise pulls the result to its
# median (Erlang noise of 58 %: 7 % too dark at 0.3, 0.1 % at 1); outliers beyond it still get a smaller ω.
LEAST_RESIDUAL = 1.0


@dataclass(frozen=True)
class SolveRows:
    """Radiance samples: the equations of the solve."""

    place: np.ndarray
    """[I, 3] points, metres."""
    normal: np.ndarray
    """[I, 3] unit normal of a sample on a surface; 0 in air, where no offset applies."""
    light: np.ndarray
    """[I, 9, 3] irradiance harmonics, or [S, I, 9, 3] of S light states."""
    cell: np.ndarray | None = None
    """[I] index of the lattice's cell that contains each sample."""
    noise: np.ndarray | None = None
    """[I] relative error that noise causes: half of the error between the two halves of the paths."""

    def part(self, chosen: np.ndarray) -> SolveRows:
        """Return some of the rows.

        Args:
            chosen: [I'] indices, or [I] bool.

        Returns:
            The chosen rows.
        """
        more = [None if v is None else v[chosen] for v in (self.cell, self.noise)]
        return SolveRows(self.place[chosen], self.normal[chosen], self.light[..., chosen, :, :], *more)


@dataclass(frozen=True)
class Solution:
    """Result of the solve."""

    light: np.ndarray
    """[P, 9, 3] float32 irradiance harmonics, or [S, P, 9, 3] of S states."""
    orphans: np.ndarray
    """[I] bool: rows without a trusted probe."""
    errors: tuple[float, ...]
    """Mean symmetric relative error after each pass, the traced light first."""
    residual: np.ndarray
    """[I] symmetric relative error of each row, 1 for orphans."""


def smape(truth: np.ndarray, found: np.ndarray, epsilon: float) -> np.ndarray:
    """Compute the symmetric relative error |a - b| / (|a| + |b| + ε).

    Args:
        truth: [...] reference values.
        found: [...] values of the same shape.
        epsilon: ε > 0, in the unit of the values.

    Returns:
        [...] errors in [0, 1].
    """
    return np.abs(truth - found) / (np.abs(truth) + np.abs(found) + epsilon)


def matrix(volume: ProbeVolume, rows: SolveRows) -> tuple[csc_matrix, np.ndarray]:
    """Build the matrix of the interpolation weights.

    Args:
        volume: The weights.
        rows: I samples.

    Returns:
        [I, P] normalised weights of the nodes, and [I] trusted weight Z.
    """
    node, share, z = coefficients(volume, rows.place, rows.normal)
    at = np.repeat(np.arange(len(node)), node.shape[1])
    shape = (len(node), len(volume.state))
    return coo_matrix((share.ravel().astype(np.float64), (at, node.ravel())), shape=shape).tocsc(), z


def solve(
    volume: ProbeVolume,
    rows: SolveRows,
    traced: np.ndarray,
    passes: int = PASSES,
    free: np.ndarray | None = None,
    held: np.ndarray | None = None,
) -> Solution:
    """Solve for the light of all live nodes, or of some of them while the others are held fixed.

    Several states share ω, computed from their mean, so that the result is linear in the light.

    Args:
        volume: The weights.
        rows: Radiance samples.
        traced: [P, 9, 3] or [S, P, 9, 3] traced light at each probe: the start, and the target of the regularisation.
        passes: Number of reweighted solves.
        free: [P] bool: nodes to solve for; None for all live ones.
        held: Light of the shape of ``traced`` for the other nodes; required with ``free``.

    Returns:
        The light of the best pass, with its errors.
    """
    a, z = matrix(volume, rows)
    good = z >= ORPHAN
    a = a[np.flatnonzero(good)]
    states = rows.light.ndim == 4
    goal, start = (rows.light, traced) if states else (rows.light[None], traced[None])
    live = np.flatnonzero(volume.alive if free is None else volume.alive & free)
    columns = a[:, live].tocsc()
    # Zeros of one number: with many states they would be gigabytes.
    fixed = np.broadcast_to(0.0, (columns.shape[0], 27 * len(start)))
    if free is not None:
        before = (held if states else held[None]).astype(np.float64)
        fixed = a[:, np.flatnonzero(~free)] @ np.moveaxis(before[:, ~free], 0, 1).reshape(int((~free).sum()), -1)
    state = lambda x, k: x[k][live].reshape(len(live), 27).astype(np.float64)  # noqa: E731
    aim = lambda k: goal[k, good].reshape(columns.shape[0], 27) - fixed[:, 27 * k : 27 * k + 27]  # noqa: E731
    mean = goal.mean(axis=0, dtype=np.float64)[good]
    middle = fixed.reshape(len(fixed), len(start), 27).mean(axis=1)
    omega, residual, errors = _reweighted(
        columns, mean, state(start.mean(axis=0, dtype=np.float64)[None], 0), middle, passes
    )
    ties = _ties(columns)
    solve_for = (lambda right, prior: prior) if omega is None else _weighted(columns, omega, ties)
    light = np.zeros((len(start), len(volume.state), 9, 3), np.float32)
    if free is not None:
        light[:, ~free] = before[:, ~free]
    for k in range(len(start)):
        light[k, live] = solve_for(aim(k), state(start, k)).reshape(-1, 9, 3)
    every = np.ones(len(good))
    every[good] = residual
    return Solution(light if states else light[0], ~good, tuple(errors), every)


def _reweighted(
    columns: csc_matrix, goal: np.ndarray, prior: np.ndarray, fixed: np.ndarray, passes: int
) -> tuple[np.ndarray | None, np.ndarray, list[float]]:
    """Iteratively reweighted solves for the mean [I, 9, 3] of all states: ω of the best pass (None: the traced light is
    better than all), its residuals [I], errors of all passes."""
    measure, ties = Measure(goal), _ties(columns)
    right = goal.reshape(len(goal), 27) - fixed
    # Start at the traced light: a first pass without weights would move away from a good solution.
    predicted = columns @ prior + fixed
    omega, residual = measure.omega(predicted), measure.residual(predicted)
    best, errors = None, [float(residual.mean())]
    for _ in range(passes):
        predicted = columns @ _weighted(columns, omega, ties)(right, prior) + fixed
        errors.append(float(measure.residual(predicted).mean()))
        # Reweighting does not guarantee descent, so the best pass is kept.
        if errors[-1] <= min(errors):
            best, residual = omega, measure.residual(predicted)
        omega = measure.omega(predicted)
    return best, residual, errors


def relative_error(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compute the symmetric relative error between two sets of irradiance harmonics, row by row.

    Args:
        a: [I, 9, 3] first harmonics.
        b: [I, 9, 3] second harmonics.

    Returns:
        [I] errors in [0, 1].
    """
    return Measure(a, 0.0).residual(b.reshape(len(b), 27))


class Measure:
    """Measures the error of rows in a few directions."""

    def __init__(self, light: np.ndarray, epsilon: float = EPSILON) -> None:
        self._basis = sh.basis(sh.directions(DIRECTIONS))
        self._truth = self._irradiance(light.reshape(len(light), 27))
        self.size = np.abs(self._truth).mean(axis=(1, 2))
        self.epsilon = max(epsilon * float(self.size.mean()), 1e-30)

    def _irradiance(self, light: np.ndarray) -> np.ndarray:
        """[I, D, 3] of [I, 27]."""
        return np.einsum("dk,ikc->idc", self._basis, light.reshape(-1, 9, 3))

    def residual(self, light: np.ndarray) -> np.ndarray:
        """[I] symmetric relative error."""
        return smape(self._truth, self._irradiance(light), self.epsilon).mean(axis=(1, 2))

    def omega(self, light: np.ndarray) -> np.ndarray:
        """[I] weights of the next pass."""
        found = self._irradiance(light)
        # Relative to the solution, not to the noisy sample: one that is too bright by chance would get a smaller ω.
        d = 2 * np.abs(found).mean(axis=(1, 2)) + self.epsilon
        r = np.abs(self._truth - found).mean(axis=(1, 2))
        return 1 / (d**RELATIVE * np.maximum(r, LEAST_RESIDUAL * d))


def _ties(columns: csc_matrix) -> csc_matrix:
    """[P', P'] overlap of neighbours' weights, 0 on the diagonal; probes on two sides of a wall have none."""
    gram = (columns.T @ columns).tocsr()
    size = np.sqrt(np.maximum(gram.diagonal(), 1e-30))
    overlap = diags(1 / size) @ gram @ diags(1 / size)
    overlap.setdiag(0)
    return overlap.tocsc()


def _weighted(
    columns: csc_matrix, omega: np.ndarray, ties: csc_matrix
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """(right [I, 27], traced light [P', 27]) -> [P', 27] minimiser for given ω."""
    omega = omega / max(float(omega.mean()), 1e-30)
    weighted = diags(omega) @ columns
    gram = (columns.T @ weighted).tocsc()
    diagonal = gram.diagonal()
    # A node without a weight in any row keeps its traced light.
    floor = 1e-6 * max(float(diagonal.max(initial=0)), 1e-30)
    pull = TO_TRACED * diagonal + floor
    root = np.sqrt(diagonal + floor)
    joint = TO_NEIGHBOUR * (diags(root) @ ties @ diags(root))
    laplace = diags(np.asarray(joint.sum(axis=1)).ravel()) - joint
    factors = splu((gram + diags(pull) + laplace).tocsc())
    return lambda right, prior: factors.solve(weighted.T @ right + pull[:, None] * prior)
