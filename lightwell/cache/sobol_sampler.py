"""Random numbers of rendering paths: scrambled (0,2) sequences with a fresh shuffle for every pair of dimensions.

Paths that end in the cache are short, so the integrand has few dimensions and low-discrepancy points reduce its
variance. Sobol 1967; Owen 1995 (scrambling); Burley 2020, *Practical Hash-based Owen Scrambling* (shuffled, scrambled,
padded).
"""

from __future__ import annotations

from lightwell.backend import dr, mi

# Pascal's triangle modulo two, the generator matrix of Sobol's second dimension, is a Kronecker power: five steps.
PASCAL = ((1, 0xAAAAAAAA), (2, 0xCCCCCCCC), (4, 0xF0F0F0F0), (8, 0xFF00FF00), (16, 0xFFFF0000))
# Odd constants that mix bits: the golden ratio and the finaliser of Murmur3.
GOLDEN, MIX_1, MIX_2 = 0x9E3779B9, 0x85EBCA6B, 0xC2B2AE35
# Multipliers of the permutation of reversed bits that acts like an Owen scramble (Laine & Karras 2011).
OWEN = (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6)
ONE_MINUS_EPSILON = 1 - 2.0**-24


def mixed(x: mi.UInt32) -> mi.UInt32:
    """Hash 32-bit numbers bijectively (finaliser of MurmurHash3).

    Args:
        x: [N] 32-bit numbers.

    Returns:
        [N] hashed numbers.
    """
    x = (x ^ (x >> 16)) * mi.UInt32(MIX_1)
    x = (x ^ (x >> 13)) * mi.UInt32(MIX_2)
    return x ^ (x >> 16)


def owen(x: mi.UInt32, seed: mi.UInt32) -> mi.UInt32:
    """Apply a nested uniform scramble to bit-reversed numbers: each bit is flipped depending on those below it.

    Args:
        x: [N] bit-reversed 32-bit numbers.
        seed: Seed of the scramble.

    Returns:
        [N] scrambled numbers, still bit-reversed.

    Reference: Laine and Karras 2011, *Stratified Sampling for Stochastic Transparency*.
    """
    x = x + seed
    for factor in OWEN:
        x ^= x * mi.UInt32(factor)
    return x


def unit(x: mi.UInt32) -> mi.Float:
    """Convert 32-bit numbers to fractions.

    Args:
        x: [N] 32-bit numbers.

    Returns:
        [N] numbers in [0, 1).
    """
    return dr.minimum(mi.Float(x) * 2.0**-32, ONE_MINUS_EPSILON)


def point(reversed_index: mi.UInt32, seed: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
    """Compute a point of a shuffled and scrambled (0,2) sequence.

    Args:
        reversed_index: [N] index of the point, its bits reversed.
        seed: Seed of shuffle and scramble, hashed.

    Returns:
        Both coordinates as 32-bit fractions, [N] each.
    """
    # Shuffle: an Owen scramble of the index keeps its blocks of powers of two together.
    index = dr.brev(owen(reversed_index, seed))
    second = index
    for step, mask in PASCAL:
        second = second ^ ((second & mi.UInt32(mask)) >> step)
    # The radical inverse reverses the bits; scrambling works on reversed bits: the two cancel. A bit is flipped by
    # hash bits that are not above it: with the halves of the hash exchanged, the first 16 bits of both share none.
    seed = mixed(seed ^ mi.UInt32(GOLDEN))
    x, y = owen(index, seed), owen(second, (seed << 16) | (seed >> 16))
    return dr.brev(x), dr.brev(y)


class SobolSampler:
    """Random numbers of one sample of one pixel, with the methods of a Mitsuba sampler that paths call."""

    DRJIT_STRUCT = {"reversed": mi.UInt32, "seed": mi.UInt32, "dimension": mi.UInt32}  # noqa: RUF012

    def __init__(self, index: mi.UInt32 | None = None, seed: mi.UInt32 | None = None) -> None:
        """Start at the first dimension of a sample.

        Args:
            index: [N] index of the sample in its pixel; None: 0.
            seed: [N] seed of the pixel; None: 0.
        """
        self.reversed = mi.UInt32(0) if index is None else dr.brev(mi.UInt32(index))
        self.seed = mi.UInt32(0) if seed is None else mi.UInt32(seed)
        self.dimension = mi.UInt32(0)

    def next_2d(self, active: mi.Bool | bool = True) -> mi.Point2f:
        """Draw the next two-dimensional point.

        Args:
            active: Ignored; for the interface of Mitsuba's samplers.

        Returns:
            [N] points in [0, 1)^2.
        """
        self.dimension += 1
        x, y = point(self.reversed, mixed(self.seed ^ (self.dimension * mi.UInt32(GOLDEN))))
        return mi.Point2f(unit(x), unit(y))

    def next_1d(self, active: mi.Bool | bool = True) -> mi.Float:
        """Draw the next number.

        Args:
            active: Ignored; for the interface of Mitsuba's samplers.

        Returns:
            [N] numbers in [0, 1).
        """
        self.dimension += 1
        seed = mixed(self.seed ^ (self.dimension * mi.UInt32(GOLDEN)))
        index = dr.brev(owen(self.reversed, seed))
        return unit(dr.brev(owen(index, mixed(seed ^ mi.UInt32(GOLDEN)))))


def draws(pixel: mi.UInt32, index: mi.UInt32, seed: mi.UInt32) -> SobolSampler:
    """Make the random numbers of samples of pixels.

    Args:
        pixel: [N] index of the pixel.
        index: [N] index of the sample in the pixel.
        seed: Seed of the image.

    Returns:
        Random numbers, one sequence per lane.
    """
    return SobolSampler(index, mixed(mixed(pixel + mi.UInt32(GOLDEN)) ^ seed))
