"""The lattice Green's function: the response of the exact solve to one unit of charge, on an endless plane."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

# Side of the torus on which it is found; windows up to a quarter of it are used.
SIDE = 1024
# Distance at which it is shifted to vanish: unshifted Gram matrices lose all digits to the common constant.
ZERO_AT = 64


def eigenvalues(height: int, width: int) -> np.ndarray:
    """4 − 2cos(2πi/H) − 2cos(2πj/W) [height, width]: what 4K − Σ neighbours does to a wave on a torus."""
    rows, columns = (4 * np.sin(np.pi * np.arange(n) / n) ** 2 for n in (height, width))
    return rows[:, None] + columns[None, :]


@lru_cache(maxsize=1)
def green() -> np.ndarray:
    """G [SIDE, SIDE] by offset modulo SIDE, with the torus' spread counter charge taken out."""
    values = eigenvalues(SIDE, SIDE)
    values[0, 0] = 1.0
    spectrum = 1.0 / values
    spectrum[0, 0] = 0.0
    g = np.fft.ifft2(spectrum).real
    d = np.minimum(np.arange(SIDE), SIDE - np.arange(SIDE)).astype(float)
    g += (d[:, None] ** 2 + d[None, :] ** 2) / (4.0 * SIDE**2)
    return g - g[0, ZERO_AT]


def response(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """G at integer offsets."""
    return green()[y % SIDE, x % SIDE]
