"""Optimises the parameters of many probes at once with Adam, through the clip and the threshold of the query.

Kingma and Ba 2015, with a cosine decay of the rate. Every step uses the same few support points of every probe.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from os import cpu_count

import numpy as np

from lightwell.probes.pattern import Pattern
from lightwell.probes.weights.common import LEAK, THRESHOLD, Close, State, WeightFunction, padded

# Points of a step; probes of a batch, which fit into the cache and are one thread's work.
POINTS, BATCH = 1024, 24
# Places at surfaces of a step.
CLOSE = 96
DECAY_1, DECAY_2, EPSILON = 0.9, 0.99, 1e-8


def refine(
    function: WeightFunction,
    params: np.ndarray,
    target: np.ndarray,
    weight: np.ndarray,
    layout: Pattern,
    *,
    steps: int,
    rate: float,
    points: int = POINTS,
    seed: int = 0,
    close: Close | None = None,
) -> np.ndarray:
    """Optimise parameters by gradient descent.

    Args:
        function: The weight function.
        params: [B, C] start; it is not changed.
        target: [B, Q] trust ρ at the points of the pattern.
        weight: [B, Q] weights of ``point_weight``.
        layout: The pattern.
        steps: Number of steps, ≥ 1.
        rate: Rate of the first step.
        points: Points of the pattern in each step.
        seed: Seed of the choice of points.
        close: Places at surfaces; None for none.

    Returns:
        [B, C] float32 parameters.
    """
    out = np.array(params, np.float32)

    def some(start: int) -> None:
        rows = slice(start, start + BATCH)
        start_, t, w = padded(BATCH, out[rows], target[rows], weight[rows])
        near = close and close.part(rows, BATCH)
        out[rows] = _batch(function, start_, t, w, layout, steps, rate, points, seed, near)[: len(out[rows])]

    # NumPy releases the interpreter's lock; batches share nothing, so the bits do not depend on the threads.
    with ThreadPoolExecutor(cpu_count() or 1) as pool:
        list(pool.map(some, range(0, len(out), BATCH)))
    return out


def _batch(
    function: WeightFunction,
    params: np.ndarray,
    target: np.ndarray,
    weight: np.ndarray,
    layout: Pattern,
    steps: int,
    rate: float,
    points: int,
    seed: int,
    close: Close | None,
) -> np.ndarray:
    rng = np.random.default_rng(seed)
    mean, square = np.zeros_like(params), np.zeros_like(params)
    order, used = rng.permutation(len(layout.u)), 0
    for step in range(steps):
        if used + points > len(order):
            order, used = rng.permutation(len(layout.u)), 0
        chosen = order[used : used + points]
        used += points
        slope, state = _loss(function, params, target[:, chosen], weight[:, chosen], layout.u[chosen])
        gradient = function.gradient(state, slope / points)
        if close is not None:
            near = rng.integers(0, close.target.shape[1], CLOSE)
            slope, state = _loss(function, params, close.target[:, near], close.weight[:, near], close.u[:, near])
            share = close.target.shape[1] / (CLOSE * len(layout.u))
            gradient = gradient + function.gradient(state, slope * np.float32(share))
        mean = DECAY_1 * mean + (1 - DECAY_1) * gradient
        square = DECAY_2 * square + (1 - DECAY_2) * gradient**2
        speed = rate * 0.5 * (1 + np.cos(np.pi * step / steps))
        correction = np.sqrt(1 - DECAY_2 ** (step + 1)) / (1 - DECAY_1 ** (step + 1))
        params = params - np.float32(speed * correction) * mean / (np.sqrt(square) + np.float32(EPSILON))
        params = function.bounded(params)
    return params


def _loss(
    function: WeightFunction, params: np.ndarray, target: np.ndarray, weight: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, State]:
    """Derivative of the weighted squared error by each value, and the state of the function."""
    value, state = function.values(params, u)
    inner = (value - np.float32(THRESHOLD)) * np.float32(1 / (1 - THRESHOLD))
    rho = np.clip(inner, 0, 1)
    steep = np.where((inner < 0) | (inner > 1), np.float32(LEAK), np.float32(1))
    # Where the clipped value equals the target, the slope is 0.
    return np.float32(2 / (1 - THRESHOLD)) * weight * (rho - target) * steep, state
