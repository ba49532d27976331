"""Linear constraints on the values of a spreadlet, exact for the five-point lattice Laplacian.

With charges v_k at p_k = (x, y) and kernel K:  Σ v_k h(p_k) = −Σ K Δh  for every polynomial h. A function that is
harmonic on the lattice gives 0 for every K, and removes one term of the far field; |p|² gives the mass, x|p|² and
y|p|² the centroid. The plain powers z⁴, z⁵, z⁶ are not harmonic on the lattice; corrected ones are used here.
"""

from __future__ import annotations

import numpy as np

from lightwell.lens.psf import offsets

# Highest harmonic order of the default recipe; also the highest for which the correction is known here.
ORDER = 6


def harmonics(x: np.ndarray, y: np.ndarray, order: int = ORDER) -> list[np.ndarray]:
    """Evaluate the lattice-harmonic polynomials of degree 1 to ``order``.

    Args:
        x: Coordinates x, any shape.
        y: Coordinates y, same shape.
        order: Highest degree, 0 to 6.

    Returns:
        Real and imaginary part of each polynomial, same shape, in ascending degree.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    z, r2 = x + 1j * y, x * x + y * y
    powers = (z, z**2, z**3, z**4 - r2, z**5 - 2.5 * z * r2, z**6 - 5 * (x**4 - y**4) - 10j * x * y * r2)
    return [part for power in powers[:order] for part in (power.real, power.imag)]


def constraints(
    x: np.ndarray, y: np.ndarray, kernel: np.ndarray, order: int = ORDER, mass: bool = True, centroid: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Build the constraints C v = d on the values of points, scaled to comparable size.

    Args:
        x: Coordinates x of the points [k].
        y: Coordinates y of the points [k].
        kernel: Point spread function [2·hy+1, 2·hx+1].
        order: Highest order of harmonic moments that are set to zero, 0 to 6.
        mass: Keep the kernel's mass.
        centroid: Keep the kernel's centroid.

    Returns:
        C [m, k] and d [m].
    """
    kx, ky = offsets(kernel)
    x, y = np.asarray(x, float), np.asarray(y, float)
    r2 = x * x + y * y
    rows, values = [np.ones_like(x)], [0.0]
    rows += harmonics(x, y, order)
    values += [0.0] * (len(rows) - 1)
    if mass:
        rows.append(r2)
        values.append(-4.0 * kernel.sum())
    if centroid:
        rows += [x * r2, y * r2]
        values += [-8.0 * float((kernel * kx).sum()), -8.0 * float((kernel * ky).sum())]
    c, d = np.array(rows), np.array(values)
    size = np.maximum(np.abs(c).max(1), 1e-12)
    return c / size[:, None], d / size
