"""Positions of the points of a spreadlet: variable-radius Poisson disks, weighted Lloyd iterations, rounding.

The density is the smoothed magnitude of the Laplacian, so that most points lie near the kernel's outline.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

# The smoothing of the density is a 5×5 Gaussian.
DENSITY_SIGMA, DENSITY_REACH = 1.0, 2
# Rejections in a row after which a Poisson-disk set is full.
REJECTIONS = 10_000
# The same in the short runs that find the radius.
TRIAL = 500
# Lloyd iterations of the published recipe.
LLOYD = 50


def density(charges: np.ndarray) -> np.ndarray:
    """Compute the density of points: |f| smoothed by a 5 × 5 Gaussian.

    Args:
        charges: Charges of a kernel [h, w].

    Returns:
        Density, same shape.
    """
    return gaussian_filter(np.abs(charges), DENSITY_SIGMA, radius=DENSITY_REACH, mode="constant")


def _spots(weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return offsets [n, 2] (x, y) and weights [n] of the pixels whose weight is above 0."""
    rows, columns = np.nonzero(weight > 1e-6 * weight.max())
    at = np.stack([columns - weight.shape[1] // 2, rows - weight.shape[0] // 2], 1).astype(float)
    return at, weight[rows, columns]


def poisson(
    weight: np.ndarray,
    scale: float,
    exponent: float,
    rng: np.random.Generator,
    limit: int,
    rejections: int = REJECTIONS,
) -> np.ndarray:
    """Throw darts with radius scale / weight^exponent; a dart closer than its radius to another one is rejected.

    Args:
        weight: Density [h, w], ≥ 0.
        scale: Radius at the highest density, pixels.
        exponent: Power of the density.
        rng: Random numbers.
        limit: Largest number of points.
        rejections: Number of rejections in a row after which the set is full.

    Returns:
        Real offsets (x, y) from the centre [n, 2], pixels.
    """
    spots, w = _spots(weight)
    radius = scale / (w / w.max()) ** exponent
    chosen = np.empty((limit, 2))
    count = refused = 0
    while refused < rejections and count < limit:
        picks = rng.integers(0, len(spots), 512)
        darts = spots[picks] + rng.random((512, 2)) - 0.5
        for dart, r in zip(darts, radius[picks]):
            near = chosen[:count] - dart
            if count and (near * near).sum(1).min() < r * r:
                refused += 1
                if refused >= rejections:
                    break
                continue
            refused = 0
            chosen[count] = dart
            count += 1
            if count == limit:
                break
    return chosen[:count].copy()


def poisson_with_budget(weight: np.ndarray, budget: int, exponent: float, rng: np.random.Generator) -> np.ndarray:
    """Generate about ``budget`` Poisson-disk points; the radius is found by bisection with short runs.

    Args:
        weight: Density [h, w], ≥ 0.
        budget: Number of points wanted.
        exponent: Power of the density.
        rng: Random numbers.

    Returns:
        Real offsets (x, y) from the centre [n, 2], pixels.
    """
    low, high = 0.05, float(max(weight.shape))
    for _ in range(9):
        middle = np.sqrt(low * high)
        count = len(poisson(weight, middle, exponent, rng, 2 * budget, TRIAL))
        if abs(count - budget) <= max(1, budget // 50):
            break
        low, high = (middle, high) if count > budget else (low, middle)
    return poisson(weight, middle, exponent, rng, budget + budget // 10)


def seeded(weight: np.ndarray, budget: int, rng: np.random.Generator) -> np.ndarray:
    """Generate starting points in proportion to the density: equal shares of it along a Hilbert curve.

    Args:
        weight: Density [h, w], ≥ 0.
        budget: Number of points.
        rng: Random numbers.

    Returns:
        Real offsets (x, y) from the centre [budget, 2], pixels.
    """
    spots, w = _spots(weight)
    order = _hilbert(spots)
    share = np.cumsum(w[order]) / w.sum() * budget
    picks = np.searchsorted(share, np.arange(budget) + rng.random())
    return spots[order[np.minimum(picks, len(order) - 1)]] + rng.random((budget, 2)) - 0.5


def _hilbert(spots: np.ndarray) -> np.ndarray:
    """Return the order of the spots along a Hilbert curve."""
    bits = 10
    x, y = (np.asarray(spots[:, i] - spots[:, i].min(), np.int64) for i in (0, 1))
    d = np.zeros(len(spots), np.int64)
    for level in range(bits - 1, -1, -1):
        s = 1 << level
        rx, ry = (x & s) > 0, (y & s) > 0
        d += s * s * ((3 * rx) ^ ry)
        flip = ~ry & rx
        x, y = np.where(flip, s - 1 - (x & (s - 1)), x & (s - 1)), np.where(flip, s - 1 - (y & (s - 1)), y & (s - 1))
        x, y = np.where(~ry, y, x), np.where(~ry, x, y)
    return np.argsort(d, kind="stable")


def lloyd(weight: np.ndarray, points: np.ndarray, iterations: int = LLOYD) -> np.ndarray:
    """Move every point to the weighted centroid of the pixels nearest to it, repeatedly (Lloyd's algorithm).

    Args:
        weight: Density [h, w], ≥ 0.
        points: Real offsets (x, y) from the centre [n, 2], pixels.
        iterations: Number of iterations.

    Returns:
        New offsets [n, 2].
    """
    spots, w = _spots(weight)
    points = points.copy()
    for _ in range(iterations):
        label = cKDTree(points).query(spots)[1]
        mass = np.bincount(label, w, len(points))
        for axis in (0, 1):
            centre = np.bincount(label, w * spots[:, axis], len(points))
            points[:, axis] = np.where(mass > 0, centre / np.maximum(mass, 1e-300), points[:, axis])
    return points


def rounded(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Round points to pixels and merge duplicates.

    Args:
        points: Real offsets (x, y) [n, 2], pixels.

    Returns:
        Integer x [k] and y [k], k ≤ n.
    """
    pixels = np.unique(np.rint(points).astype(np.int64), axis=0)
    return pixels[:, 0], pixels[:, 1]
