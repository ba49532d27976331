"""Spatial reuse: the reservoir of each pixel is merged with those of its neighbours.

The same for direct light (``restir``) and indirect light (``restir_gi``): their reservoirs evaluate their own samples.
Notation: N lanes; W unbiased contribution weight, M number of candidates.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from lightwell.backend import dr, mi

if TYPE_CHECKING:
    from typing_extensions import Self

# Radius of spatial reuse, pixels.
RADIUS = 30.0
# Neighbours whose surfaces differ by more are not used: relative depth; cosine between normals (25 degrees).
DEPTH, NORMAL = 0.1, 0.906
# Angle between successive neighbours: the golden angle, radians.
GOLDEN_ANGLE = 2.399963


class Reservoir(Protocol):
    """One sample per lane, and the first hit it was chosen for."""

    W: mi.Float
    M: mi.Float
    t: mi.Float
    """[N] distance of the first hit from the camera; 0: no hit."""
    n: mi.Vector3f
    """[N] its normal."""
    o: mi.Point3f
    d: mi.Vector3f
    """[N] camera ray."""

    def copy(self) -> Self:
        """Copy the sample.

        Returns:
            Reservoirs with the same sample.
        """
        ...

    def take(self, other: Self, taken: mi.Bool) -> None:
        """Replace the sample.

        Args:
            other: Reservoirs with the new samples.
            taken: [N] where they are taken.
        """

    def target(self, scene: Any, si: Any, bsdf: Any, active: mi.Bool) -> mi.Float:
        """Evaluate the target function at the first hit that the sample was chosen for.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions.
            bsdf: Their BSDFs.
            active: [N] mask of the active lanes.

        Returns:
            [N] target function, ≥ 0.
        """
        ...

    def moved(self, scene: Any, si: Any, bsdf: Any, active: mi.Bool) -> tuple[mi.Float, mi.Float]:
        """Evaluate the target function at another first hit.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions.
            bsdf: Their BSDFs.
            active: [N] mask of the active lanes.

        Returns:
            [N] target function p, and p W times the Jacobian of the move.
        """
        ...

    def light(self, scene: Any, si: Any, bsdf: Any, active: mi.Bool) -> tuple[Any, mi.Bool]:
        """Evaluate the light of the sample at a first hit.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions.
            bsdf: Their BSDFs.
            active: [N] mask of the active lanes.

        Returns:
            [N] radiance over W, and whether the light is visible.
        """
        ...


def first_hit(scene: Any, ray: Any, active: mi.Bool | bool = True) -> tuple[Any, Any, mi.Bool]:
    """Intersect camera rays with the scene.

    Args:
        scene: Mitsuba scene.
        ray: [N] camera rays.
        active: [N] mask of the active lanes.

    Returns:
        Surface interactions, BSDFs, and mask of the surfaces with a component that is not a delta function [N].
    """
    si = scene.ray_intersect(ray, mi.RayFlags.All, True, mi.Bool(active))
    bsdf = si.bsdf(ray)
    return si, bsdf, si.is_valid() & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)


def shade(
    scene: Any, ray: Any, sampler: Any, held: Reservoir, size: tuple[mi.UInt32, ...], count: int, unbiased: bool
) -> tuple[Any, mi.Float, mi.Float]:
    """Compute the light at the first hits after spatial reuse of neighbours' reservoirs.

    Args:
        scene: Mitsuba scene.
        ray: [N] camera rays.
        sampler: Source of random numbers.
        held: Reservoirs of the pass.
        size: Image width and height in pixels, and samples per pixel of the pass.
        count: Neighbours, ≥ 0.
        unbiased: Whether merging is unbiased, see ``merge``.

    Returns:
        Radiance [N], 0 where there are no reservoirs; weights W [N] and candidate counts M [N] after merging.
    """
    hit = si, bsdf, usable = first_hit(scene, ray)
    kept, W, M = merge(scene, hit, sampler, held, size, count, unbiased)
    value, seen = kept.light(scene, si, bsdf, usable & (W > 0))
    L = dr.select(seen, value * W, 0)
    return dr.select(dr.all(dr.isfinite(L)), L, 0), W, M


@dr.syntax
def merge(
    scene: Any, hit: tuple[Any, Any, mi.Bool], sampler: Any, held: Reservoir, size: tuple[mi.UInt32, ...], count: int,
    unbiased: bool,
) -> tuple[Any, mi.Float, mi.Float]:  # fmt: skip
    """Merge the reservoirs of a pass with those of their neighbours.

    Biased merging divides by all candidates and is too dark where neighbours could not have generated the sample.
    Unbiased merging divides by the candidates of those that could: their target function, with visibility, is evaluated
    again.

    Args:
        scene: Mitsuba scene.
        hit: First hits of the pass, see ``first_hit``.
        sampler: Source of random numbers.
        held: Reservoirs of the pass.
        size: Image width and height in pixels, and samples per pixel of the pass.
        count: Neighbours, ≥ 0.
        unbiased: Whether merging is unbiased.

    Returns:
        Merged reservoirs (their sample), weights W [N] and candidate counts M [N].
    """
    si, bsdf, usable = hit
    spp = size[2]
    lane = dr.arange(mi.UInt32, dr.width(held.W))
    pixel, s = lane // spp, lane % spp
    turn = (sampler.next_1d() * dr.two_pi, sampler.next_1d())

    kept, M = held.copy(), mi.Float(held.M)  # Copies: the next pass reuses ``held``.
    best = held.target(scene, si, bsdf, usable)
    total = best * held.W * held.M
    k = mi.UInt32(0)
    while dr.hint(k < count, label="lightwell nrc neighbours"):
        i = _neighbour(pixel, turn, k, count, size) * spp + s
        other = dr.gather(type(held), held, i, usable)
        alike = usable & _alike(other, si) & (i != lane)
        p, weight = other.moved(scene, si, bsdf, alike)
        w = dr.select(alike, weight * other.M, 0)
        w = dr.select(dr.isfinite(w), w, 0)
        total += w
        M += dr.select(alike, other.M, 0)
        taken = sampler.next_1d() * total < w
        kept.take(other, taken)
        best = dr.select(taken, p, best)
        k += 1
    if dr.hint(unbiased, mode="scalar"):
        M = dr.select(_possible(scene, kept, held, usable), held.M, 0)
        k = mi.UInt32(0)
        while dr.hint(k < count, label="lightwell nrc possible"):
            i = _neighbour(pixel, turn, k, count, size) * spp + s
            other = dr.gather(type(held), held, i, usable)
            alike = usable & _alike(other, si) & (i != lane)
            M += dr.select(_possible(scene, kept, other, alike), other.M, 0)
            k += 1
    return kept, dr.select((best > 0) & (M > 0), total / (M * best), 0), M


def _possible(scene: Any, kept: Reservoir, other: Reservoir, active: mi.Bool) -> mi.Bool:
    """Test whether the first hit of ``other`` could have generated the sample of ``kept`` with a weight above 0."""
    si, bsdf, usable = first_hit(scene, mi.Ray3f(other.o, other.d), active)
    value, seen = kept.light(scene, si, bsdf, active & usable)
    return seen & (mi.luminance(value) > 0)


def _neighbour(
    pixel: mi.UInt32, turn: tuple[mi.Float, mi.Float], k: mi.UInt32, count: int, size: tuple[mi.UInt32, ...]
) -> mi.UInt32:
    """Return the pixel index of the k-th neighbour: golden-angle spiral in a disc, mirrored at the image border."""
    width, height, _ = size
    r = dr.sqrt((mi.Float(k) + 0.25 + 0.75 * turn[1]) / count) * RADIUS
    angle = turn[0] + mi.Float(k) * GOLDEN_ANGLE
    x, y = mi.Float(pixel % width) + r * dr.cos(angle), mi.Float(pixel // width) + r * dr.sin(angle)
    w, h = mi.Float(width), mi.Float(height)
    x, y = dr.abs(x), dr.abs(y)
    x = dr.clip(dr.select(x > w - 1, 2 * (w - 1) - x, x), 0, w - 1)
    y = dr.clip(dr.select(y > h - 1, 2 * (h - 1) - y, y), 0, h - 1)
    return mi.UInt32(dr.round(x)) + mi.UInt32(dr.round(y)) * width


def _alike(other: Reservoir, si: Any) -> mi.Bool:
    """Test whether a neighbour's surface has a similar depth and normal."""
    return (other.t > 0) & (dr.abs(other.t / si.t - 1) < DEPTH) & (dr.dot(other.n, si.n) > NORMAL)
