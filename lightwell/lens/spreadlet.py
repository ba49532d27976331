"""A spreadlet: the small signed point set that stands for one point spread function."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.lens.score import Score

# What the points of a spreadlet are added to.
PRIMAL, CHARGE = 0, 1
KINDS = ("primal", "charge")


@dataclass(frozen=True)
class Spreadlet:
    """One representation of one kernel."""

    kind: int
    """``PRIMAL``: values are light, added to the picture. ``CHARGE``: added to −Δ of the picture."""
    x: np.ndarray
    """[n] int16, pixels to the right of the source."""
    y: np.ndarray
    """[n] int16, pixels below the source."""
    q: np.ndarray
    """[n] int16 values; Σ q = 0 for charges."""
    scale: float
    """float32: value = q · scale."""
    recipe: str
    """How it was made: primal, lossless, sparse, voronoi."""
    score: Score
    """How far it is from its kernel, after quantisation."""

    @property
    def values(self) -> np.ndarray:
        """[n] float64 values."""
        return self.q.astype(np.float64) * self.scale

    def __len__(self) -> int:
        return len(self.q)

    def mirrored(self) -> Spreadlet:
        """The same kernel in front of focus: every offset negated."""
        return Spreadlet(self.kind, -self.x, -self.y, self.q, self.scale, self.recipe, self.score)
