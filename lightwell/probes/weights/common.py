"""What weight functions share: clip, threshold, loss of a fit. Notation: B probes, Q points, C parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lightwell.probes.pattern import Pattern

# Trust below this is none: residual leak is cut off before normalisation can amplify it.
THRESHOLD = 0.02
# A fit weighs points that must get nothing this much: what is lost on the right side of a wall, the division by Z gives
# back; what leaks is multiplied by the contrast (5 cm wall, contrast 1000: bright leak 0.89 at 4, 0.20 at 1000).
LEAK_WEIGHT = 1000.0
# ... and points inside of geometry, which are never asked, this much.
INSIDE_WEIGHT = 0.02
# Slope of the clip outside [0, 1] while fitting, or gradients die.
LEAK = 0.02


@dataclass(frozen=True)
class Close:
    """Points right at surfaces, each probe its own: a wall must stop light at its face, not at the next point."""

    u: np.ndarray
    """[B, X, 3] probe-local places."""
    target: np.ndarray
    """[B, X] ρ there."""
    weight: np.ndarray
    """[B, X]; 0 for rows that are not used."""

    def part(self, rows: slice, size: int) -> Close:
        """Some probes, brought to ``size``."""
        return Close(*padded(size, self.u[rows], self.target[rows], self.weight[rows]))


# A fit of weight functions: ``target`` [B, Q], ``weight`` [B, Q], pattern and places at surfaces → parameters [B, C].
Fit = Callable[[np.ndarray, np.ndarray, Pattern, Close | None], np.ndarray]


def padded(size: int, *arrays: np.ndarray) -> list[np.ndarray]:
    """Arrays [B ≤ size, ...] with B brought to ``size`` by rows of ones: products of matrices of one shape give every
    row the same bits, whoever stands beside it."""
    return [
        np.concatenate([a, np.ones((size - len(a), *a.shape[1:]), a.dtype)]) if len(a) < size else a for a in arrays
    ]


class WeightFunction(Protocol):
    """One way to write down ρ(u) of a probe in a few numbers."""

    name: str
    parameters: int
    """C."""
    stored: int
    """Bytes of a record."""

    def raw(self, params: np.ndarray, u: np.ndarray) -> np.ndarray:
        """[N] value before the clip, of parameters [N, C] at probe-local places [N, 3]."""

    def fit(self, target: np.ndarray, weight: np.ndarray, layout, close: Close | None = None) -> np.ndarray:
        """[B, C] parameters for targets ρ [B, Q] at the points of the pattern, weighed by ``point_weight`` [B, Q], and
        for places at surfaces."""

    def values(self, params: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, object]:
        """[B, Q] values before the clip at shared places [Q, 3] or at each probe's own [B, Q, 3], and what ``gradient``
        needs."""

    def gradient(self, state: object, slope: np.ndarray) -> np.ndarray:
        """[B, C] from the derivative of the loss by each value [B, Q]."""

    def quantised(self, params: np.ndarray) -> np.ndarray:
        """[B, C] parameters as they are stored."""


def trusted(raw: np.ndarray) -> np.ndarray:
    """ρ in [0, 1] of a raw value: clipped, then the threshold taken off."""
    return np.clip((np.clip(raw, 0, 1) - THRESHOLD) / (1 - THRESHOLD), 0, None)


def point_weight(target: np.ndarray, hat: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """[B, Q] float32 weight of each point in a fit; ``valid`` [B, Q]: points that lie in air."""
    weight = np.where(target > 0, np.float32(1), np.float32(LEAK_WEIGHT))
    return hat.astype(np.float32) ** 2 * np.where(valid, weight, np.float32(INSIDE_WEIGHT))


def error(target: np.ndarray, rho: np.ndarray, hat: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """[B] root mean square of hat · (ρ̂ - ρ) over the points in air."""
    squares = np.where(valid, (hat * (rho - target)) ** 2, 0)
    return np.sqrt(squares.sum(axis=1) / np.maximum(valid.sum(axis=1), 1))


def leak(target: np.ndarray, rho: np.ndarray, hat: np.ndarray, valid: np.ndarray) -> float:
    """Predicted over trilinear weight where the true one is 0."""
    dark = (target == 0) & valid
    return float((hat * rho)[dark].sum() / np.maximum(np.broadcast_to(hat, rho.shape)[dark].sum(), 1e-12))


def under(target: np.ndarray, rho: np.ndarray, hat: np.ndarray) -> float:
    """Share of weight lost where the probe sees the point."""
    seen = target == 1
    lost = (hat * np.maximum(1 - rho, 0))[seen].sum()
    return float(lost / np.maximum(np.broadcast_to(hat, rho.shape)[seen].sum(), 1e-12))
