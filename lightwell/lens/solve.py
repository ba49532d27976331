"""Solve for the picture: the inverse of 4K − Σ neighbours, exactly, in O(n log n).

``dst`` has zeros on the outer edges of the border pixels; ``fft`` is periodic and has no mean. The low moments of
spreadlets are zero, so that both agree a few pixels away from the border.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy.fft

from lightwell.lens.green import eigenvalues


def smooth_size(n: int) -> int:
    """Find the next size whose transforms are fast, without large prime factors.

    Args:
        n: Smallest size, ≥ 1.

    Returns:
        Size ≥ n.
    """
    return scipy.fft.next_fast_len(n, real=True)


@lru_cache(maxsize=8)
def _sine_eigenvalues(height: int, width: int, kind: str) -> np.ndarray:
    """Compute λ = 4 − 2cos(πi/H) − 2cos(πj/W), i and j from 1, of the sine transform of the second type."""
    rows, columns = (4 * np.sin(np.pi * np.arange(1, n + 1) / (2 * n)) ** 2 for n in (height, width))
    return (rows[:, None] + columns[None, :]).astype(kind)


def dst(charges: np.ndarray, workers: int = -1) -> np.ndarray:
    """Solve with a picture that is odd about its outer edges, by two sine transforms, in the precision of the input.

    The transform of the second type takes half the time of the first, whose zeros lie on the next pixels outside.

    Args:
        charges: Charges [..., height, width].
        workers: Threads; −1 for all cores.

    Returns:
        Picture, same shape.
    """
    axes = (-2, -1)
    spectrum = scipy.fft.dstn(charges, type=2, axes=axes, workers=workers)
    spectrum /= _sine_eigenvalues(*charges.shape[-2:], spectrum.dtype.name)
    return scipy.fft.idstn(spectrum, type=2, axes=axes, workers=workers, overwrite_x=True)


def fft(charges: np.ndarray, workers: int = -1) -> np.ndarray:
    """Solve on a torus; the mean of the outermost ring is subtracted from the result.

    Args:
        charges: Charges [..., height, width].
        workers: Threads; None or 1 for one, −1 for all cores.

    Returns:
        Picture, same shape.
    """
    height, width = charges.shape[-2:]
    values = eigenvalues(height, width)[:, : width // 2 + 1].astype(charges.dtype)
    values[0, 0] = 1
    spectrum = scipy.fft.rfft2(charges, workers=workers)
    spectrum /= values
    spectrum[..., 0, 0] = 0
    plane = scipy.fft.irfft2(spectrum, s=(height, width), workers=workers)
    ring = np.concatenate([plane[..., 0, :], plane[..., -1, :], plane[..., 0], plane[..., -1]], -1)
    return plane - ring.mean(-1)[..., None, None]
