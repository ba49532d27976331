"""From radiance to what a screen shows; the same curve serves the figures and the picture metrics."""

from __future__ import annotations

import numpy as np

# IEC 61966-2-1: the linear toe, the exponent, and the scale of the curve.
SRGB_TOE, SRGB_SLOPE, SRGB_GAMMA, SRGB_A = 0.0031308, 12.92, 2.4, 0.055


def srgb(linear: np.ndarray) -> np.ndarray:
    """sRGB encoding of linear values in [0, 1]."""
    curve = (1 + SRGB_A) * np.maximum(linear, SRGB_TOE) ** (1 / SRGB_GAMMA) - SRGB_A
    return np.where(linear <= SRGB_TOE, SRGB_SLOPE * linear, curve)


def display(radiance: np.ndarray) -> np.ndarray:
    """x / (1 + x), then sRGB: radiance in the unit S to display values in [0, 1). Negative radiance shows as black."""
    x = np.maximum(np.asarray(radiance, np.float64), 0)
    return srgb(x / (1 + x))
