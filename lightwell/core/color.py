"""Colours: sRGB, luminance, exposure and the tone curves; every other module uses these."""

from __future__ import annotations

import numpy as np

# Logarithmic mean of radiance after exposure: middle grey.
MIDDLE_GREY = 0.18
# Luminance of linear sRGB (ITU-R BT.709).
LUMINANCE = (0.2126, 0.7152, 0.0722)
# IEC 61966-2-1: the linear toe, the exponent, and the scale of the curve.
SRGB_TOE, SRGB_SLOPE, SRGB_GAMMA, SRGB_A = 0.0031308, 12.92, 2.4, 0.055
# The toe in encoded values.
SRGB_CODE_TOE = 0.04045
# Radiance that the picture curve maps to white; it changes middle tones little.
WHITE = 4.0
# Darker pixels are left out of the exposure.
BLACK = 1e-6


def srgb(linear: np.ndarray) -> np.ndarray:
    """Encode linear values as sRGB (IEC 61966-2-1).

    Args:
        linear: [...] linear values in [0, 1].

    Returns:
        [...] encoded values in [0, 1].
    """
    curve = (1 + SRGB_A) * np.maximum(linear, SRGB_TOE) ** (1 / SRGB_GAMMA) - SRGB_A
    return np.where(linear <= SRGB_TOE, SRGB_SLOPE * linear, curve)


def linear(encoded: np.ndarray) -> np.ndarray:
    """Decode sRGB values (IEC 61966-2-1).

    Args:
        encoded: [...] encoded values in [0, 1].

    Returns:
        [...] linear values in [0, 1].
    """
    curve = ((encoded + SRGB_A) / (1 + SRGB_A)) ** SRGB_GAMMA
    return np.where(encoded <= SRGB_CODE_TOE, encoded / SRGB_SLOPE, curve)


def srgb_bytes(values: np.ndarray) -> np.ndarray:
    """Encode linear values as sRGB bytes.

    Args:
        values: [...] linear values, clamped to [0, 1].

    Returns:
        [...] uint8.
    """
    return (srgb(np.clip(values, 0, 1)) * 255 + 0.5).astype(np.uint8)


def display(radiance: np.ndarray) -> np.ndarray:
    """Map radiance to display values by x / (1 + x), then sRGB: the curve of figures and of image metrics.

    Args:
        radiance: [...] radiance in units of the exposure S; negative values become black.

    Returns:
        [...] float64 in [0, 1).
    """
    x = np.maximum(np.asarray(radiance, np.float64), 0)
    return srgb(x / (1 + x))


def picture_bytes(radiance: np.ndarray) -> np.ndarray:
    """Tone-map exposed radiance by x (1 + x / w²) / (1 + x) with w = ``WHITE`` (Reinhard et al. 2002).

    Args:
        radiance: [...] exposed linear radiance, ≥ 0.

    Returns:
        [...] uint8 sRGB codes.
    """
    return srgb_bytes(np.nan_to_num(radiance * (1 + radiance / WHITE**2) / (1 + radiance)))


def automatic_exposure(picture: np.ndarray) -> float:
    """Compute the exposure that brings the logarithmic mean of a picture to middle grey.

    Args:
        picture: [H, W, 3] linear radiance.

    Returns:
        Factor on the radiance; 1 for a black picture.
    """
    lit = picture.mean(axis=-1)
    lit = lit[lit > BLACK]
    return float(MIDDLE_GREY / np.exp(np.mean(np.log(lit)))) if len(lit) else 1.0
