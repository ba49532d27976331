"""Scrambled Sobol sequences of few dimensions, the same numbers as ``scipy.stats.qmc.Sobol``.

SciPy's class is in a package whose import takes longer than all other imports of a bake together.

Direction numbers: S. Joe, F. Y. Kuo, *Constructing Sobol sequences with better two-dimensional projections*, 2008.
Scrambling: J. Matoušek, *On the L2-discrepancy for anchored boxes*, 1998 (left matrix scramble and digital shift).
"""

from __future__ import annotations

import numpy as np

# Binary digits of a number, and so the logarithm of the length of a sequence.
BITS = 30
# Primitive polynomials and first direction numbers of dimensions 2 to 7; those of dimension 1 are all 1.
POLYNOMIALS = (3, 7, 11, 13, 19, 25)
FIRST = ((1,), (1, 3), (1, 3, 1), (1, 1, 1), (1, 1, 3, 3), (1, 3, 5, 13))


class Sobol:
    """A scrambled Sobol sequence."""

    def __init__(self, dimensions: int, seed: int | np.random.Generator) -> None:
        """Scramble the sequence.

        Args:
            dimensions: Numbers per point, 1 to 7.
            seed: Seed of the scramble, or random numbers, of which a child is used so that their own stream stays.

        Raises:
            ValueError: There are no direction numbers for so many dimensions.
        """
        if not 1 <= dimensions <= 1 + len(FIRST):
            raise ValueError(f"a Sobol sequence has 1 to {1 + len(FIRST)} dimensions, found {dimensions}")
        rng = np.random.default_rng(seed) if isinstance(seed, int) else seed.spawn(1)[0]
        # [D, BITS] direction numbers.
        self._directions = _directions(dimensions)
        # [D] digital shift.
        self._shift = self._scramble(rng)
        # Points that were drawn.
        self._drawn = 0

    def _scramble(self, rng: np.random.Generator) -> np.ndarray:
        """Multiply the direction numbers by random lower triangular matrices; returns [D] random shifts."""
        shape = (len(self._directions), BITS)
        digits, matrices = (rng.integers(2, size=size, dtype=np.uint32) for size in (shape, (*shape, BITS)))
        powers = 2 ** np.arange(BITS, dtype=np.uint32)
        matrices = np.tril(matrices)
        matrices[:, np.arange(BITS), np.arange(BITS)] = 1
        # [D, direction, digit], the most significant digit first.
        before = (self._directions[:, :, None] >> np.arange(BITS - 1, -1, -1, dtype=np.uint32)) & 1
        after = np.einsum("dpk,djk->djp", matrices, before) % 2
        self._directions = (after * powers[::-1]).sum(axis=2, dtype=np.uint32)
        return (digits * powers).sum(axis=1, dtype=np.uint32)

    def random(self, count: int) -> np.ndarray:
        """Draw the next points.

        Args:
            count: Number of points, ≥ 1; the points drawn so far are best a power of two in number.

        Returns:
            [count, D] float64 in [0, 1).

        Raises:
            ValueError: More than 2^30 points are drawn.
        """
        if self._drawn + count > 1 << BITS:
            raise ValueError(f"a Sobol sequence has {1 << BITS} points; {self._drawn + count} were asked for")
        index = np.arange(self._drawn, self._drawn + count, dtype=np.uint32)
        self._drawn += count
        # Point i is the sum, without carry, of the direction numbers at the set digits of i's Gray code.
        gray = index ^ (index >> 1)
        found = np.broadcast_to(self._shift, (count, len(self._shift))).copy()
        for bit in range(int(gray.max()).bit_length()):
            found ^= ((gray >> bit) & 1)[:, None] * self._directions[:, bit]
        return found * 0.5**BITS


def _directions(dimensions: int) -> np.ndarray:
    """Compute [D, BITS] direction numbers, each shifted to ``BITS`` digits."""
    found = np.ones((dimensions, BITS), np.uint32)
    for row, polynomial, first in zip(found[1:], POLYNOMIALS, FIRST):
        degree = len(first)
        row[:degree] = first
        for j in range(degree, BITS):
            row[j] = row[j - degree]
            for k in range(degree):
                if (polynomial >> (degree - 1 - k)) & 1:
                    row[j] ^= row[j - k - 1] << (k + 1)
    return found << np.arange(BITS - 1, -1, -1, dtype=np.uint32)
