"""From charges to the picture: the inverse of 4K − Σ neighbours, exactly and in linear time (up to a logarithm).

``dst`` has zeros on the outer edges of the border pixels, ``fft`` a torus and no mean; spreadlets have no low moments,
so that both agree a few pixels away from the border.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy.fft

from lightwell.lens.green import eigenvalues


def smooth_size(n: int) -> int:
    """The next size >= n whose transforms are fast: without large primes."""
    return scipy.fft.next_fast_len(n, real=True)


@lru_cache(maxsize=8)
def _sine_eigenvalues(height: int, width: int, kind: str) -> np.ndarray:
    """λ = 4 − 2cos(πi/H) − 2cos(πj/W), i and j from 1: of the sine transform of the second type."""
    rows, columns = (4 * np.sin(np.pi * np.arange(1, n + 1) / (2 * n)) ** 2 for n in (height, width))
    return (rows[:, None] + columns[None, :]).astype(kind)


def dst(charges: np.ndarray, workers: int = -1) -> np.ndarray:
    """Solve [..., height, width] with a picture that is odd about its outer edges, by two sine transforms.

    Keeps the precision given. The transform of the second type needs half the time of the first, whose zeros lie on
    the next pixels outside.
    """
    axes = (-2, -1)
    spectrum = scipy.fft.dstn(charges, type=2, axes=axes, workers=workers)
    spectrum /= _sine_eigenvalues(*charges.shape[-2:], spectrum.dtype.name)
    return scipy.fft.idstn(spectrum, type=2, axes=axes, workers=workers, overwrite_x=True)


def fft(charges: np.ndarray, workers: int = -1) -> np.ndarray:
    """Solve [..., height, width] on a torus, mean removed, then the mean of the outermost ring taken away."""
    height, width = charges.shape[-2:]
    values = eigenvalues(height, width)[:, : width // 2 + 1].astype(charges.dtype)
    values[0, 0] = 1
    spectrum = scipy.fft.rfft2(charges, workers=workers)
    spectrum /= values
    spectrum[..., 0, 0] = 0
    plane = scipy.fft.irfft2(spectrum, s=(height, width), workers=workers)
    ring = np.concatenate([plane[..., 0, :], plane[..., -1, :], plane[..., 0], plane[..., -1]], -1)
    return plane - ring.mean(-1)[..., None, None]


def laplacian(image: np.ndarray) -> np.ndarray:
    """f = 4K − Σ neighbours of an image [..., height, width] that is odd about its edges; the inverse of ``dst``."""
    k = np.pad(image, [(0, 0)] * (image.ndim - 2) + [(1, 1), (1, 1)], mode="edge")
    for rim in (k[..., 0, :], k[..., -1, :], k[..., 0], k[..., -1]):
        np.negative(rim, out=rim)
    inner = k[..., 1:-1, 1:-1]
    return 4 * inner - k[..., :-2, 1:-1] - k[..., 2:, 1:-1] - k[..., 1:-1, :-2] - k[..., 1:-1, 2:]
