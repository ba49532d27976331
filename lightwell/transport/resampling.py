"""Choice of one of several emitters by the light that it is likely to bring: resampled importance sampling.

Paper: Talbot, Cline & Egbert, *Importance Resampling for Global Illumination*, 2005.
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.transport.emitter_table import EmitterTable

# Emitters that are compared at a vertex; up to so many, the choice is by the estimates of all.
CANDIDATES = 64
# Share of the choices that heed no brightness: the brightest lamp may be behind a wall. Noise of a dark room beside one
# a thousand times brighter, over that without comparison: 3.9 with 0, 1.8 with 0.1, 1.5 with 0.25, 1.2 with 0.5; of the
# room with 64 lamps: standard deviations of 0.58, 0.65, 0.74 and 2.9 times the mean for 16.9.
EVEN = 0.25


def candidates(emitters: Any) -> Any:
    """Compute how many emitters are compared.

    Args:
        emitters: Number of emitters that there are.

    Returns:
        Number of candidates, at least 1.
    """
    return dr.clip(emitters, 1, CANDIDATES)


def nominal(count: Any) -> Any:
    """Compute a factor of the density of an even choice for MIS weights, which need the density of choices roughly.

    Where the brightest lamp is seen the true factor is near ``count``, where it is not below 1. The square root of the
    count has less noise than both (0.5 to 15 % in rooms with 7 and 10 lamps).

    Args:
        count: Number of candidates.

    Returns:
        The factor, the same for sampled directions and for those that a ray has found.
    """
    return dr.sqrt(mi.Float(count))


@dr.syntax
def chosen(
    table: EmitterTable,
    rows: tuple[mi.UInt32, mi.UInt32],
    it: mi.Interaction3f,
    number: mi.Float,
    active: mi.Bool,
) -> tuple[mi.UInt32, mi.Float, mi.Float]:
    """Choose one of some emitters by what each would bring if nothing were in the way.

    Args:
        table: The emitters.
        rows: Number of the first one in the table, and how many follow; one for all lanes, or [N].
        it: [N] places to light: surfaces with a view, or places with a normal whose other side stays dark.
        number: [N] numbers in [0, 1).
        active: [N] lanes.

    Returns:
        Number of the emitter in the table, one over the chance of the choice, and a number in [0, 1) that does not
        depend on it.
    """
    first, size = rows
    count, emitters = candidates(size), mi.Float(size)
    proposals = mi.Float(count)
    # Candidates are 1 / count apart in the number that chooses the first: none twice before all had their turn. They
    # depend on each other, which their mean does not see; the choice needs numbers that do not depend on them.
    bits = dr.reinterpret_array(mi.UInt32, number)
    left, even = mi.sample_tea_float32(bits, mi.UInt32(1)), mi.sample_tea_float32(bits, mi.UInt32(2))
    normal, side = _seen(it)

    def candidate(k: mi.UInt32) -> mi.UInt32:
        turn = number + mi.Float(k) / proposals
        return first + dr.minimum(mi.UInt32((turn - dr.floor(turn)) * emitters), size - 1)

    def brings(index: mi.UInt32) -> mi.Float:
        likely = table.likely(index, it.p, normal, side)
        return dr.select(active & dr.isfinite(likely), likely, 0)

    k, total, brought, best = mi.UInt32(0), mi.Float(0), mi.Float(0), mi.UInt32(first)
    while dr.hint(active & (k < count), label="lightwell emitters"):
        index = candidate(k)
        likely = brings(index)
        total += likely
        share = dr.select(total > 0, likely / total, 0)
        kept = left < share
        # What is left of the number chooses between this candidate and the next.
        left = dr.select(kept, left / share, (left - share) / (1 - share))
        best, brought = dr.select(kept, index, best), dr.select(kept, likely, brought)
        k += 1
    heedless = (even < EVEN) | (total <= 0)
    rest = dr.select(even < EVEN, even / EVEN, (even - EVEN) / (1 - EVEN))
    index = candidate(mi.UInt32(dr.minimum(rest * proposals, proposals - 1)))
    best, brought = dr.select(heedless, index, best), dr.select(heedless, brings(index), brought)
    share = dr.select(total > 0, (1 - EVEN) * brought / total + EVEN / proposals, dr.rcp(proposals))
    return best, emitters / (share * proposals), dr.clip(left, 0, 1 - 2.0**-24)


def _seen(it: mi.Interaction3f) -> tuple[Any, Any]:
    """The normal, and the cosine between it and the view."""
    if isinstance(it, mi.SurfaceInteraction3f):
        return it.sh_frame.n, mi.Frame3f.cos_theta(it.wi)
    return it.n, mi.Float(1)
