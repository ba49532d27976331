"""A small network per probe: 3 → 8 → 8 → 1 with leaky ReLU, 113 parameters, clipped output."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lightwell.graph.ops.activate import LEAK as SLOPE
from lightwell.probes.pattern import Pattern
from lightwell.probes.weights.common import Close, State
from lightwell.probes.weights.refine import refine

HIDDEN = 8
# Shapes of W1, b1, W2, b2, W3, b3, and the ends of each in a row of parameters.
SHAPES = ((HIDDEN, 3), (HIDDEN,), (HIDDEN, HIDDEN), (HIDDEN,), (1, HIDDEN), (1,))
SPLITS = np.cumsum([int(np.prod(s)) for s in SHAPES])
STEPS, RATE = 2500, 0.01
# Initial bias of the output: in the middle of the clip, where gradients do not vanish.
FIRST_BIAS = 0.5


@dataclass(frozen=True)
class TinyMlp:
    """A network per probe, see the module; stored as int8 with one step per layer."""

    @property
    def name(self) -> str:
        """Name with its sizes."""
        return "mlp"

    @property
    def parameters(self) -> int:
        """C, the number of parameters."""
        return int(SPLITS[-1])

    @property
    def stored(self) -> int:
        """Bytes of a record: int8 parameters and a float32 step for each of the three layers."""
        return self.parameters + 12

    def parts(self, params: np.ndarray) -> list[np.ndarray]:
        """Split parameters into the weights and biases of the layers.

        Args:
            params: [B, 113] parameters.

        Returns:
            W1 [B, 8, 3], b1 [B, 8], W2 [B, 8, 8], b2 [B, 8], W3 [B, 1, 8], b3 [B, 1].
        """
        pieces = np.split(params, SPLITS[:-1], axis=1)
        return [piece.reshape(-1, *shape) for piece, shape in zip(pieces, SHAPES)]

    def raw(self, params: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Evaluate one probe at one place per row, before the clip.

        Args:
            params: [N, C] parameters.
            u: [N, 3] probe-local positions in [-1, 1].

        Returns:
            [N] values.
        """
        w1, b1, w2, b2, w3, b3 = self.parts(params)
        h = _leaky((w1 * u[:, None]).sum(axis=2) + b1)
        h = _leaky((w2 * h[:, None]).sum(axis=2) + b2)
        return (w3 * h[:, None]).sum(axis=2)[:, 0] + b3[:, 0]

    def values(self, params: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, State]:
        """Evaluate probes at many places, before the clip.

        Args:
            params: [B, C] parameters.
            u: [Q, 3] probe-local positions for all probes, or [B, Q, 3] for each.

        Returns:
            [B, Q] values, and the state that ``gradient`` needs.
        """
        w1, b1, w2, b2, w3, b3 = self.parts(params)
        x = np.ascontiguousarray(u, np.float32)
        z1 = w1 @ np.swapaxes(x, -1, -2) + b1[..., None]
        h1 = _leaky(z1)
        z2 = w2 @ h1 + b2[..., None]
        h2 = _leaky(z2)
        return (w3 @ h2)[:, 0] + b3, (x, z1, h1, z2, h2, w2, w3)

    def gradient(self, state: State, slope: np.ndarray) -> np.ndarray:
        """Compute the gradient of a loss by the parameters.

        Args:
            state: State of ``values``.
            slope: [B, Q] derivative of the loss by each value.

        Returns:
            [B, C] gradient.
        """
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
        """Return the parameters: those of a network have no bounds.

        Args:
            params: [B, C] parameters.

        Returns:
            The same array.
        """
        return params

    def steps(self, params: np.ndarray) -> np.ndarray:
        """Compute the quantisation step of each layer, weights and biases together.

        Args:
            params: [B, C] parameters.

        Returns:
            [B, 3] float32 values of one int8 step.
        """
        edges = np.r_[0, SPLITS[[1, 3, 5]]]
        largest = np.stack([np.abs(params[:, a:b]).max(axis=1) for a, b in pairwise(edges)], axis=1)
        return np.maximum(largest, 1e-6).astype(np.float32) / np.float32(127)

    def quantised(self, params: np.ndarray) -> np.ndarray:
        """Round parameters to those that can be stored.

        Args:
            params: [B, C] parameters.

        Returns:
            [B, C] float32 parameters.
        """
        step = np.repeat(self.steps(params), np.diff(np.r_[0, SPLITS[[1, 3, 5]]]), axis=1)
        return (np.rint(params / step) * step).astype(np.float32)

    def initial(self, count: int, seed: int = 0) -> np.ndarray:
        """Draw initial parameters (He et al. 2015), the same for all probes.

        Args:
            count: Number of probes B.
            seed: Seed of the random numbers.

        Returns:
            [B, C] float32 parameters.
        """
        rng = np.random.default_rng(seed)
        layers = [(HIDDEN, 3), (HIDDEN, HIDDEN), (1, HIDDEN)]
        parts = []
        for outputs, inputs in layers:
            parts += [rng.normal(0, np.sqrt(2 / inputs), outputs * inputs), rng.normal(0, 0.2, outputs)]
        parts[-1] = np.array([FIRST_BIAS])
        return np.tile(np.concatenate(parts).astype(np.float32), (count, 1))

    def fit(self, target: np.ndarray, weight: np.ndarray, layout: Pattern, close: Close | None = None) -> np.ndarray:
        """Fit networks to targets from random initial parameters.

        Args:
            target: [B, Q] trust ρ at the points of the pattern.
            weight: [B, Q] weights of ``point_weight``.
            layout: The pattern.
            close: Places at surfaces; None for none.

        Returns:
            [B, C] float32 parameters.
        """
        start = self.initial(len(target))
        return refine(self, start, target, weight, layout, steps=STEPS, rate=RATE, close=close)


def _leaky(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, np.float32(SLOPE) * x)


def _steep(x: np.ndarray) -> np.ndarray:
    return np.where(x > 0, np.float32(1), np.float32(SLOPE))
