"""Footprints of paths, which tell where a path may end in the cache.

Papers: Bekaert et al. 2003; Müller et al. 2021. Notation: N lanes.
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.bounces import Bounce


def footprint(t: mi.Float, cosine: mi.Float) -> mi.Float:
    """Compute the footprint of a camera ray at its hit, independent of the pixel size: t² / (4π |cos|).

    Args:
        t: [N] distance from the camera, metres.
        cosine: [N] cosine between ray and normal.

    Returns:
        [N] areas, m².
    """
    return dr.square(t) * dr.inv_four_pi / dr.abs(cosine)


def spread(t: mi.Float, pdf: mi.Float, cosine: mi.Float) -> mi.Float:
    """Compute the square root of the footprint of a scattered ray at its hit.

    Args:
        t: [N] distance, metres.
        pdf: [N] density of the direction per steradian.
        cosine: [N] cosine between ray and normal.

    Returns:
        [N] lengths, metres; infinity, which ends the path, where the footprint is undefined.
    """
    density = pdf * dr.abs(cosine)
    return dr.select(density > 0, t * dr.rsqrt(density), dr.inf)


class PathSpread:
    """Footprint of a path since the primary hit (Bekaert et al. 2003; Müller et al. 2021)."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "a0": mi.Float, "s": mi.Float, "run": mi.Float, "run_pdf": mi.Float, "scattered": mi.Bool,
    }  # fmt: skip

    def __init__(self) -> None:
        self.a0 = mi.Float(0)
        """Footprint of the primary hit."""
        self.s = mi.Float(0)
        """Square root of the footprint of the path."""
        self.run, self.run_pdf = mi.Float(0), mi.Float(0)
        """Distance since the last vertex that scattered (null interfaces do not) and density of the direction there;
        0 after delta bounces."""
        self.scattered = mi.Bool(False)
        """Whether there was such a vertex after the camera."""

    def arrive(self, si: Any, ray: Any) -> mi.Float:
        """Add the segment that ends at ``si``.

        Args:
            si: Surface interactions at the end of the segment.
            ray: Rays of the segment.

        Returns:
            [N] length that the vertex would add to ``s``, metres.
        """
        cosine = dr.dot(si.n, ray.d)
        self.run += si.t
        self.a0 = dr.select(self.scattered, self.a0, footprint(self.run, cosine))
        return dr.select(self.scattered & (self.run_pdf > 0), spread(self.run, self.run_pdf, cosine), 0)

    def leave(self, added: mi.Float, bounce: Bounce, active: mi.Bool) -> None:
        """Continue after a vertex.

        Args:
            added: [N] result of ``arrive``.
            bounce: Sampled directions at the vertex.
            active: [N] mask of the paths that continue.
        """
        self.s += dr.select(active & ~bounce.null, added, 0)
        self.run = dr.select(bounce.null, self.run, 0)
        self.run_pdf = dr.select(bounce.null, self.run_pdf, dr.select(bounce.delta, 0, bounce.pdf))
        self.scattered |= active & ~bounce.null

    def ratio(self) -> mi.Float:
        """Compute the footprint of the path over that of the primary hit.

        Returns:
            [N] ratio a / a0.
        """
        return dr.square(self.s) / self.a0

    def wide(self, added: mi.Float, c: mi.Float) -> mi.Bool:
        """Test whether the footprint is so wide at a vertex that the path may end in the cache.

        Args:
            added: [N] result of ``arrive``.
            c: Threshold on the footprint over that of the primary hit, ≥ 0.

        Returns:
            [N] mask; False before a vertex that scatters.
        """
        return self.scattered & (dr.square(self.s + added) > c * self.a0)
