"""Dense point spread functions: the light of one pixel after a lens and an open shutter.

A PSF is an image K [2·hy+1, 2·hx+1], float64, with pixel (0, 0) in the middle and Σ K = 1. Radii and lengths are in
pixels. The joint kernel of a circle of confusion s and a displacement m over a box shutter is
K(d) = ∫ w(t) Ap((d − m(t − ½))/s)/s² dt, which for constant s is the aperture convolved with a segment.
"""

from __future__ import annotations

import numpy as np

from lightwell.lens.aperture import DISC, Aperture

# Samples per pixel and axis of the box filter.
FINE = 8
# Smallest radius that is drawn, pixels: half the width of a pixel.
SMALLEST_RADIUS = 0.5


def _fine_axis(half: int) -> np.ndarray:
    """Return the centres of the ``FINE`` samples of the pixels −half to half."""
    return (np.arange((2 * half + 1) * FINE) + 0.5) / FINE - half - 0.5


def _box(fine: np.ndarray) -> np.ndarray:
    """Average each pixel's ``FINE`` × ``FINE`` samples."""
    h, w = fine.shape[0] // FINE, fine.shape[1] // FINE
    return fine.reshape(h, FINE, w, FINE).mean((1, 3))


def trim(kernel: np.ndarray) -> np.ndarray:
    """Crop an image to the smallest centred window that holds every non-zero value.

    Args:
        kernel: Image [odd, odd], not all zero.

    Returns:
        Image [2·hy+1, 2·hx+1].
    """
    rows, columns = np.nonzero(kernel)
    cy, cx = kernel.shape[0] // 2, kernel.shape[1] // 2
    hy, hx = int(np.abs(rows - cy).max()), int(np.abs(columns - cx).max())
    return kernel[cy - hy : cy + hy + 1, cx - hx : cx + hx + 1]


def _normal(kernel: np.ndarray) -> np.ndarray:
    """Normalise to unit sum, without values that are rounding errors of convolutions."""
    kernel = np.where(kernel > 1e-9 * kernel.max(), kernel, 0.0)
    return trim(kernel / kernel.sum())


def capsule(radius: float, length: float = 0.0) -> np.ndarray:
    """Draw a round aperture that moves along x during a box shutter: chord of the disc, clipped.

    K(a, b) ∝ max(0, min(a + ℓ/2, h) − max(a − ℓ/2, −h)), h = √(r² − b²), a along the motion, b across.

    Args:
        radius: Radius, pixels; at least ``SMALLEST_RADIUS`` is used.
        length: Length of the motion, pixels, ≥ 0.

    Returns:
        Point spread function [2·hy+1, 2·hx+1], sum 1.
    """
    r = max(float(radius), SMALLEST_RADIUS)
    hy, hx = int(np.ceil(r + 0.5)), int(np.ceil(r + length / 2 + 0.5))
    a, b = _fine_axis(hx)[None, :], _fine_axis(hy)[:, None]
    inside = b * b < r * r
    h = np.sqrt(np.maximum(r * r - b * b, 0.0))
    if length <= 0:
        return _normal(_box((a * a + b * b <= r * r).astype(float)))
    overlap = np.minimum(a + length / 2, h) - np.maximum(a - length / 2, -h)
    return _normal(_box(np.where(inside, np.maximum(overlap, 0.0), 0.0)))


def _segment(half: int, length: float, angle: float) -> np.ndarray:
    """Draw a segment of ``length`` px at ``angle`` radians on the fine grid, centred on a sample, unit sum."""
    size = 2 * half * FINE + 1
    count = max(int(np.ceil(length * FINE * 4)), 1)
    t = (np.arange(count) + 0.5) / count - 0.5
    image = np.zeros((size, size))
    x, y = (length * t * f * FINE + half * FINE for f in (np.cos(angle), np.sin(angle)))
    ix, iy = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - ix, y - iy
    for dx, wx in ((0, 1 - fx), (1, fx)):
        for dy, wy in ((0, 1 - fy), (1, fy)):
            np.add.at(image, (np.minimum(iy + dy, size - 1), np.minimum(ix + dx, size - 1)), wx * wy)
    return image / count


def shaped(aperture: Aperture, s: float, length: float = 0.0, angle: float = 0.0) -> np.ndarray:
    """Draw any aperture that moves along a line during a box shutter.

    Args:
        aperture: Shape of the opening.
        s: Signed circle of confusion, pixels; < 0 mirrors the shape.
        length: Length of the motion, pixels, ≥ 0.
        angle: Angle of the motion, radians from x towards y (downwards).

    Returns:
        Point spread function [2·hy+1, 2·hx+1], sum 1.
    """
    r = max(abs(float(s)), SMALLEST_RADIUS)
    sign = -1.0 if s < 0 else 1.0
    half = int(np.ceil(r + length / 2 + 1))
    axis = _fine_axis(half) * sign / r
    fine = aperture(axis[None, :] + 0 * axis[:, None], axis[:, None] + 0 * axis[None, :])
    if fine.sum() <= 0:
        fine = DISC(axis[None, :], axis[:, None])
    if length > 0:
        from scipy.signal import fftconvolve

        fine = np.maximum(fftconvolve(fine, _segment(half, length, angle), mode="same"), 0.0)
    return _normal(_box(fine))


def cats_eye(radius: float, field: float, strength: float) -> np.ndarray:
    """Draw a round aperture cut by the rim of the barrel: two discs, the second one shifted outwards along x.

    Args:
        radius: Radius, pixels.
        field: Distance from the image centre over half the image's diagonal, in [0, 1].
        strength: Shift of the second disc at the corner, in radii, below 2.

    Returns:
        Point spread function [2·hy+1, 2·hx+1], sum 1.
    """
    r = max(float(radius), SMALLEST_RADIUS)
    half = int(np.ceil(r + 0.5))
    x, y = _fine_axis(half)[None, :] / r, _fine_axis(half)[:, None] / r
    shift = strength * field
    both = (x * x + y * y <= 1) & ((x + shift) ** 2 + y * y <= 1)
    return _normal(_box(both.astype(float)))


def charges(kernel: np.ndarray) -> np.ndarray:
    """Compute f = −ΔK = 4K − Σ neighbours: the image whose exact solve is K.

    Args:
        kernel: Image [2·hy+1, 2·hx+1].

    Returns:
        Charges [2·hy+3, 2·hx+3].
    """
    k = np.pad(kernel, 2)
    return 4 * k[1:-1, 1:-1] - k[:-2, 1:-1] - k[2:, 1:-1] - k[1:-1, :-2] - k[1:-1, 2:]


def offsets(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """List the coordinates of the pixels of a centred image.

    Args:
        image: Image [2·hy+1, 2·hx+1].

    Returns:
        Integer x and y of every pixel, same shape, 0 in the middle.
    """
    hy, hx = image.shape[0] // 2, image.shape[1] // 2
    y, x = np.mgrid[-hy : hy + 1, -hx : hx + 1]
    return x, y
