"""Shared parts of weight functions: clip, threshold, loss of a fit. Notation: B probes, Q points, C parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lightwell.probes.pattern import Pattern

# Trust below this is 0: residual leaks are removed before normalisation can amplify them.
THRESHOLD = 0.02
# Weight in a fit of points whose target is 0. Weight lost on the right side of a wall is restored by the division by Z,
# but a leak is multiplied by the contrast (5 cm wall, contrast 1000: bright leak 0.89 with weight 4, 0.20 with 1000).
LEAK_WEIGHT = 1000.0
# Weight in a fit of points inside geometry, which are never queried.
INSIDE_WEIGHT = 0.02
# Slope of the clip outside [0, 1] during a fit, so that gradients do not vanish.
LEAK = 0.02


@dataclass(frozen=True)
class Close:
    """Places at surfaces, different for each probe; with them, trust ends at the face of a wall."""

    u: np.ndarray
    """[B, X, 3] probe-local positions in [-1, 1]."""
    target: np.ndarray
    """[B, X] trust ρ."""
    weight: np.ndarray
    """[B, X] weight in a fit; 0 for entries that are not used."""

    def part(self, rows: slice, size: int) -> Close:
        """Return some probes, padded to a fixed number.

        Args:
            rows: Slice of the probes.
            size: Number of probes after padding.

        Returns:
            Places of ``size`` probes.
        """
        return Close(*padded(size, self.u[rows], self.target[rows], self.weight[rows]))


# What ``values`` keeps for ``gradient``.
State = tuple[np.ndarray, ...]
# A fit of weight functions: ``target`` [B, Q], ``weight`` [B, Q], pattern and places at surfaces → parameters [B, C].
Fit = Callable[[np.ndarray, np.ndarray, Pattern, Close | None], np.ndarray]


def padded(size: int, *arrays: np.ndarray) -> list[np.ndarray]:
    """Pad arrays with rows of ones, so that matrix products have one shape.

    With a fixed shape the bits of a row do not depend on the other rows.

    Args:
        size: Length after padding, at least B.
        *arrays: [B, ...] arrays.

    Returns:
        Arrays [size, ...].
    """
    return [
        np.concatenate([a, np.ones((size - len(a), *a.shape[1:]), a.dtype)]) if len(a) < size else a for a in arrays
    ]


class WeightFunction(Protocol):
    """A representation of ρ(u), the trust of a probe in its cube, with few parameters."""

    @property
    def name(self) -> str:
        """Name with its sizes."""

    @property
    def parameters(self) -> int:
        """C, the number of parameters."""

    @property
    def stored(self) -> int:
        """Bytes of a record."""

    def raw(self, params: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Evaluate one probe at one place per row, before the clip.

        Args:
            params: [N, C] parameters.
            u: [N, 3] probe-local positions in [-1, 1].

        Returns:
            [N] values.
        """

    def fit(self, target: np.ndarray, weight: np.ndarray, layout: Pattern, close: Close | None = None) -> np.ndarray:
        """Fit the function to targets.

        Args:
            target: [B, Q] trust ρ at the points of the pattern.
            weight: [B, Q] weights of ``point_weight``.
            layout: The pattern.
            close: Places at surfaces; None for none.

        Returns:
            [B, C] float32 parameters.
        """

    def values(self, params: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, State]:
        """Evaluate probes at many places, before the clip.

        Args:
            params: [B, C] parameters.
            u: [Q, 3] probe-local positions for all probes, or [B, Q, 3] for each.

        Returns:
            [B, Q] values, and the state that ``gradient`` needs.
        """

    def gradient(self, state: State, slope: np.ndarray) -> np.ndarray:
        """Compute the gradient of a loss by the parameters.

        Args:
            state: State of ``values``.
            slope: [B, Q] derivative of the loss by each value.

        Returns:
            [B, C] gradient.
        """

    def bounded(self, params: np.ndarray) -> np.ndarray:
        """Clamp parameters to the range that can be stored.

        Args:
            params: [B, C] parameters.

        Returns:
            [B, C] parameters.
        """

    def quantised(self, params: np.ndarray) -> np.ndarray:
        """Round parameters to those that can be stored.

        Args:
            params: [B, C] parameters.

        Returns:
            [B, C] float32 parameters.
        """


def trusted(raw: np.ndarray) -> np.ndarray:
    """Convert a raw value to trust: clip it to [0, 1], then subtract the threshold and rescale.

    Args:
        raw: [...] values before the clip.

    Returns:
        [...] ρ in [0, 1].
    """
    return np.clip((np.clip(raw, 0, 1) - THRESHOLD) / (1 - THRESHOLD), 0, None)


def point_weight(
    target: np.ndarray, hat: np.ndarray, valid: np.ndarray, cut_off: np.ndarray | None = None
) -> np.ndarray:
    """Compute the weight of each point in a fit.

    Args:
        target: [B, Q] trust ρ.
        hat: [Q] or [B, Q] trilinear weights.
        valid: [B, Q] bool: points that lie in air.
        cut_off: [B, Q] bool: points at which a sheet cuts the probe off, whatever its record says; None: no points.

    Returns:
        [B, Q] float32 weights: the hat's square, times ``LEAK_WEIGHT`` where the target is 0 and no sheet cuts, or
        times ``INSIDE_WEIGHT`` inside geometry.
    """
    weight = np.where(target > 0 if cut_off is None else (target > 0) | cut_off, np.float32(1), np.float32(LEAK_WEIGHT))
    return hat.astype(np.float32) ** 2 * np.where(valid, weight, np.float32(INSIDE_WEIGHT))


def error(target: np.ndarray, rho: np.ndarray, hat: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Compute the error of fitted weights: the root mean square of hat · (ρ̂ - ρ) over the points in air.

    Args:
        target: [B, Q] trust ρ.
        rho: [B, Q] fitted trust ρ̂.
        hat: [Q] or [B, Q] trilinear weights.
        valid: [B, Q] bool: points that lie in air.

    Returns:
        [B] errors.
    """
    squares = np.where(valid, (hat * (rho - target)) ** 2, 0)
    return np.sqrt(squares.sum(axis=1) / np.maximum(valid.sum(axis=1), 1))


def leak(target: np.ndarray, rho: np.ndarray, hat: np.ndarray, valid: np.ndarray) -> float:
    """Compute the fitted weight relative to the trilinear weight at points in air whose target is 0.

    Args:
        target: [B, Q] trust ρ.
        rho: [B, Q] fitted trust.
        hat: [Q] or [B, Q] trilinear weights.
        valid: [B, Q] bool: points that lie in air.

    Returns:
        Leak in [0, 1].
    """
    dark = (target == 0) & valid
    return float((hat * rho)[dark].sum() / np.maximum(np.broadcast_to(hat, rho.shape)[dark].sum(), 1e-12))


def under(target: np.ndarray, rho: np.ndarray, hat: np.ndarray) -> float:
    """Compute the fraction of the weight that is lost at points that the probe sees.

    Args:
        target: [B, Q] trust ρ; 1 at points that the probe sees.
        rho: [B, Q] fitted trust.
        hat: [Q] or [B, Q] trilinear weights.

    Returns:
        Lost fraction in [0, 1].
    """
    seen = target == 1
    lost = (hat * np.maximum(1 - rho, 0))[seen].sum()
    return float(lost / np.maximum(np.broadcast_to(hat, rho.shape)[seen].sum(), 1e-12))
