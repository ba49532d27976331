"""Low rank of the light of many states at probes, by the relative error at each probe in each state.

    min over f, V   Σ_s Σ_p w_sp ‖L_sp - Σ_k f_sk V_kp‖²,   w_sp = 1 / (‖L_sp‖ + ε size_s)²

with size_s the mean of ‖L_sp‖ over the probes.

The singular vectors alone serve the few probes beside which a lamp stands: their light is the greatest by orders of
magnitude, and elsewhere a large share is lost. Weights that belong to both state and probe have no closed form: states
and probes are solved for in turn (alternating least squares; Gabriel and Zamir 1979), from the singular vectors.

Notation: S states, P probes, K bases; L_sp has 27 numbers, f are the factors, V the bases.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUNDS = 6
# ε: probes darker than this share of the mean of their state count less: where a lamp does not reach.
DARK = 0.05
# Regularisation of the small systems, relative to their trace.
RIDGE = 1e-9


@dataclass(frozen=True)
class LowRank:
    """Factors of K bases in S states."""

    factors: np.ndarray
    """[S, K] float64. They are white: the bases of a probe then hold no more than its light, and bytes suffice."""
    level: float
    """Mean light of a state whose factors have the norm √K."""

    @staticmethod
    def of(states: np.ndarray, live: np.ndarray, rank: int) -> LowRank:
        """Find the factors of the best bases.

        Args:
            states: [S, P, 9, 3] light of the states.
            live: [P] bool or int indices of the probes that count.
            rank: Most bases K.

        Returns:
            The factors.
        """
        light = states[:, live].reshape(len(states), -1, 27).astype(np.float64)
        mean = np.linalg.norm(light, axis=2).mean(axis=1)
        weight = _weights(light, mean)
        scaled = (light / np.maximum(np.linalg.norm(light, axis=(1, 2)), 1e-30)[:, None, None]).reshape(len(light), -1)
        u, s, _ = np.linalg.svd(scaled @ scaled.T)
        k = max(int(min(rank, (s > 1e-12 * max(s[0], 1e-30)).sum())), 1)
        factors = u[:, :k] * np.linalg.norm(light, axis=(1, 2))[:, None]
        for _ in range(ROUNDS):
            factors = _white(_factors(light, weight, _bases(light, weight, factors)), mean)
        level = float(np.median(mean[mean > 0])) if mean.any() else 1.0
        return LowRank(factors / level, level)

    def is_of(self, states: int) -> bool:
        """Check factors that were read from a file.

        Args:
            states: S that is expected.

        Returns:
            Whether there are so many states, of a possible number of finite factors.
        """
        f = self.factors
        good = f.ndim == 2 and len(f) == states and 0 < f.shape[1] <= 64 and bool(np.isfinite(f).all())
        return good and 0 < self.level < 1e30

    def bases(self, states: np.ndarray) -> np.ndarray:
        """Compute the bases that give states best by their factors. A probe's bytes depend on its own light alone.

        Args:
            states: [S, P, 9, 3] light of the states.

        Returns:
            [P, 9, 3, K] float32 bases.
        """
        light, rank = states.reshape(len(states), -1, 27).astype(np.float64), self.factors.shape[1]
        mean = self.level * np.linalg.norm(self.factors, axis=1) / rank**0.5
        found = _bases(light, _weights(light, mean), self.factors)
        return np.ascontiguousarray(np.moveaxis(found, 1, 2).reshape(-1, 9, 3, rank), np.float32)


def _weights(light: np.ndarray, size: np.ndarray) -> np.ndarray:
    """[S, P] w; 0 in states without any light."""
    w = np.linalg.norm(light, axis=2) + DARK * size[:, None]
    return np.divide(1, np.square(w), out=np.zeros_like(w), where=w > 1e-30)


def _bases(light: np.ndarray, weight: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """[P, K, 27] bases; states are added one by one, so that no probe depends on how many there are."""
    count, k = light.shape[1], factors.shape[1]
    system, right = np.zeros((count, k, k)), np.zeros((count, k, 27))
    for own, w, f in zip(light, weight, factors):
        system += w[:, None, None] * np.outer(f, f)
        right += (w[:, None, None] * f[:, None]) * own[:, None]
    return _solved(system, right)


def _factors(light: np.ndarray, weight: np.ndarray, bases: np.ndarray) -> np.ndarray:
    """[S, K] factors."""
    count, k = bases.shape[:2]
    system = (weight @ (bases @ bases.swapaxes(1, 2)).reshape(count, -1)).reshape(-1, k, k)
    right = np.stack([np.einsum("p,pkj,pj->k", w, bases, own, optimize=True) for own, w in zip(light, weight)])
    return _solved(system, right[..., None])[..., 0]


def _solved(system: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions of small regularised systems; 0 where there is nothing."""
    k = system.shape[-1]
    trace = np.trace(system, axis1=1, axis2=2)
    diagonal = np.where(trace > 0, RIDGE * trace, 1.0)
    return np.linalg.solve(system + diagonal[:, None, None] * np.eye(k), right)


def _white(factors: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Factors of the same space that, relative to the light of their state, have variance 1 and no correlation."""
    relative = factors[mean > 0] / mean[mean > 0, None]
    values, vectors = np.linalg.eigh(relative.T @ relative / max(len(relative), 1))
    return factors @ vectors / np.sqrt(np.maximum(values, 1e-12 * max(float(values.max()), 1e-30)))
