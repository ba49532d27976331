"""Simulated annealing of point positions: the published schedule, and one that lowers the error.

Published: 400 steps, each moves 1 % of the points by up to a pixel and integrates the values again; the temperature is
of the order of the cost, so that nearly every step is accepted and the result does not improve. The other schedule
moves one point at a time, visits every point about twenty times, starts at 1 % of the initial cost, measures the error
on a window that includes the pixels around the kernel, and returns the best state that it found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.lens.lsq import design, window
from lightwell.lens.psf import charges
from lightwell.lens.voronoi import integrate_labels

# Published schedule: steps, share of points moved per step, first and last temperature relative to the initial cost.
STEPS, SHARE, HOT, WARM = 400, 0.01, 1.0, 0.01
# Working schedule: visits per point, longest move in pixels, first and last temperature relative to the initial cost.
VISITS, MOVE, COOL, COLD = 20, 2, 1e-2, 1e-5


@dataclass(frozen=True)
class Annealed:
    """Result of annealing."""

    x: np.ndarray
    y: np.ndarray
    values: np.ndarray
    curve: np.ndarray
    """[steps + 1] cost over Σ K² of the current state after every step."""


def _cost(residual: np.ndarray) -> float:
    return float(residual @ residual)


def published(kernel: np.ndarray, px: np.ndarray, py: np.ndarray, seed: int = 0, steps: int = STEPS) -> Annealed:
    """Anneal points by the published schedule and return the last state, whether better or worse.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].
        px: Integer x of the points [n], pixels from the kernel's centre.
        py: Integer y of the points [n].
        seed: Seed of the random numbers.
        steps: Number of steps, ≥ 0.

    Returns:
        Last state and the cost after every step.

    Reference: Leimkühler, Seidel, Ritschel, *Laplacian Kernel Splatting*, Computer Graphics Forum 37(2), 2018.
    """
    rng = np.random.default_rng(seed)
    f = charges(kernel)
    x, y, k, _ = window(kernel)
    total = float((k * k).sum())
    px, py = np.array(px), np.array(py)

    def evaluate(qx: np.ndarray, qy: np.ndarray) -> tuple[np.ndarray, float]:
        values = integrate_labels(f, np.stack([qx, qy], 1).astype(float))
        return values, _cost(design(x, y, qx, qy) @ values - k)

    values, cost = evaluate(px, py)
    start, curve = cost, [cost / total]
    for step in range(steps):
        temperature = start * HOT * (WARM / HOT) ** (step / steps)
        moved = rng.choice(len(px), max(1, round(SHARE * len(px))), replace=False)
        qx, qy = px.copy(), py.copy()
        qx[moved] += rng.integers(-1, 2, len(moved))
        qy[moved] += rng.integers(-1, 2, len(moved))
        new_values, new_cost = evaluate(qx, qy)
        if new_cost <= cost or rng.random() < np.exp((cost - new_cost) / temperature):
            px, py, values, cost = qx, qy, new_values, new_cost
        curve.append(cost / total)
    return Annealed(px, py, values, np.array(curve))


def working(
    kernel: np.ndarray, px: np.ndarray, py: np.ndarray, values: np.ndarray, seed: int = 0, visits: int = VISITS
) -> Annealed:
    """Anneal points one at a time at a low temperature and return the best state; values move with their points.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].
        px: Integer x of the points [n], pixels from the kernel's centre.
        py: Integer y of the points [n].
        values: Charges of the points [n].
        seed: Seed of the random numbers.
        visits: Steps per point, ≥ 0.

    Returns:
        Best state found and the cost after every step.
    """
    rng = np.random.default_rng(seed)
    x, y, k, _ = window(kernel)
    total = float((k * k).sum())
    px, py, values = np.array(px), np.array(py), np.asarray(values, float)
    residual = design(x, y, px, py) @ values - k
    cost = best = start = _cost(residual)
    kept = px.copy(), py.copy()
    curve = [cost / total]
    steps = visits * len(px)
    for step in range(steps):
        temperature = start * COOL * (COLD / COOL) ** (step / steps)
        i = rng.integers(len(px))
        qx, qy = px[i] + rng.integers(-MOVE, MOVE + 1), py[i] + rng.integers(-MOVE, MOVE + 1)
        if ((px == qx) & (py == qy)).any():
            curve.append(cost / total)
            continue
        change = design(x, y, np.array([px[i], qx]), np.array([py[i], qy])) @ np.array([-values[i], values[i]])
        new = residual + change
        new_cost = _cost(new)
        if new_cost <= cost or rng.random() < np.exp((cost - new_cost) / temperature):
            px[i], py[i], residual, cost = qx, qy, new, new_cost
            if cost < best:
                best, kept = cost, (px.copy(), py.copy())
        curve.append(cost / total)
    return Annealed(*kept, values, np.array(curve))
