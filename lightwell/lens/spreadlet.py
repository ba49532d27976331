"""A spreadlet: a small signed point set that represents one point spread function."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.lens.score import LibraryScore, integrate

# Plane to which the points of a spreadlet are added.
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
    score: LibraryScore
    """Errors after quantisation."""

    @property
    def values(self) -> np.ndarray:
        """[n] float64 values."""
        return self.q.astype(np.float64) * self.scale

    def __len__(self) -> int:
        return len(self.q)


def response_of(spreadlet: Spreadlet, half: tuple[int, int]) -> np.ndarray:
    """Compute the picture that a spreadlet alone produces, by the exact solve.

    Args:
        spreadlet: The spreadlet.
        half: Half height hy and half width hx of the picture, pixels; the points must lie inside.

    Returns:
        Picture [2·hy+1, 2·hx+1] of one unit of light in the middle.
    """
    if spreadlet.kind == CHARGE:
        return integrate(spreadlet.x, spreadlet.y, spreadlet.values, half)
    image = np.zeros((2 * half[0] + 1, 2 * half[1] + 1))
    np.add.at(image, (spreadlet.y + half[0], spreadlet.x + half[1]), spreadlet.values)
    return image
