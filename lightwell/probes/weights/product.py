"""Product field: ρ = clip(tri(G, u), 0, 1) · σ(tri(H, u)), where G has the discontinuity and H the smooth variation.

Both grids are optimised together; the logistic function bounds the gradients. H starts at +2, because σ(0) would
halve every weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes.pattern import Pattern
from lightwell.probes.weights.common import LEAK, Close, State
from lightwell.probes.weights.refine import refine
from lightwell.probes.weights.relu import HIGH, LOW, ReluField, product, turned

START = 2.0
# Stored values of H: uint8 over this range.
SMOOTH_LOW, SMOOTH_HIGH = -4.0, 8.0
STEPS, RATE = 300, 0.03
FULL = np.float32(1 / (1 + np.exp(-SMOOTH_HIGH)))


@dataclass(frozen=True)
class ProductField:
    """Two grids over the cube [-1, 1]³, with vertices on its faces."""

    sharp: int = 5
    """Vertices of G along an edge."""
    smooth: int = 2
    """Vertices of H along an edge."""

    @property
    def name(self) -> str:
        """Name with its sizes."""
        return f"product-field-{self.sharp}-{self.smooth}"

    @property
    def parameters(self) -> int:
        """C, the number of parameters."""
        return self.sharp**3 + self.smooth**3

    @property
    def stored(self) -> int:
        """Bytes of a record."""
        return self.parameters

    @property
    def _parts(self) -> tuple[ReluField, ReluField]:
        return ReluField(self.sharp), ReluField(self.smooth)

    def raw(self, params: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Evaluate one probe at one place per row.

        Args:
            params: [N, C] parameters.
            u: [N, 3] probe-local positions in [-1, 1].

        Returns:
            [N] values.
        """
        g, h = self._parts
        split = g.parameters
        return np.clip(g.raw(params[:, :split], u), 0, 1) * _logistic(h.raw(params[:, split:], u))

    def values(self, params: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, State]:
        """Evaluate probes at many places, with a leaky clip.

        Args:
            params: [B, C] parameters.
            u: [Q, 3] probe-local positions for all probes, or [B, Q, 3] for each.

        Returns:
            [B, Q] values, and the state that ``gradient`` needs.
        """
        g, h = (part.matrix(u) for part in self._parts)
        split = g.shape[-1]
        a, b = product(g, params[:, :split]), _logistic(product(h, params[:, split:]))
        slope = np.where((a < 0) | (a > 1), np.float32(LEAK), np.float32(1))
        clipped = np.clip(a, 0, 1)
        # Leaky clip: its value leaves [0, 1] a little, so that gradients do not vanish.
        soft = clipped + np.float32(LEAK) * (a - clipped)
        return soft * b, (g, h, soft, b, slope)

    def gradient(self, state: State, slope: np.ndarray) -> np.ndarray:
        """Compute the gradient of a loss by the parameters.

        Args:
            state: State of ``values``.
            slope: [B, Q] derivative of the loss by each value.

        Returns:
            [B, C] gradient.
        """
        g, h, soft, b, of_clip = state
        return np.concatenate([turned(g, slope * b * of_clip), turned(h, slope * soft * b * (1 - FULL * b))], axis=1)

    def bounded(self, params: np.ndarray) -> np.ndarray:
        """Clamp parameters to the range that can be stored.

        Args:
            params: [B, C] parameters.

        Returns:
            [B, C] parameters.
        """
        split = self.sharp**3
        smooth = np.clip(params[:, split:], SMOOTH_LOW, SMOOTH_HIGH)
        return np.concatenate([np.clip(params[:, :split], LOW, HIGH), smooth], axis=1)

    def quantised(self, params: np.ndarray) -> np.ndarray:
        """Round parameters to those that can be stored.

        Args:
            params: [B, C] parameters.

        Returns:
            [B, C] float32 parameters.
        """
        split, span = self.sharp**3, SMOOTH_HIGH - SMOOTH_LOW
        bytes_ = np.clip(np.rint((params[:, split:] - SMOOTH_LOW) / span * 255), 0, 255)
        smooth = (bytes_ * (span / 255) + SMOOTH_LOW).astype(np.float32)
        return np.concatenate([ReluField(self.sharp).quantised(params[:, :split]), smooth], axis=1)

    def fit(self, target: np.ndarray, weight: np.ndarray, layout: Pattern, close: Close | None = None) -> np.ndarray:
        """Fit the sharp grid as a ReLU field, then both grids by gradient descent.

        Args:
            target: [B, Q] trust ρ at the points of the pattern.
            weight: [B, Q] weights of ``point_weight``.
            layout: The pattern.
            close: Places at surfaces; None for none.

        Returns:
            [B, C] float32 parameters.
        """
        sharp = ReluField(self.sharp).fit(target, weight, layout, close)
        start = np.concatenate([sharp, np.full((len(target), self.smooth**3), START, np.float32)], axis=1)
        return refine(self, start, target, weight, layout, steps=STEPS, rate=RATE, close=close)


def _logistic(x: np.ndarray) -> np.ndarray:
    """σ(x) / σ(SMOOTH_HIGH): the largest stored value gives exactly 1."""
    return 1 / ((1 + np.exp(-np.clip(x, -30, 30))) * FULL)
