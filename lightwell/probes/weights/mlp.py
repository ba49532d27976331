"""A tiny network per probe: 3 → 8 → 8 → 1 with leaky ReLU, 113 numbers, its output clipped."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lightwell.graph.ops.activate import LEAK as SLOPE
from lightwell.probes.pattern import Pattern
from lightwell.probes.weights.common import Close
from lightwell.probes.weights.refine import refine

HIDDEN = 8
# Where each of (W1 [8, 3], b1, W2 [8, 8], b2, W3 [1, 8], b3) begins.
SHAPES = ((HIDDEN, 3), (HIDDEN,), (HIDDEN, HIDDEN), (HIDDEN,), (1, HIDDEN), (1,))
SPLITS = np.cumsum([int(np.prod(s)) for s in SHAPES])
STEPS, RATE = 2500, 0.01
# The output's first bias: gradients live in the middle of the clip.
FIRST_BIAS = 0.5


@dataclass(frozen=True)
class TinyMlp:
    """See the module."""

    @property
    def name(self) -> str:
        return "mlp"

    @property
    def parameters(self) -> int:
        return int(SPLITS[-1])

    @property
    def stored(self) -> int:
        """int8 numbers and a float32 step for each of the three layers."""
        return self.parameters + 12

    def parts(self, params: np.ndarray) -> list[np.ndarray]:
        """Weights and biases [B, …] of [B, 113]."""
        pieces = np.split(params, SPLITS[:-1], axis=1)
        return [piece.reshape(-1, *shape) for piece, shape in zip(pieces, SHAPES)]

    def raw(self, params: np.ndarray, u: np.ndarray) -> np.ndarray:
        w1, b1, w2, b2, w3, b3 = self.parts(params)
        h = _leaky((w1 * u[:, None]).sum(axis=2) + b1)
        h = _leaky((w2 * h[:, None]).sum(axis=2) + b2)
        return (w3 * h[:, None]).sum(axis=2)[:, 0] + b3[:, 0]

    def values(self, params: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, object]:
        w1, b1, w2, b2, w3, b3 = self.parts(params)
        x = np.ascontiguousarray(u, np.float32)
        z1 = w1 @ np.swapaxes(x, -1, -2) + b1[..., None]
        h1 = _leaky(z1)
        z2 = w2 @ h1 + b2[..., None]
        h2 = _leaky(z2)
        return (w3 @ h2)[:, 0] + b3, (x, z1, h1, z2, h2, w2, w3)

    def gradient(self, state, slope: np.ndarray) -> np.ndarray:
        x, z1, h1, z2, h2, w2, w3 = state
        d3 = slope[:, None]
        d2 = np.swapaxes(w3, 1, 2) * d3 * _steep(z2)
        d1 = (np.swapaxes(w2, 1, 2) @ d2) * _steep(z1)
        grads = (
            d1 @ x,
            d1.sum(axis=2),
            d2 @ np.swapaxes(h1, 1, 2),
            d2.sum(axis=2),
            d3 @ np.swapaxes(h2, 1, 2),
            d3.sum(axis=2),
        )
        return np.concatenate([g.reshape(len(slope), -1) for g in grads], axis=1)

    def bounded(self, params: np.ndarray) -> np.ndarray:
        return params

    def steps(self, params: np.ndarray) -> np.ndarray:
        """[B, 3] value of an int8 step of each layer (weights and biases together)."""
        edges = np.r_[0, SPLITS[[1, 3, 5]]]
        largest = np.stack([np.abs(params[:, a:b]).max(axis=1) for a, b in pairwise(edges)], axis=1)
        return np.maximum(largest, 1e-6).astype(np.float32) / np.float32(127)

    def quantised(self, params: np.ndarray) -> np.ndarray:
        step = np.repeat(self.steps(params), np.diff(np.r_[0, SPLITS[[1, 3, 5]]]), axis=1)
        return (np.rint(params / step) * step).astype(np.float32)

    def initial(self, count: int, seed: int = 0) -> np.ndarray:
        """[count, 113] first weights (He et al. 2015); the same for all probes."""
        rng = np.random.default_rng(seed)
        layers = [(HIDDEN, 3), (HIDDEN, HIDDEN), (1, HIDDEN)]
        parts = []
        for outputs, inputs in layers:
            parts += [rng.normal(0, np.sqrt(2 / inputs), outputs * inputs), rng.normal(0, 0.2, outputs)]
        parts[-1] = np.array([FIRST_BIAS])
        return np.tile(np.concatenate(parts).astype(np.float32), (count, 1))

    def fit(self, target: np.ndarray, weight: np.ndarray, layout: Pattern, close: Close | None = None) -> np.ndarray:
        start = self.initial(len(target))
        return refine(self, start, target, weight, layout, steps=STEPS, rate=RATE, close=close)


def _leaky(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, np.float32(SLOPE) * x)


def _steep(x: np.ndarray) -> np.ndarray:
    return np.where(x > 0, np.float32(1), np.float32(SLOPE))
