"""Metrics of learned light against a path-traced reference.

Notation: f is the prediction, y the reference, A and B the two independent halves of its paths, y = (A + B) / 2. All
are radiance in the unit S = 4 × mean(y), arrays [..., 3]; a weight has their shape without the channels and makes a
mean area-uniform. Every function raises ``ValueError`` for NaN, infinity and shapes that differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

# The unit S is this multiple of the mean radiance.
MEANS_PER_UNIT = 4.0
# Added to the reference before dividing by it, so that the relative error of black points is finite.
SHADOW = 0.01
# Points of a group of like predicted radiance.
GROUP = 64
# Leak: share of the points, darkest first, that should stay dark.
DARK_SHARE = 0.25
# A mean that is corrected for noise is a measurement from this multiple of its standard error on, and from this share
# of the correction on: below, the curvature of the logarithm or of the display curve over the noise biases it.
SIGNIFICANT, LEAST_SHARE = 2.0, 0.1


@dataclass(frozen=True)
class ErrorSpread:
    """Mean, median and 95th percentile of an error over points."""

    mean: float
    median: float
    p95: float


@dataclass(frozen=True)
class NoiseCorrected:
    """A mean squared error after the variance of the reference has been subtracted."""

    value: float | None
    """The mean, ≥ 0; None: the noise of the reference is larger than what was to be measured."""
    at_most: float
    """Upper bound: the mean plus two standard errors of the noise."""

    @staticmethod
    def of(mean: float, noise: float, standard_error: float) -> NoiseCorrected:
        """Decide whether a corrected mean is a measurement.

        Args:
            mean: Mean squared error, the variance of the reference subtracted; may be negative.
            noise: The variance that was subtracted, ≥ 0.
            standard_error: Standard error of the mean that the noise causes, ≥ 0.

        Returns:
            The mean with its bound.
        """
        margin = SIGNIFICANT * standard_error
        found = mean if mean >= max(margin, LEAST_SHARE * noise) else None
        return NoiseCorrected(found, max(mean, 0.0) + margin)


def unit(reference: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Compute the unit S = 4 × mean radiance of a reference.

    Args:
        reference: Reference radiance [..., 3] in any unit.
        weight: Weights [...], ≥ 0; None: all the same.

    Returns:
        S, in the unit of the reference.

    Raises:
        ValueError: The reference is black.
    """
    (reference,) = checked(reference=reference)
    mean = _mean(reference.mean(axis=-1), weight)
    if mean <= 0:
        raise ValueError("report: the reference is black, so that no relative error exists; is the light on?")
    return MEANS_PER_UNIT * mean


def relative_errors(f: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Compute |f − y| / (y + 0.01), averaged over the channels.

    Args:
        f: Prediction [..., 3].
        y: Reference [..., 3].

    Returns:
        Error of every point [...].
    """
    f, y = checked(prediction=f, reference=y)
    errors: np.ndarray = (np.abs(f - y) / (y + SHADOW)).mean(axis=-1)
    return errors


def relative_error(f: np.ndarray, y: np.ndarray, weight: np.ndarray | None = None) -> ErrorSpread:
    """Compute mean, median and 95th percentile of the relative errors.

    Args:
        f: Prediction [..., 3].
        y: Reference [..., 3].
        weight: Weights [...], ≥ 0; None: all the same.

    Returns:
        The statistics.
    """
    return _spread(relative_errors(f, y), weight)


def noise_floor(a: np.ndarray, b: np.ndarray, weight: np.ndarray | None = None) -> ErrorSpread:
    """Compute the relative error that remains in the reference itself.

    (A − B) / 2 has the same variance as the error of (A + B) / 2, so that a perfect prediction has this error.

    Args:
        a: First half of the reference [..., 3].
        b: Second half of the reference [..., 3].
        weight: Weights [...], ≥ 0; None: all the same.

    Returns:
        The statistics.
    """
    a, b = checked(half_a=a, half_b=b)
    return _spread((np.abs(a - b) / 2 / (0.5 * (a + b) + SHADOW)).mean(axis=-1), weight)


def rel_mse(f: np.ndarray, a: np.ndarray, b: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Compute mean (f − A)(f − B) / (y² + ε²), ε = 0.01: a relative squared error without the noise of the reference.

    Its expectation is that with a noise-free reference, except for noise in the denominator; it can be negative.

    Args:
        f: Prediction [..., 3].
        a: First half of the reference [..., 3].
        b: Second half of the reference [..., 3].
        weight: Weights [...], ≥ 0; None: all the same.

    Returns:
        Relative mean squared error.
    """
    f, a, b = checked(prediction=f, half_a=a, half_b=b)
    y = 0.5 * (a + b)
    return _mean(((f - a) * (f - b) / (y**2 + SHADOW**2)).mean(axis=-1), weight)


def error_without_noise(f: np.ndarray, a: np.ndarray, b: np.ndarray, weight: np.ndarray | None = None) -> float | None:
    """Compute a relative error without the noise of the reference, which ``relative_error`` contains.

    The expectation of (f − A)(f − B) is the squared error against a noise-free reference. It is divided by the square
    of the mean reference + 0.01 of points of like predicted radiance, in which there is little noise. These groups are
    made by f alone, so that the noise of the reference has no part in the choice.

    Args:
        f: Prediction [N, 3].
        a: First half of the reference [N, 3].
        b: Second half of the reference [N, 3].
        weight: Weights [N], ≥ 0; None: all the same.

    Returns:
        Root of the mean, ≥ 0; None where the mean is below two of its standard errors: the reference has too few paths.
    """
    f, a, b = checked(prediction=f, half_a=a, half_b=b)
    weights, squares = weights_of(f[..., 0], weight), np.zeros_like(f)
    for rows in np.array_split(np.argsort(f.mean(axis=-1), kind="stable"), max(len(f) // GROUP, 1)):
        own = weights[rows, None]
        mean = (own * 0.5 * (a[rows] + b[rows])).sum(axis=0) / max(float(own.sum()), 1e-30)
        squares[rows] = (f[rows] - a[rows]) * (f[rows] - b[rows]) / (mean + SHADOW) ** 2
    of_point = squares.mean(axis=-1)
    mean = _mean(of_point, weight)
    standard_error = float(np.sqrt((weights**2 * (of_point - mean) ** 2).sum())) / float(weights.sum())
    return float(np.sqrt(mean)) if mean > 0 and mean >= SIGNIFICANT * standard_error else None


def energy_ratio(f: np.ndarray, y: np.ndarray, weight: np.ndarray | None = None) -> float | None:
    """Compute mean(f) / mean(y): 1 when no light is lost or added on average.

    Args:
        f: Prediction [..., 3].
        y: Reference [..., 3].
        weight: Weights [...], ≥ 0; None: all the same.

    Returns:
        The ratio; None where the reference is black.
    """
    f, y = checked(prediction=f, reference=y)
    denominator = _mean(y.mean(axis=-1), weight)
    if denominator <= 0:
        return None
    return _mean(f.mean(axis=-1), weight) / denominator


def leak(f: np.ndarray, a: np.ndarray, b: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Compute |mean learned − mean reference| on the darkest quarter of the points, over the mean of all points.

    Light that is missing counts like light that is added. The darkest points are chosen by half A and compared with
    half B, so that the choice is independent of the noise of what it is compared with.

    Args:
        f: Prediction [..., 3].
        a: First half of the reference [..., 3].
        b: Second half of the reference [..., 3].
        weight: Weights [...], ≥ 0; None: all the same.

    Returns:
        The ratio, ≥ 0.

    Raises:
        ValueError: The reference is black.
    """
    f, a, b = checked(prediction=f, half_a=a, half_b=b)
    weights = weights_of(f[..., 0], weight)
    everywhere = float(np.average(0.5 * (a + b).mean(axis=-1).reshape(-1), weights=weights))
    if everywhere <= 0:
        raise ValueError("report: the reference is black, so that no leak exists; is the light on?")
    dark = _darkest(a, weights)
    if not dark.size:
        return 0.0
    by_b, by_f = (x.mean(axis=-1).reshape(-1)[dark] for x in (b, f))
    return abs(float(np.average(by_f - by_b, weights=weights[dark]))) / everywhere


def leak_noise(a: np.ndarray, b: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Compute the standard error of ``leak`` that the noise of the reference causes.

    One bright path in half B at a dark point may be all of the leak. Where both halves are as noisy, B − A has twice
    the variance of B, less what the choice of the points by A takes of it: the result is at most √2 times too large.

    Args:
        a: First half of the reference [..., 3].
        b: Second half of the reference [..., 3].
        weight: Weights [...], ≥ 0; None: all the same.

    Returns:
        The standard error, ≥ 0; 0 where the reference is black.
    """
    a, b = checked(half_a=a, half_b=b)
    weights = weights_of(a[..., 0], weight)
    everywhere = float(np.average(0.5 * (a + b).mean(axis=-1).reshape(-1), weights=weights))
    dark = _darkest(a, weights)
    if everywhere <= 0 or not dark.size:
        return 0.0
    noise = (weights * (b - a).mean(axis=-1).reshape(-1))[dark]
    return float(np.sqrt(np.square(noise).sum()) / weights[dark].sum()) / everywhere


def _darkest(a: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Indices of the darkest points of a half [..., 3]: ``DARK_SHARE`` of the weights [N]."""
    order = np.argsort(a.mean(axis=-1).reshape(-1), kind="stable")
    return order[np.cumsum(weights[order]) <= DARK_SHARE * weights.sum()]


def per_object(
    f: np.ndarray,
    a: np.ndarray,
    b: np.ndarray,
    shape: np.ndarray,
    names: Sequence[str],
    weight: np.ndarray | None = None,
) -> list[dict[str, Any]]:
    """Compute the errors of each object.

    Args:
        f: Prediction [N, 3].
        a: First half of the reference [N, 3].
        b: Second half of the reference [N, 3].
        shape: Index of the object of every point [N], into ``names``.
        names: Names of the objects.
        weight: Weights [N], ≥ 0; None: all the same.

    Returns:
        One entry per object with points: name, points, relative_error, noise_floor, energy_ratio (None if black).
    """
    rows = []
    y = 0.5 * (a + b)
    for index in np.unique(shape):
        at = shape == index
        w = None if weight is None else weight[at]
        rows.append(
            {
                "name": names[int(index)],
                "points": int(at.sum()),
                "relative_error": relative_error(f[at], y[at], w).mean,
                "noise_floor": noise_floor(a[at], b[at], w).mean,
                "energy_ratio": energy_ratio(f[at], y[at], w),
            }
        )
    return rows


def checked(**arrays: np.ndarray) -> list[np.ndarray]:
    """Check that arrays belong together.

    Args:
        **arrays: Arrays [..., 3] by the names that messages use.

    Returns:
        The arrays as float64.

    Raises:
        ValueError: Shapes differ or are not [..., 3] with at least one point, or a number is NaN or infinite.
    """
    checked = {name: np.asarray(array, np.float64) for name, array in arrays.items()}
    shapes = {name: array.shape for name, array in checked.items()}
    if len(set(shapes.values())) > 1:
        raise ValueError(f"report: shapes differ: {shapes}")
    for name, array in checked.items():
        if array.size == 0 or array.shape[-1] != 3:
            raise ValueError(f"report: {name} has shape {array.shape}, expected [..., 3] with at least one point")
        bad = int((~np.isfinite(array)).sum())
        if bad:
            raise ValueError(f"report: {name} contains {bad} NaN or infinite values of {array.size}; nothing is scored")
    return list(checked.values())


def weights_of(values: np.ndarray, weight: np.ndarray | None) -> np.ndarray:
    """Check weights.

    Args:
        values: What is weighted, [...] N numbers in all.
        weight: Weights [...], ≥ 0; None: all the same.

    Returns:
        Weights [N] float64.

    Raises:
        ValueError: There are not N weights, one is negative or not finite, or all are 0.
    """
    if weight is None:
        return np.ones(values.size)
    weight = np.asarray(weight, np.float64).reshape(-1)
    if weight.size != values.size or not np.isfinite(weight).all() or weight.min() < 0 or weight.sum() <= 0:
        raise ValueError(f"report: weights must be {values.size} finite non-negative numbers, not all 0")
    return weight


def _mean(values: np.ndarray, weight: np.ndarray | None) -> float:
    return float(np.average(values.reshape(-1), weights=weights_of(values, weight)))


def _spread(values: np.ndarray, weight: np.ndarray | None) -> ErrorSpread:
    return ErrorSpread(_mean(values, weight), _quantile(values, weight, 0.5), _quantile(values, weight, 0.95))


def _quantile(values: np.ndarray, weight: np.ndarray | None, fraction: float) -> float:
    """Return the smallest value below which at least ``fraction`` of the weight lies."""
    order = np.argsort(values.reshape(-1))
    cumulative = np.cumsum(weights_of(values, weight)[order])
    index = np.searchsorted(cumulative, fraction * cumulative[-1] * (1 - 1e-12))
    return float(values.reshape(-1)[order[min(index, len(order) - 1)]])
