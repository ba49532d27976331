"""Values of a spreadlet by constrained least squares.

Minimise Σ_x w(x) (Σ_k v_k G(x − p_k) − K(x))² subject to C v = d, over a window of twice the support. The constraints
are eliminated by a basis of their null space; the normal matrix is inverted without its smallest eigenvalues.
"""

from __future__ import annotations

import numpy as np

from lightwell.lens.green import response
from lightwell.lens.moments import ORDER, constraints

# Weight of the pixels outside the support: light that lands there is leak.
OUTSIDE = 3.0
# Eigenvalues below this share of the largest are not inverted.
CUTOFF = 1e-11


def window(kernel: np.ndarray, factor: float = 2.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """List the pixels of the least-squares window around a kernel.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].
        factor: Size of the window relative to the kernel's shorter side; it grows by the same amount on all sides.

    Returns:
        x, y, K and weight w of every pixel, each flat [n].
    """
    hy, hx = kernel.shape[0] // 2, kernel.shape[1] // 2
    grow = max(round((factor - 1) * min(hx, hy)), 6)
    padded = np.pad(kernel, grow)
    y, x = np.mgrid[-hy - grow : hy + grow + 1, -hx - grow : hx + grow + 1]
    weight = np.where(padded > 0, 1.0, OUTSIDE)
    return x.ravel(), y.ravel(), padded.ravel(), weight.ravel()


def design(x: np.ndarray, y: np.ndarray, px: np.ndarray, py: np.ndarray) -> np.ndarray:
    """Evaluate the Green's function from every point to every pixel.

    Args:
        x: Integer x of the pixels [n].
        y: Integer y of the pixels [n].
        px: Integer x of the points [k].
        py: Integer y of the points [k].

    Returns:
        G(x − p_k) [n, k].
    """
    return response(x[:, None] - px[None, :], y[:, None] - py[None, :])


def null_space(c: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve C v = d for all its solutions.

    Args:
        c: Constraints [m, k].
        d: Right-hand sides [m].

    Returns:
        One solution [k], and an orthonormal basis [k, k − rank] of the solutions of C v = 0.
    """
    u, s, vt = np.linalg.svd(c, full_matrices=True)
    rank = int((s > 1e-9 * s[0]).sum())
    particular = vt[:rank].T @ ((u[:, :rank].T @ d) / s[:rank])
    return particular, vt[rank:].T


def solve_values(
    kernel: np.ndarray, px: np.ndarray, py: np.ndarray, order: int = ORDER, mass: bool = True, centroid: bool = True
) -> tuple[np.ndarray, float]:
    """Compute the best values of points at given integer offsets.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].
        px: Integer x of the points [k].
        py: Integer y of the points [k].
        order: Highest order of harmonic moments that are set to zero, 0 to 6.
        mass: Keep the kernel's mass.
        centroid: Keep the kernel's centroid.

    Returns:
        Values [k], and their weighted squared error over Σ K²; infinity where the constraints leave no freedom.
    """
    x, y, k, w = window(kernel)
    c, d = constraints(px, py, kernel, order, mass, centroid)
    v0, basis = null_space(c, d)
    if basis.shape[1] == 0:
        return v0, np.inf
    a = design(x, y, px, py) * w[:, None]
    residual = k * w - a @ v0
    reduced = a @ basis
    values, vectors = np.linalg.eigh(reduced.T @ reduced)
    keep = values > CUTOFF * values[-1]
    inner = vectors[:, keep] @ ((vectors[:, keep].T @ (reduced.T @ residual)) / values[keep])
    cost = float(((residual - reduced @ inner) ** 2).sum() / (k * k).sum())
    return v0 + basis @ inner, cost
