"""Reservoirs for indirect light at the first hit, after Ouyang et al. 2021.

A sample is a point x_s on a diffuse surface and the radiance L that leaves it. When it moves from first hit a to first
hit b, its weight is multiplied by the Jacobian (cos_b / cos_a) (|x_a - x_s|^2 / |x_b - x_s|^2), with angles at x_s.
Samples on surfaces that are not diffuse are not shared: they count for their own pixel only. L comes from the cache or
from a longer path.

Notation: N lanes; reservoirs (x_s, n_s, L, W, M) with W in solid angle at the first hit p.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.bounces import EMITTERS
from lightwell.cache.path_context import PathContext
from lightwell.cache.path_loop import CachePath
from lightwell.cache.render_paths import render_path
from lightwell.cache.restir import _alike, _neighbour, first_hit
from lightwell.transport.path_state import sample_light


class ReservoirSample:
    """One secondary point per lane, and the first hit it was sampled from."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "x": mi.Point3f, "ns": mi.Vector3f, "L": mi.Color3f, "W": mi.Float, "M": mi.Float, "p": mi.Point3f,
        "t": mi.Float, "n": mi.Vector3f, "o": mi.Point3f, "d": mi.Vector3f,
    }  # fmt: skip

    def __init__(self) -> None:
        """Make empty reservoirs."""
        self.x, self.ns, self.L = mi.Point3f(0), mi.Vector3f(0, 0, 1), mi.Color3f(0)
        """Secondary point, its normal on the side of the first hit, radiance that leaves it."""
        self.W, self.M = mi.Float(0), mi.Float(0)
        """Unbiased contribution weight, and number of candidates."""
        self.p, self.t, self.n = mi.Point3f(0), mi.Float(0), mi.Vector3f(0)
        """First hit: position, distance from the camera (0: no hit), normal."""
        self.o, self.d = mi.Point3f(0), mi.Vector3f(0, 0, 1)
        """Camera ray."""


def direct_light(scene: Any, si: Any, bsdf: Any, sampler: Any, active: Any) -> mi.Spectrum:
    """Sample an emitter at the first hit, with the MIS weight against BSDF sampling.

    Args:
        scene: Mitsuba scene.
        si: Surface interactions.
        bsdf: Their BSDFs.
        sampler: Source of random numbers.
        active: [N] mask of the active lanes.

    Returns:
        [N] weighted radiance.
    """
    light = sample_light(scene, si, EMITTERS, sampler.next_2d(), active)
    value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(light.direction), light.seen)
    return dr.select(light.seen, value * light.weight * light.mis(pdf), 0)


def choose(
    scene: Any, ray: Any, sampler: Any, context: PathContext, evaluate: Callable[[Any, Any], Any], caching: bool
) -> tuple[ReservoirSample, mi.Color3f, mi.Bool]:
    """Sample one bounce per lane.

    Args:
        scene: Mitsuba scene.
        ray: [N] camera rays.
        sampler: Source of random numbers.
        context: ``PathContext`` of the paths.
        evaluate: Function of vertices and a mask, with the cache's radiance [N].
        caching: Whether paths may end in the cache.

    Returns:
        Reservoirs of the light that can be shared, all other light at the first hits [N], and mask of the first hits
        that use reservoirs [N].
    """
    si, bsdf, usable = first_hit(scene, ray)
    rest = dr.select(usable, si.emitter(scene).eval(si, usable), 0) + direct_light(scene, si, bsdf, sampler, usable)
    sample, weight = bsdf.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d(), usable)
    path = CachePath()
    delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
    path.leave(si, sample.wo, mi.Float(sample.pdf), mi.Spectrum(1), mi.Float(1), delta)
    path.active = usable & (dr.max(weight) > 0)
    path.depth = mi.UInt32(1)
    # The footprint of a secondary point counts as wide, so that the path ends in the cache there.
    path.foot.scattered, path.foot.run_pdf = mi.Bool(True), dr.select(delta, 0, path.prev_pdf)
    delta, active = mi.Bool(delta), mi.Bool(path.active)
    behind = scene.ray_intersect(path.ray, mi.RayFlags.All, False, active)
    Le, mis = path.meet(scene, behind, EMITTERS)
    emitted = dr.select(active, mis * Le, 0)
    L, *_ = render_path(scene, sampler, path, context, evaluate, mi.Float(1), caching, "biased", True)
    L = dr.select(active & behind.is_valid(), L - emitted, 0)
    flags = behind.bsdf().flags()
    rough = mi.has_flag(flags, mi.BSDFFlags.Diffuse) & ~mi.has_flag(flags, mi.BSDFFlags.Glossy)
    shared = active & behind.is_valid() & rough & ~mi.has_flag(flags, mi.BSDFFlags.Delta) & ~delta & (sample.pdf > 0)
    rest += dr.select(active, weight * (emitted + dr.select(shared, 0, L)), 0)

    out = ReservoirSample()
    out.x, out.L = mi.Point3f(behind.p), mi.Color3f(dr.select(shared, L, 0))
    n = mi.Vector3f(behind.n)
    out.ns = dr.select(dr.dot(n, walk_direction(si, behind)) > 0, -n, n)
    out.W, out.M = dr.select(shared, dr.rcp(sample.pdf), 0), dr.select(usable, mi.Float(1), 0)
    out.p, out.t, out.n = mi.Point3f(si.p), dr.select(usable, si.t, 0), mi.Vector3f(si.n)
    out.o, out.d = mi.Point3f(ray.o), mi.Vector3f(ray.d)
    return out, dr.select(dr.all(dr.isfinite(rest)), rest, 0), usable


def walk_direction(si: Any, behind: Any) -> mi.Vector3f:
    """Compute the direction from the first hit to the secondary point.

    Args:
        si: Surface interactions of the first hits.
        behind: Surface interactions of the secondary points.

    Returns:
        [N] unit directions.
    """
    return dr.normalize(behind.p - si.p)


def reached(
    si: Any, bsdf: Any, x: mi.Point3f, ns: mi.Vector3f, L: mi.Color3f, active: mi.Bool
) -> tuple[Any, mi.Float, mi.Float]:
    """Evaluate the light from a secondary point at a first hit, without visibility.

    Args:
        si: Surface interactions of the first hits.
        bsdf: Their BSDFs.
        x: [N] secondary points, metres.
        ns: [N] unit normals there.
        L: [N] radiance that leaves them.
        active: [N] mask of the active lanes.

    Returns:
        BSDF * L [N], cosine at the secondary point [N] and squared distance [N].
    """
    offset = x - si.p
    distance2 = dr.squared_norm(offset)
    direction = offset * dr.rsqrt(dr.maximum(distance2, 1e-20))
    cosine = -dr.dot(ns, direction)
    active = active & (cosine > 0) & (distance2 > 0)
    value = bsdf.eval(mi.BSDFContext(), si, si.to_local(direction), active) * L
    return dr.select(active & dr.all(dr.isfinite(value)), value, 0), cosine, distance2


def visible(scene: Any, si: Any, x: mi.Point3f, active: mi.Bool) -> mi.Bool:
    """Test visibility between first hits and points.

    Args:
        scene: Mitsuba scene.
        si: Surface interactions of the first hits.
        x: [N] points, metres.
        active: [N] mask of the active lanes.

    Returns:
        [N] mask of the active lanes without an occluder.
    """
    return active & ~scene.ray_test(si.spawn_ray_to(x), active)


@dr.syntax
def shade(
    scene: Any, ray: Any, sampler: Any, held: ReservoirSample, width: mi.UInt32, height: mi.UInt32, spp: mi.UInt32,
    count: int, unbiased: bool,
) -> tuple[Any, mi.Float, mi.Float]:  # fmt: skip
    """Compute the shared light at the first hits after spatial reuse of neighbours' reservoirs.

    Args:
        scene: Mitsuba scene.
        ray: [N] camera rays.
        sampler: Source of random numbers.
        held: Reservoirs of this pass.
        width: Image width, pixels.
        height: Image height, pixels.
        spp: Samples per pixel of this pass.
        count: Neighbours, ≥ 0.
        unbiased: Whether merging is unbiased, see ``restir.shade``.

    Returns:
        Radiance [N], weights W [N] and candidate counts M [N] after merging.
    """
    lane = dr.arange(mi.UInt32, dr.width(held.W))
    pixel, s = lane // spp, lane % spp
    at = mi.Point2f(mi.Float(pixel % width), mi.Float(pixel // width))
    si, bsdf, usable = first_hit(scene, ray)
    angle, offset_r = sampler.next_1d() * dr.two_pi, sampler.next_1d()

    x, ns, L, M = mi.Point3f(held.x), mi.Vector3f(held.ns), mi.Color3f(held.L), mi.Float(held.M)
    value, cosine, distance2 = reached(si, bsdf, x, ns, L, usable & (held.W > 0))
    best = mi.luminance(value)
    total = best * held.W * held.M
    k = mi.UInt32(0)
    while dr.hint(k < count, label="lightwell nrc bounced neighbours"):
        i = _neighbour(at, angle, offset_r, k, count, width, height) * spp + s
        other = dr.gather(ReservoirSample, held, i, usable)
        alike = usable & _alike(other, si, i != lane)
        value, cosine, distance2 = reached(si, bsdf, other.x, other.ns, other.L, alike & (other.W > 0))
        p = mi.luminance(value)
        back = other.p - other.x
        cosine_j = dr.dot(other.ns, back) * dr.rsqrt(dr.maximum(dr.squared_norm(back), 1e-20))
        jacobian = cosine / cosine_j * dr.squared_norm(back) / distance2
        w = dr.select((p > 0) & (cosine_j > 0), p * other.W * jacobian * other.M, 0)
        w = dr.select(dr.isfinite(w), w, 0)
        total += w
        M += dr.select(alike, other.M, 0)
        taken = sampler.next_1d() * total < w
        x, ns, L = dr.select(taken, other.x, x), dr.select(taken, other.ns, ns), dr.select(taken, other.L, L)
        best = dr.select(taken, p, best)
        k += 1
    if dr.hint(unbiased, mode="scalar"):
        M = dr.select(_possible(scene, held.o, held.d, x, ns, L, usable), held.M, 0)
        k = mi.UInt32(0)
        while dr.hint(k < count, label="lightwell nrc bounced possible"):
            i = _neighbour(at, angle, offset_r, k, count, width, height) * spp + s
            other = dr.gather(ReservoirSample, held, i, usable)
            alike = usable & _alike(other, si, i != lane)
            M += dr.select(_possible(scene, other.o, other.d, x, ns, L, alike), other.M, 0)
            k += 1
    W = dr.select((best > 0) & (M > 0), total / (M * best), 0)
    value, _, _ = reached(si, bsdf, x, ns, L, usable & (W > 0))
    out = dr.select(visible(scene, si, x, usable & (W > 0)), value * W, 0)
    return dr.select(dr.all(dr.isfinite(out)), out, 0), W, M


def _possible(scene, o, d, x, ns, L, active) -> mi.Bool:
    """Test whether the first hit of a camera ray could have sampled the secondary point."""
    si, bsdf, usable = first_hit(scene, mi.Ray3f(o, d), active)
    active = active & usable
    value, _, _ = reached(si, bsdf, x, ns, L, active)
    return visible(scene, si, x, active & (mi.luminance(value) > 0))
