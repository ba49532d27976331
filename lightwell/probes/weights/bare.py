"""The published form: a function learns the whole weight Φ, and no hat multiplies it.

Ours learns the ratio ρ = Φ / hat. Everything else is shared: evaluators multiply the hat by ρ, so that a bare function
answers Φ / hat, cut off where the hat is next to nothing. It is kept to be compared with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes.lattice import hat as hat_of
from lightwell.probes.pattern import Pattern
from lightwell.probes.weights.common import Close, WeightFunction

# Φ is divided by the hat or by this, whichever is larger.
EDGE = 1e-3


@dataclass(frozen=True)
class Bare:
    """``inner`` fitted to Φ; what is not named here is the inner function's."""

    inner: WeightFunction

    def __getattr__(self, name: str):
        if name.startswith("__") or name == "inner":
            raise AttributeError(name)
        return getattr(self.inner, name)

    @property
    def name(self) -> str:
        return f"bare-{self.inner.name}"

    @property
    def parameters(self) -> int:
        return self.inner.parameters

    @property
    def stored(self) -> int:
        return self.inner.stored

    def fit(self, target: np.ndarray, weight: np.ndarray, layout: Pattern, close: Close | None = None) -> np.ndarray:
        """[B, C] parameters for targets ρ [B, Q]; ``weight`` [B, Q] holds the hat's square, which Φ has already."""
        whole = layout.hat.astype(np.float32)
        if close is not None:
            near = hat_of(close.u).astype(np.float32)
            close = Close(close.u, close.target * near, _flat(close.weight, near))
        return self.inner.fit(target * whole, _flat(weight, whole), layout, close)


def _flat(weight: np.ndarray, hat: np.ndarray) -> np.ndarray:
    return (weight / np.maximum(hat, 0.02) ** 2).astype(np.float32)


def ratio(function: WeightFunction, rho: np.ndarray, hat: np.ndarray) -> np.ndarray:
    """What the hat is multiplied by, of trusted values [...] where the hat is [...]."""
    return rho / np.maximum(hat, EDGE) if isinstance(function, Bare) else rho


def core(function: WeightFunction) -> WeightFunction:
    """The function that holds the parameters."""
    return function.inner if isinstance(function, Bare) else function
