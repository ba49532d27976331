"""The lattice Green's function: the response of the exact solve to one unit of charge on an infinite plane."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

# Side of the torus on which it is computed; offsets up to a quarter of it are used.
SIDE = 1024
# Distance at which it is shifted to 0: without the shift, Gram matrices lose all digits to a common constant.
ZERO_AT = 64


def eigenvalues(height: int, width: int) -> np.ndarray:
    """Compute the eigenvalues of the five-point operator 4K − Σ neighbours on a torus.

    Args:
        height: Rows.
        width: Columns.

    Returns:
        4 − 2cos(2πi/H) − 2cos(2πj/W) [height, width].
    """
    rows, columns = (4 * np.sin(np.pi * np.arange(n) / n) ** 2 for n in (height, width))
    return rows[:, None] + columns[None, :]


@lru_cache(maxsize=1)
def green() -> np.ndarray:
    """Compute the Green's function on a torus, corrected for the background charge that a torus needs.

    Returns:
        G [SIDE, SIDE] by offset modulo ``SIDE``; 0 at distance ``ZERO_AT`` along an axis.
    """
    values = eigenvalues(SIDE, SIDE)
    values[0, 0] = 1.0
    spectrum = 1.0 / values
    spectrum[0, 0] = 0.0
    g = np.fft.ifft2(spectrum).real
    d = np.minimum(np.arange(SIDE), SIDE - np.arange(SIDE)).astype(float)
    g += (d[:, None] ** 2 + d[None, :] ** 2) / (4.0 * SIDE**2)
    return g - g[0, ZERO_AT]


def response(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Evaluate the Green's function.

    Args:
        x: Integer offsets x, any shape, magnitude at most ``SIDE`` / 4.
        y: Integer offsets y, same shape.

    Returns:
        G, same shape.
    """
    return green()[y % SIDE, x % SIDE]
