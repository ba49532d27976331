"""Metrics of learned light against a path-traced reference.

Notation: f is the prediction, y the reference, A and B the two independent halves of its paths, y = (A + B) / 2. All
are radiance in the unit S = 4 × mean(y), arrays [..., 3]; a weight has their shape without the channels and makes a
mean area-uniform. Every function raises ``ValueError`` for NaN, infinity and shapes that differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import flip_evaluator
import numpy as np
from scipy.ndimage import distance_transform_edt
from skimage.metrics import structural_similarity

from lightwell.core.color import display

# The unit S is this multiple of the mean radiance.
MEANS_PER_UNIT = 4.0
# Added to the reference before dividing by it, so that the relative error of black points is finite.
SHADOW = 0.01
# PSNR of identical pictures, decibels; far above what 8 bits can show (about 59 dB).
MAX_PSNR_DB = 100.0
# Width of the Gaussian of SSIM, pixels, and the window that it needs (Wang et al. 2004).
SSIM_SIGMA = 1.5
SSIM_WINDOW = 11
# Pixels on each side of a border between regions that belong to it.
BORDER_WIDTH = 3
# Mottle: percentile of the reference that defines "bright", share of it that is added before the logarithm, share of it
# above which a patch is lit, and standard deviation of the log reference up to which a patch is smooth.
BRIGHT_PERCENTILE, MOTTLE_SHADOW, LIT_SHARE, SMOOTH_SPREAD = 95.0, 0.01, 0.05, 0.15
# Leak: share of the points, darkest first, that should stay dark.
DARK_SHARE = 0.25
# Exposure: brighter pixels are clamped to this percentile of the picture.
HIGHLIGHT_PERCENTILE = 99.0


@dataclass(frozen=True)
class ErrorSpread:
    """Mean, median and 95th percentile of an error over points."""

    mean: float
    median: float
    p95: float


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
    (reference,) = _checked(reference=reference)
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
    f, y = _checked(prediction=f, reference=y)
    return (np.abs(f - y) / (y + SHADOW)).mean(axis=-1)


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
    a, b = _checked(half_a=a, half_b=b)
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
    f, a, b = _checked(prediction=f, half_a=a, half_b=b)
    y = 0.5 * (a + b)
    return _mean(((f - a) * (f - b) / (y**2 + SHADOW**2)).mean(axis=-1), weight)


def energy_ratio(f: np.ndarray, y: np.ndarray, weight: np.ndarray | None = None) -> float | None:
    """Compute mean(f) / mean(y): 1 when no light is lost or added on average.

    Args:
        f: Prediction [..., 3].
        y: Reference [..., 3].
        weight: Weights [...], ≥ 0; None: all the same.

    Returns:
        The ratio; None where the reference is black.
    """
    f, y = _checked(prediction=f, reference=y)
    denominator = _mean(y.mean(axis=-1), weight)
    if denominator <= 0:
        return None
    return _mean(f.mean(axis=-1), weight) / denominator


def psnr_db(f: np.ndarray, y: np.ndarray) -> float:
    """Compute the peak signal-to-noise ratio of displayed pictures.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].

    Returns:
        Decibels, at most ``MAX_PSNR_DB``.
    """
    f, y = _checked(prediction=f, reference=y)
    error = float(np.mean((display(f) - display(y)) ** 2))
    return min(-10 * np.log10(error), MAX_PSNR_DB) if error > 0 else MAX_PSNR_DB


def psnr_ceiling_db(a: np.ndarray, b: np.ndarray) -> float:
    """Compute the PSNR that a perfect prediction would have against the noisy reference (A + B) / 2.

    A quarter of the mean squared difference of the displayed halves is the variance of the displayed mean.

    Args:
        a: First half of the reference [height, width, 3].
        b: Second half of the reference [height, width, 3].

    Returns:
        Decibels, at most ``MAX_PSNR_DB``.
    """
    a, b = _checked(half_a=a, half_b=b)
    variance = float(np.mean((display(a) - display(b)) ** 2)) / 4
    return min(-10 * np.log10(variance), MAX_PSNR_DB) if variance > 0 else MAX_PSNR_DB


def psnr_noise_free_db(f: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Compute the PSNR of displayed pictures without the noise of the reference.

    The mean of (f − A)(f − B) over displayed values has the expectation of the squared error against a noise-free
    reference, except for the curvature of the display transform over the noise of a half.

    Args:
        f: Prediction [..., 3].
        a: First half of the reference [..., 3].
        b: Second half of the reference [..., 3].

    Returns:
        Decibels, at most ``MAX_PSNR_DB``.
    """
    f, a, b = (display(x) for x in _checked(prediction=f, half_a=a, half_b=b))
    error = float(np.mean((f - a) * (f - b)))
    return min(-10 * float(np.log10(error)), MAX_PSNR_DB) if error > 0 else MAX_PSNR_DB


def exposure_unit(reference: np.ndarray) -> float | None:
    """Compute the unit S for exposing a picture: 4 × its mean radiance without black pixels, highlights clamped.

    Args:
        reference: Radiance [..., 3].

    Returns:
        S, in the unit of the radiance; None where the whole picture is black.
    """
    (reference,) = _checked(reference=reference)
    luminance = reference.mean(axis=-1).reshape(-1)
    luminance = luminance[luminance > 0]
    if not luminance.size:
        return None
    return MEANS_PER_UNIT * float(np.minimum(luminance, np.percentile(luminance, HIGHLIGHT_PERCENTILE)).mean())


@dataclass(frozen=True)
class Mottle:
    """Blotches: root mean square over patches of the spread of log(learned / reference) within a patch."""

    smooth: float | None
    """Over lit patches whose reference varies little; None where there is none."""
    lit: float | None
    """Over all lit patches; None where there is none."""
    patches: int
    """Number of lit smooth patches."""


def mottle(f: np.ndarray, a: np.ndarray, b: np.ndarray) -> Mottle:
    """Compute the mottle of flat patches under one light.

    With s = 1 % of the 95th percentile of the reference y, it is the variance of log((f + s) / (y + s)) within a patch,
    minus that of the noise of y (a quarter of the variance of log((a + s) / (b + s))). Lit patches have a mean
    reference above 5 % of that percentile; in smooth ones the variance of log(y + s), without noise, is below 0.15².

    Args:
        f: Prediction [P, Q, 3] of P patches of Q points each.
        a: First half of the reference [P, Q, 3].
        b: Second half of the reference [P, Q, 3].

    Returns:
        The mottle of lit smooth patches and of all lit ones.
    """
    f, a, b = (x.mean(axis=-1) for x in _checked(prediction=f, half_a=a, half_b=b))
    y = 0.5 * (a + b)
    bright = float(np.percentile(y, BRIGHT_PERCENTILE))
    if bright <= 0:
        return Mottle(None, None, 0)
    shadow = MOTTLE_SHADOW * bright
    logarithm = lambda x: np.log(np.maximum(x, 0) + shadow)  # noqa: E731
    within = lambda x: np.var(x, axis=1, ddof=1)  # noqa: E731
    noise = within(logarithm(a) - logarithm(b)) / 4
    error = within(logarithm(f) - logarithm(y)) - noise
    lit = y.mean(axis=1) > LIT_SHARE * bright
    smooth = lit & (within(logarithm(y)) - noise < SMOOTH_SPREAD**2)
    root = lambda rows: float(np.sqrt(max(error[rows].mean(), 0.0))) if rows.any() else None  # noqa: E731
    return Mottle(root(smooth), root(lit), int(smooth.sum()))


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
    f, a, b = _checked(prediction=f, half_a=a, half_b=b)
    weights = _weights(f[..., 0], weight)
    everywhere = float(np.average(0.5 * (a + b).mean(axis=-1).reshape(-1), weights=weights))
    if everywhere <= 0:
        raise ValueError("report: the reference is black, so that no leak exists; is the light on?")
    by_a, by_b, by_f = (x.mean(axis=-1).reshape(-1) for x in (a, b, f))
    order = np.argsort(by_a, kind="stable")
    dark = order[np.cumsum(weights[order]) <= DARK_SHARE * weights.sum()]
    if not dark.size:
        return 0.0
    return abs(float(np.average(by_f[dark] - by_b[dark], weights=weights[dark]))) / everywhere


def ssim(f: np.ndarray, y: np.ndarray) -> float:
    """Compute the structural similarity of displayed pictures.

    Args:
        f: Prediction [height, width, 3], at least ``SSIM_WINDOW`` pixels a side.
        y: Reference [height, width, 3].

    Returns:
        Similarity, at most 1.

    Raises:
        ValueError: The pictures are too small.

    Reference: Wang et al., *Image Quality Assessment: From Error Visibility to Structural Similarity*, IEEE TIP 13(4),
        2004.
    """
    f, y = _checked(prediction=f, reference=y)
    if f.ndim != 3 or min(f.shape[:2]) < SSIM_WINDOW:
        raise ValueError(f"report: SSIM needs pictures of at least {SSIM_WINDOW}x{SSIM_WINDOW} pixels, got {f.shape}")
    options = {"gaussian_weights": True, "sigma": SSIM_SIGMA, "use_sample_covariance": False}
    return float(structural_similarity(display(f), display(y), data_range=1.0, channel_axis=-1, **options))


def flip(f: np.ndarray, y: np.ndarray) -> float:
    """Compute the mean LDR-FLIP of displayed pictures at 67 pixels per degree.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].

    Returns:
        Difference in [0, 1].

    Reference: Andersson et al., *FLIP: A Difference Evaluator for Alternating Images*, HPG 2020.
    """
    f, y = _checked(prediction=f, reference=y)
    pictures = (np.ascontiguousarray(display(x), np.float32) for x in (y, f))
    return float(flip_evaluator.evaluate(*pictures, "LDR", applyMagma=False)[1])


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


@dataclass(frozen=True)
class BorderError:
    """Mean relative error near the borders between regions, and away from them."""

    border: float
    interior: float
    share: float
    """Share of the pixels with a surface that are near a border."""

    @property
    def ratio(self) -> float:
        """Border over interior error: 1 when no seam is visible."""
        return self.border / self.interior


def border_band(regions: np.ndarray, width: int = BORDER_WIDTH) -> np.ndarray:
    """Find the pixels near a border between two regions.

    Args:
        regions: Region of every pixel [height, width], integers; negative where there is no surface.
        width: Largest distance from a border, pixels.

    Returns:
        Whether a pixel is near a border [height, width].
    """
    surface = regions >= 0
    edge = np.zeros(regions.shape, bool)
    for here, there in ((np.s_[1:, :], np.s_[:-1, :]), (np.s_[:, 1:], np.s_[:, :-1])):
        differs = (regions[here] != regions[there]) & surface[here] & surface[there]
        edge[here] |= differs
        edge[there] |= differs
    if not edge.any():
        return edge
    return (distance_transform_edt(~edge) < width) & surface


def border_error(f: np.ndarray, y: np.ndarray, regions: np.ndarray) -> BorderError | None:
    """Compute the errors of a picture near and away from borders.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].
        regions: Region of every pixel [height, width], integers; negative where there is no surface.

    Returns:
        The errors; None unless there are pixels of both kinds.
    """
    errors, band = relative_errors(f, y), border_band(regions)
    interior = (regions >= 0) & ~band
    if not band.any() or not interior.any() or not errors[interior].mean() > 0:
        return None
    share = band.sum() / (band.sum() + interior.sum())
    return BorderError(float(errors[band].mean()), float(errors[interior].mean()), float(share))


def worst_tile(f: np.ndarray, y: np.ndarray, size: int = 16) -> tuple[int, int, float]:
    """Find the square tile with the largest mean relative error.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].
        size: Side of a tile, pixels.

    Returns:
        First row and first column of the tile, and its error.
    """
    errors = relative_errors(f, y)
    rows, columns = (max(n // size, 1) for n in errors.shape)
    means = {
        (r * size, c * size): float(errors[r * size : (r + 1) * size, c * size : (c + 1) * size].mean())
        for r in range(rows)
        for c in range(columns)
    }
    (row, column), error = max(means.items(), key=lambda item: item[1])
    return row, column, error


def _checked(**arrays: np.ndarray) -> list[np.ndarray]:
    """Return the arrays as float64, all of one shape [..., 3], finite and not empty."""
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


def _weights(values: np.ndarray, weight: np.ndarray | None) -> np.ndarray:
    """Return weights [N], all ones when None."""
    if weight is None:
        return np.ones(values.size)
    weight = np.asarray(weight, np.float64).reshape(-1)
    if weight.size != values.size or not np.isfinite(weight).all() or weight.min() < 0 or weight.sum() <= 0:
        raise ValueError(f"report: weights must be {values.size} finite non-negative numbers, not all 0")
    return weight


def _mean(values: np.ndarray, weight: np.ndarray | None) -> float:
    return float(np.average(values.reshape(-1), weights=_weights(values, weight)))


def _spread(values: np.ndarray, weight: np.ndarray | None) -> ErrorSpread:
    return ErrorSpread(_mean(values, weight), _quantile(values, weight, 0.5), _quantile(values, weight, 0.95))


def _quantile(values: np.ndarray, weight: np.ndarray | None, fraction: float) -> float:
    """Return the smallest value below which at least ``fraction`` of the weight lies."""
    order = np.argsort(values.reshape(-1))
    cumulative = np.cumsum(_weights(values, weight)[order])
    index = np.searchsorted(cumulative, fraction * cumulative[-1] * (1 - 1e-12))
    return float(values.reshape(-1)[order[min(index, len(order) - 1)]])
