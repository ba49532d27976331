"""Metrics of displayed pictures: learned light against a path-traced reference, through one display transform.

Notation as in ``lightwell.report.metrics``; pictures are [height, width, 3] radiance in the exposure unit of their view
(``exposure_unit`` of the reference), which ``lightwell.core.color.display`` maps to display values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import flip_evaluator
import numpy as np
from skimage.metrics import structural_similarity

from lightwell.core.color import display
from lightwell.report.metrics import MEANS_PER_UNIT, SHADOW, NoiseCorrected, checked

# PSNR of identical pictures, decibels; far above what 8 bits can show (about 59 dB).
MAX_PSNR_DB = 100.0
# Width of the Gaussian of SSIM, pixels, and the window that it needs (Wang et al. 2004).
SSIM_SIGMA = 1.5
SSIM_WINDOW = 11
# Exposure: brighter pixels are clamped to this percentile of the picture.
HIGHLIGHT_PERCENTILE = 99.0
# Noise-free PSNR: single paths brighter than so many times the denoised reference (plus ``SHADOW``) are cut, because a
# few of them would hide the error of a whole picture; and the least step of a slope, relative to the radiance.
SPIKE, SECANT = 8.0, 1e-4
# Side of the tiles in which the worst places are searched, pixels.
TILE = 16


def psnr_db(f: np.ndarray, y: np.ndarray) -> float:
    """Compute the peak signal-to-noise ratio of displayed pictures.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].

    Returns:
        Decibels, at most ``MAX_PSNR_DB``.
    """
    f, y = checked(prediction=f, reference=y)
    error = float(np.mean((display(f) - display(y)) ** 2))
    return _decibels(error)


def psnr_ceiling_db(a: np.ndarray, b: np.ndarray) -> float:
    """Compute the PSNR that a perfect prediction would have against the noisy reference (A + B) / 2.

    A quarter of the mean squared difference of the displayed halves is the variance of the displayed mean.

    Args:
        a: First half of the reference [height, width, 3].
        b: Second half of the reference [height, width, 3].

    Returns:
        Decibels, at most ``MAX_PSNR_DB``.
    """
    a, b = checked(half_a=a, half_b=b)
    variance = float(np.mean((display(a) - display(b)) ** 2)) / 4
    return _decibels(variance)


@dataclass(frozen=True)
class NoiseFreePsnr:
    """PSNR without the noise of the reference."""

    db: float
    """Decibels, at most ``MAX_PSNR_DB``."""
    is_lower_bound: bool
    """The noise of the reference is larger than the error: the value is the least that is certain."""


def psnr_noise_free(f: np.ndarray, a: np.ndarray, b: np.ndarray, clean: np.ndarray | None = None) -> NoiseFreePsnr:
    """Compute the PSNR of displayed pictures without the noise of the reference.

    The mean of (f − A)(f − B) has the expectation of the squared error against a noise-free reference. The display
    transform is curved, and displayed noisy halves are darker than the displayed mean; so each difference of radiance
    is multiplied by the slope of the transform between the prediction and the denoised reference instead.

    Args:
        f: Prediction [..., 3].
        a: First half of the reference [..., 3].
        b: Second half of the reference [..., 3].
        clean: Reference without noise [..., 3], denoised, for the slope alone; None: the mean of the halves.

    Returns:
        The value, or its lower bound.
    """
    f, a, b = checked(prediction=f, half_a=a, half_b=b)
    clean = np.maximum(0.5 * (a + b) if clean is None else clean, 0)
    slope = _slope(np.maximum(f, 0), clean)
    largest = SPIKE * clean + SHADOW
    a, b = (slope * (np.minimum(half, largest) - f) for half in (a, b))
    # The variance of one half at each pixel; the channels of a pixel share its paths. (A − B)² / 2 has the mean σ² and,
    # for normal noise, the mean square 3 σ⁴; (f − A)(f − B) has at least the variance σ⁴.
    variance = ((a - b) ** 2).mean(axis=-1) / 2
    standard_error = float(np.sqrt((variance**2).mean() / 3 / variance.size))
    error = NoiseCorrected.of(float(np.mean(a * b)), float(variance.mean()) / 2, standard_error)
    if error.value is None:
        return NoiseFreePsnr(_decibels(error.at_most), True)
    return NoiseFreePsnr(_decibels(error.value), False)


def _slope(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Slope of the display transform between two radiances [...]; its derivative where they are equal."""
    step = SECANT * (y + SHADOW)
    far = np.where(np.abs(x - y) < step, y + step, x)
    return (display(far) - display(y)) / (far - y)


def _decibels(error: float) -> float:
    """Convert a mean squared error of display values to decibels."""
    return min(-10 * float(np.log10(error)), MAX_PSNR_DB) if error > 0 else MAX_PSNR_DB


def exposure_unit(reference: np.ndarray) -> float | None:
    """Compute the unit S for exposing a picture: 4 × its mean radiance without black pixels, highlights clamped.

    Args:
        reference: Radiance [..., 3].

    Returns:
        S, in the unit of the radiance; None where the whole picture is black.
    """
    (reference,) = checked(reference=reference)
    luminance = reference.mean(axis=-1).reshape(-1)
    luminance = luminance[luminance > 0]
    if not luminance.size:
        return None
    return MEANS_PER_UNIT * float(np.minimum(luminance, np.percentile(luminance, HIGHLIGHT_PERCENTILE)).mean())


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
    f, y = checked(prediction=f, reference=y)
    if f.ndim != 3 or min(f.shape[:2]) < SSIM_WINDOW:
        raise ValueError(f"report: SSIM needs pictures of at least {SSIM_WINDOW}x{SSIM_WINDOW} pixels, got {f.shape}")
    options = {"gaussian_weights": True, "sigma": SSIM_SIGMA, "use_sample_covariance": False}
    similarity: Callable[..., float] = structural_similarity
    return float(similarity(display(f), display(y), data_range=1.0, channel_axis=-1, **options))


def flip(f: np.ndarray, y: np.ndarray) -> float:
    """Compute the mean LDR-FLIP of displayed pictures at 67 pixels per degree.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].

    Returns:
        Difference in [0, 1].

    Reference: Andersson et al., *FLIP: A Difference Evaluator for Alternating Images*, HPG 2020.
    """
    f, y = checked(prediction=f, reference=y)
    pictures = (np.ascontiguousarray(display(x), np.float32) for x in (y, f))
    return float(flip_evaluator.evaluate(*pictures, "LDR", applyMagma=False)[1])


def flip_of_part(f: np.ndarray, y: np.ndarray, mask: np.ndarray) -> float:
    """Compute the mean LDR-FLIP of displayed pictures over a part of them.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].
        mask: [height, width] bool: the pixels that count, at least one.

    Returns:
        Difference in [0, 1].
    """
    f, y = checked(prediction=f, reference=y)
    pictures = (np.ascontiguousarray(display(x), np.float32) for x in (y, f))
    found = flip_evaluator.evaluate(*pictures, "LDR", applyMagma=False)[0]
    return float(np.reshape(found, mask.shape)[mask].mean())


@dataclass(frozen=True)
class TileError:
    """Error of a square tile of a picture."""

    row: int
    """First row."""
    column: int
    """First column."""
    error: float
    """Mean squared error of display values, the noise of the reference taken off."""


def tile_errors(f: np.ndarray, a: np.ndarray, b: np.ndarray, size: int = TILE) -> Iterator[TileError]:
    """Compute the noise-free squared error of display values in each complete tile of a picture.

    Args:
        f: Prediction [height, width, 3].
        a: First half of the reference [height, width, 3].
        b: Second half of the reference [height, width, 3].
        size: Side of a tile, pixels; a smaller picture is one tile.

    Yields:
        The tiles, row by row.
    """
    f, a, b = (display(x) for x in checked(prediction=f, half_a=a, half_b=b))
    errors = ((f - a) * (f - b)).mean(axis=-1)
    rows, columns = (max(n // size, 1) for n in errors.shape)
    for row in range(0, rows * size, size):
        for column in range(0, columns * size, size):
            yield TileError(row, column, float(errors[row : row + size, column : column + size].mean()))
