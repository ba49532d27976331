"""The published form of the weights: a function learns the whole weight Φ instead of a factor on the hat.

Our functions learn the ratio ρ = Φ / hat. Evaluators multiply the hat by ρ, so a bare function returns Φ / hat,
with the hat bounded from below. This form exists for comparison.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.probes.lattice import hat as hat_of
from lightwell.probes.pattern import Pattern
from lightwell.probes.weights.common import Close, WeightFunction

# Φ is divided by the hat or by this, whichever is larger.
EDGE = 1e-3


@dataclass(frozen=True)
class UnweightedTrilinear:
    """``inner`` fitted to Φ; every attribute that is not defined here is that of the inner function."""

    inner: WeightFunction
    """Function that holds the parameters."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "inner":
            raise AttributeError(name)
        return getattr(self.inner, name)

    @property
    def name(self) -> str:
        """Name with its sizes."""
        return f"bare-{self.inner.name}"

    @property
    def parameters(self) -> int:
        """C, the number of parameters."""
        return self.inner.parameters

    @property
    def stored(self) -> int:
        """Bytes of a record."""
        return self.inner.stored

    def fit(self, target: np.ndarray, weight: np.ndarray, layout: Pattern, close: Close | None = None) -> np.ndarray:
        """Fit the inner function to Φ = hat · ρ.

        Args:
            target: [B, Q] trust ρ at the points of the pattern.
            weight: [B, Q] weights of ``point_weight``; they contain the square of the hat, which is divided out.
            layout: The pattern.
            close: Places at surfaces; None for none.

        Returns:
            [B, C] parameters.
        """
        whole = layout.hat.astype(np.float32)
        if close is not None:
            near = hat_of(close.u).astype(np.float32)
            close = Close(close.u, close.target * near, _flat(close.weight, near))
        return self.inner.fit(target * whole, _flat(weight, whole), layout, close)


def _flat(weight: np.ndarray, hat: np.ndarray) -> np.ndarray:
    return (weight / np.maximum(hat, 0.02) ** 2).astype(np.float32)


def ratio(function: WeightFunction, rho: np.ndarray, hat: np.ndarray) -> np.ndarray:
    """Convert the value of a weight function to ρ, the factor on the hat.

    Args:
        function: The weight function.
        rho: [...] values after ``trusted``.
        hat: [...] trilinear weights.

    Returns:
        [...] ρ; ``rho`` itself unless the function is a ``UnweightedTrilinear`` one.
    """
    return rho / np.maximum(hat, EDGE) if isinstance(function, UnweightedTrilinear) else rho


def core(function: WeightFunction) -> WeightFunction:
    """Return the function whose parameters are stored.

    Args:
        function: The weight function.

    Returns:
        The inner function of a ``UnweightedTrilinear`` one, else the function itself.
    """
    return function.inner if isinstance(function, UnweightedTrilinear) else function
