"""Make a spreadlet from a kernel: pass-through, primal, lossless, or sparse by least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.lens import points, psf
from lightwell.lens.lsq import solve_values
from lightwell.lens.quantise import angular_order, quantise_charges, quantise_kernel
from lightwell.lens.score import integrate, plane_of, score
from lightwell.lens.spreadlet import CHARGE, PRIMAL, Spreadlet

# Charges below this share of the largest are rounding errors of the supersampling.
DUST = 1e-7


@dataclass(frozen=True)
class Recipe:
    """Settings with which a library is baked; part of its key."""

    name: str = "default"
    """``default`` (least squares), ``best`` (the better of several point sets), ``paper`` (Poisson, Lloyd, Voronoi)."""
    base: float = 24.0
    """Points of a sparse spreadlet: base + slope · (r + length) up to ``bend``, and slope / 5 per pixel beyond."""
    slope: float = 2.4
    """Points per pixel of radius; more is closer to the kernel and slower."""
    bend: float = 32.0
    """Radius and length together from which fewer points per pixel reach the same leak, pixels."""
    share: float = 0.2
    """Largest number of points, as a share of the kernel's pixels."""
    smallest: float = 5.0
    """Radius below which a kernel is primal or lossless, whichever has fewer points."""
    order: int = 6
    """Harmonic moments set to zero."""
    anneal: str = "none"
    """Only ``paper``: ``none``, ``published`` (does not help) or ``working``."""
    seed: int = 0
    """Seed of all random numbers; each node adds its index."""

    def count(self, radius: float, length: float = 0.0) -> int:
        """Compute the number of points of a sparse spreadlet.

        Args:
            radius: Radius of the kernel, pixels.
            length: Length of the motion, pixels.

        Returns:
            Number of points.
        """
        size = radius + length
        return round(self.base + self.slope * (min(size, self.bend) + max(size - self.bend, 0.0) / 5))


def finish_charges(kernel: np.ndarray, px: np.ndarray, py: np.ndarray, values: np.ndarray, recipe: str) -> Spreadlet:
    """Order, quantise and score charges.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].
        px: Integer x of the points [n].
        py: Integer y of the points [n].
        values: Charges [n].
        recipe: Name of how they were made.

    Returns:
        The spreadlet.
    """
    order = angular_order(px, py)
    px, py, values = px[order], py[order], values[order]
    q, scale = quantise_charges(values)
    keep = q != 0
    px, py, q = px[keep], py[keep], q[keep]
    response = integrate(px, py, q * float(scale), plane_of(kernel))
    x, y = px.astype(np.int16), py.astype(np.int16)
    return Spreadlet(CHARGE, x, y, q, scale, recipe, score(kernel, response))


def primal(kernel: np.ndarray) -> Spreadlet:
    """Represent a kernel by its own pixels, which are added to the picture without a solve.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].

    Returns:
        The spreadlet.
    """
    rows, columns = np.nonzero(kernel)
    px, py = columns - kernel.shape[1] // 2, rows - kernel.shape[0] // 2
    order = angular_order(px, py)
    values = kernel[rows, columns][order]
    q, scale = quantise_kernel(values)
    keep = q != 0
    px, py, q = px[order][keep], py[order][keep], q[keep]
    image = np.zeros_like(kernel)
    image[py + kernel.shape[0] // 2, px + kernel.shape[1] // 2] = q * float(scale)
    return Spreadlet(PRIMAL, px.astype(np.int16), py.astype(np.int16), q, scale, "primal", score(kernel, image))


def lossless(kernel: np.ndarray) -> Spreadlet:
    """Represent a kernel by every pixel of −ΔK; exact except for rounding.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].

    Returns:
        The spreadlet.
    """
    f = psf.charges(kernel)
    rows, columns = np.nonzero(np.abs(f) > DUST * np.abs(f).max())
    px, py = columns - f.shape[1] // 2, rows - f.shape[0] // 2
    return finish_charges(kernel, px, py, f[rows, columns], "lossless")


def rings(radius: float, count: int, apart: float = 1.0) -> np.ndarray:
    """Place points on two circles, ``apart`` inside and outside the rim of a disc: one for each sign of its Laplacian.

    Args:
        radius: Radius of the disc, pixels.
        count: Number of points, at least 6 are made.
        apart: Distance of the circles from the rim, pixels.

    Returns:
        Real offsets (x, y) [n, 2], pixels.
    """
    half = max(count // 2, 3)
    t = np.arange(half) * 2 * np.pi / half
    circle = np.stack([np.cos(t), np.sin(t)], 1)
    return np.concatenate([circle * (radius - apart), circle * (radius + apart)])


def sparse(kernel: np.ndarray, count: int, recipe: Recipe, seed: int, starts: tuple[np.ndarray, ...] = ()) -> Spreadlet:
    """Represent a kernel by few points with values by least squares; of several point sets the one of smallest error.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].
        count: Number of points.
        recipe: Settings.
        seed: Seed of the random numbers, combined with the recipe's.
        starts: Point sets [n, 2] to try; empty: one by Lloyd's algorithm.

    Returns:
        The spreadlet.
    """
    density = points.density(psf.charges(kernel))
    rng = np.random.default_rng((recipe.seed, seed))
    sets = list(starts) or [points.lloyd(density, points.seeded(density, count, rng))]
    if starts and recipe.name == "best":
        sets.append(points.lloyd(density, points.poisson_with_budget(density, count, 0.5, rng)))
    made = []
    for chosen in sets:
        px, py = points.rounded(chosen)
        values, cost = solve_values(kernel, px, py, recipe.order)
        made.append((cost, px, py, values))
    _, px, py, values = min(made, key=lambda entry: entry[0])
    return finish_charges(kernel, px, py, values, "sparse")
