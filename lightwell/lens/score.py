"""Compare a solved spreadlet with its kernel, on a plane four times its support (exact solve)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len

from lightwell.lens.green import eigenvalues
from lightwell.lens.psf import offsets

# Smallest side of the torus on which a response is computed; it is at least four times the plane.
SMALLEST_SIDE = 192


@dataclass(frozen=True)
class LibraryScore:
    """Errors of one kernel, relative to its mass or norm."""

    error: float
    """Relative L2 distance ‖K̂ − K‖ / ‖K‖ over the plane."""
    leak: float
    """Σ |K̂| outside the support over Σ K."""
    mass: float
    """Σ K̂ / Σ K − 1 within the plane."""
    centroid: float
    """Shift of the centre of mass, pixels."""
    undershoot: float
    """−min K̂ over max K; 0 when nowhere negative."""
    peak: float
    """max |K̂ − K|: the largest error of one unit of light in one pixel."""


def integrate(px: np.ndarray, py: np.ndarray, values: np.ndarray, half: tuple[int, int]) -> np.ndarray:
    """Solve charges exactly on a large torus.

    Args:
        px: Integer x of the points [n], pixels from the centre.
        py: Integer y of the points [n].
        values: Charges [n].
        half: Half height hy and half width hx of the result, pixels.

    Returns:
        Response [2·hy+1, 2·hx+1], with mean 0 far away.
    """
    side = next_fast_len(max(4 * (max(half) + 1), SMALLEST_SIDE), real=True)
    image = np.zeros((side, side))
    np.add.at(image, (np.asarray(py, int) % side, np.asarray(px, int) % side), values)
    values_ = eigenvalues(side, side)[:, : side // 2 + 1].copy()
    values_[0, 0] = 1.0
    spectrum = np.fft.rfft2(image) / values_
    spectrum[0, 0] = 0.0
    plane = np.fft.irfft2(spectrum, s=image.shape)
    far = side // 2
    plane -= plane[far, :].mean()
    rows, columns = (np.arange(-h, h + 1) % side for h in half)
    return plane[np.ix_(rows, columns)]


def score(kernel: np.ndarray, response: np.ndarray) -> LibraryScore:
    """Compare a response with a kernel in its middle.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].
        response: Response [odd, odd], at least as large as the kernel.

    Returns:
        The errors.
    """
    gy, gx = ((response.shape[i] - kernel.shape[i]) // 2 for i in (0, 1))
    k = np.pad(kernel, ((gy, gy), (gx, gx)))
    x, y = offsets(k)
    total = k.sum()
    difference = response - k
    outside = k <= 0
    mass = response.sum()
    shift = [float((difference * axis).sum() / total) for axis in (x, y)]
    return LibraryScore(
        error=float(np.linalg.norm(difference) / np.linalg.norm(k)),
        leak=float(np.abs(response[outside]).sum() / total),
        mass=float(mass / total - 1),
        centroid=float(np.hypot(shift[0], shift[1])),
        undershoot=float(max(0.0, -response.min()) / k.max()),
        peak=float(np.abs(difference).max()),
    )


def plane_of(kernel: np.ndarray) -> tuple[int, int]:
    """Choose the size of a plane four times as wide as a kernel's support.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].

    Returns:
        Half height and half width, pixels.
    """
    reach = max(kernel.shape) // 2
    half_height, half_width = (int(kernel.shape[i] // 2 + 3 * reach + 4) for i in (0, 1))
    return half_height, half_width
