"""Path-traced pictures as a page carries them: steps of 0.5 %, predicted from their neighbours, gzip-compressed."""

from __future__ import annotations

import gzip

import numpy as np

# Brighter pixels are clipped to the largest finite half float, because the page draws half floats.
MAX_HALF = 65504.0
# Steps in a factor of two: one is 0.54 %, the error at most 0.27 %. A step of 8-bit sRGB is 0.8 % or more.
STEPS = 128
# Share of the geometric mean of a picture below which the steps are even instead of relative, and its least value.
DARK_SHARE, LEAST_DARK = 1 / 16, 1e-9


def dark_radiance(picture: np.ndarray) -> float:
    """Find the radiance below which the steps of a picture are even.

    Args:
        picture: [height, width, 3] radiance.

    Returns:
        Radiance > 0 of at most 5 significant digits. It follows the geometric mean, which a lamp in view hardly moves.
    """
    lit = np.clip(picture[picture > LEAST_DARK], 0, MAX_HALF).astype(np.float64)
    mean = float(np.exp(np.mean(np.log(lit)))) if lit.size else 1.0
    return float(f"{max(mean * DARK_SHARE, LEAST_DARK):.5g}")


def pack_picture(picture: np.ndarray, dark: float) -> bytes:
    """Compress a picture (format/FORMAT.md, "The page data").

    Args:
        picture: [height, width, 3] radiance, first row at the top; negative values become 0.
        dark: Radiance below which the steps are even, > 0.

    Returns:
        gzip of the high bytes of all remainders, then of the low bytes. The same picture gives the same bytes.
    """
    radiance = np.clip(picture, 0, MAX_HALF).astype(np.float64)
    codes = np.round(STEPS * np.log2(1 + radiance / dark)).astype(np.int32)
    red, green, blue = np.moveaxis(codes, -1, 0)
    planes = np.stack([green, red - green, blue - green])
    left, above, corner = np.zeros((3, *planes.shape), np.int32)
    left[:, :, 1:], above[:, 1:], corner[:, 1:, 1:] = planes[:, :, :-1], planes[:, :-1], planes[:, :-1, :-1]
    # The median of left, above and their plane: the predictor of JPEG-LS (ITU-T T.87, A.4.1).
    low, high = np.minimum(left, above), np.maximum(left, above)
    rest = planes - np.clip(left + above - corner, low, high)
    # Small numbers of either sign become small unsigned ones: 0, -1, 1, -2, … as 0, 1, 2, 3, …
    folded = ((rest << 1) ^ (rest >> 31)).astype(np.uint16)
    # mtime=0: no date in the bytes.
    return gzip.compress(np.stack([folded >> 8, folded & 255]).astype(np.uint8).tobytes(), compresslevel=9, mtime=0)
