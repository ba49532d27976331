"""The published recipe: Poisson disk, Lloyd, Voronoi integration, annealing (Leimkühler, Seidel, Ritschel 2018).

As far as the publication states it: density |ΔK| smoothed by a 5×5 Gaussian, dart throwing with a radius that shrinks
with the density, 50 weighted Lloyd iterations, values by integration over Voronoi cells, annealing.
"""

from __future__ import annotations

import numpy as np

from lightwell.lens import anneal, points
from lightwell.lens.psf import charges
from lightwell.lens.recipes import Recipe, finish_charges
from lightwell.lens.spreadlet import Spreadlet
from lightwell.lens.voronoi import integrate_cells

# Radius of a Poisson disk over density^−½: points per area follow the density.
EXPONENT = 0.5


def paper(kernel: np.ndarray, recipe: Recipe, seed: int) -> Spreadlet:
    """Make a spreadlet by the published steps.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].
        recipe: Settings; ``share`` of the kernel's pixels is the number of points.
        seed: Seed of the random numbers, combined with the recipe's.

    Returns:
        The spreadlet.

    Reference: Leimkühler, Seidel, Ritschel, *Laplacian Kernel Splatting*, Computer Graphics Forum 37(2), 2018.
    """
    f = charges(kernel)
    density = points.density(f)
    rng = np.random.default_rng((recipe.seed, seed))
    budget = max(round(recipe.share * np.count_nonzero(kernel)), int(recipe.base))
    start = points.poisson_with_budget(density, budget, EXPONENT, rng)
    px, py = points.rounded(points.lloyd(density, start))
    values = integrate_cells(f, np.stack([px, py], 1).astype(float))
    if recipe.anneal == "published":
        end = anneal.published(kernel, px, py, seed)
        px, py, values = end.x, end.y, end.values
    elif recipe.anneal == "working":
        end = anneal.working(kernel, px, py, values, seed)
        px, py, values = end.x, end.y, end.values
    return finish_charges(kernel, *_merged(px, py, values), "voronoi")


def _merged(px: np.ndarray, py: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Merge points that annealing moved to the same pixel."""
    at, inverse = np.unique(np.stack([px, py], 1), axis=0, return_inverse=True)
    return at[:, 0], at[:, 1], np.bincount(inverse.ravel(), values, len(at))
