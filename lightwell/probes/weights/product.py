"""Product field: ρ = clip(tri(G, u), 0, 1) · σ(tri(H, u)); G carries the discontinuity, H the smooth rest.

The two grids are optimised together; the logistic bounds the gradients. H starts at +2, as σ(0) halves every weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes.pattern import Pattern
from lightwell.probes.weights.common import LEAK, Close
from lightwell.probes.weights.refine import refine
from lightwell.probes.weights.relu import HIGH, LOW, ReluField, product, turned

START = 2.0
# Stored values of H: uint8 over this range.
SMOOTH_LOW, SMOOTH_HIGH = -4.0, 8.0
STEPS, RATE = 300, 0.03
FULL = np.float32(1 / (1 + np.exp(-SMOOTH_HIGH)))


@dataclass(frozen=True)
class ProductField:
    """Grids of G³ and H³ numbers."""

    sharp: int = 5
    smooth: int = 2

    @property
    def name(self) -> str:
        return f"product-field-{self.sharp}-{self.smooth}"

    @property
    def parameters(self) -> int:
        return self.sharp**3 + self.smooth**3

    @property
    def stored(self) -> int:
        return self.parameters

    @property
    def _parts(self) -> tuple[ReluField, ReluField]:
        return ReluField(self.sharp), ReluField(self.smooth)

    def raw(self, params: np.ndarray, u: np.ndarray) -> np.ndarray:
        g, h = self._parts
        split = g.parameters
        return np.clip(g.raw(params[:, :split], u), 0, 1) * _logistic(h.raw(params[:, split:], u))

    def values(self, params: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, object]:
        g, h = (part.matrix(u) for part in self._parts)
        split = g.shape[-1]
        a, b = product(g, params[:, :split]), _logistic(product(h, params[:, split:]))
        slope = np.where((a < 0) | (a > 1), np.float32(LEAK), np.float32(1))
        clipped = np.clip(a, 0, 1)
        # The leaky clip: its value leaves [0, 1] a little, so that gradients live.
        soft = clipped + np.float32(LEAK) * (a - clipped)
        return soft * b, (g, h, soft, b, slope)

    def gradient(self, state, slope: np.ndarray) -> np.ndarray:
        g, h, soft, b, of_clip = state
        return np.concatenate([turned(g, slope * b * of_clip), turned(h, slope * soft * b * (1 - FULL * b))], axis=1)

    def bounded(self, params: np.ndarray) -> np.ndarray:
        split = self.sharp**3
        smooth = np.clip(params[:, split:], SMOOTH_LOW, SMOOTH_HIGH)
        return np.concatenate([np.clip(params[:, :split], LOW, HIGH), smooth], axis=1)

    def quantised(self, params: np.ndarray) -> np.ndarray:
        split, span = self.sharp**3, SMOOTH_HIGH - SMOOTH_LOW
        bytes_ = np.clip(np.rint((params[:, split:] - SMOOTH_LOW) / span * 255), 0, 255)
        smooth = (bytes_ * (span / 255) + SMOOTH_LOW).astype(np.float32)
        return np.concatenate([ReluField(self.sharp).quantised(params[:, :split]), smooth], axis=1)

    def fit(self, target: np.ndarray, weight: np.ndarray, layout: Pattern, close: Close | None = None) -> np.ndarray:
        sharp = ReluField(self.sharp).fit(target, weight, layout, close)
        start = np.concatenate([sharp, np.full((len(target), self.smooth**3), START, np.float32)], axis=1)
        return refine(self, start, target, weight, layout, steps=STEPS, rate=RATE, close=close)


def _logistic(x: np.ndarray) -> np.ndarray:
    """σ(x) / σ(SMOOTH_HIGH): the largest value that is stored gives exactly 1."""
    return 1 / ((1 + np.exp(-np.clip(x, -30, 30))) * FULL)
