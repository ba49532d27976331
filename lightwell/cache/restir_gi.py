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
from lightwell.cache.path_context import PathContext
from lightwell.cache.path_loop import CachePath
from lightwell.cache.render_paths import render_path
from lightwell.cache.reservoir_merge import first_hit
from lightwell.transport.path_state import aim_at_light, is_delta
from lightwell.transport.sources import Emitters


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

    def copy(self) -> ReservoirSample:
        """Copy the sample, see ``Reservoir``.

        Returns:
            Reservoirs with the same secondary points.
        """
        out = ReservoirSample()
        out.x, out.ns, out.L = mi.Point3f(self.x), mi.Vector3f(self.ns), mi.Color3f(self.L)
        return out

    def take(self, other: ReservoirSample, taken: mi.Bool) -> None:
        """Replace the sample, see ``Reservoir``.

        Args:
            other: Reservoirs with the new samples.
            taken: [N] where they are taken.
        """
        self.x, self.ns = dr.select(taken, other.x, self.x), dr.select(taken, other.ns, self.ns)
        self.L = dr.select(taken, other.L, self.L)

    def target(self, scene: Any, si: Any, bsdf: Any, active: mi.Bool) -> mi.Float:
        """Evaluate the target function, see ``Reservoir``.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions.
            bsdf: Their BSDFs.
            active: [N] mask of the active lanes.

        Returns:
            [N] luminance of ``reached``.
        """
        return mi.luminance(reached(si, bsdf, self, active & (self.W > 0))[0])

    def moved(self, scene: Any, si: Any, bsdf: Any, active: mi.Bool) -> tuple[mi.Float, mi.Float]:
        """Evaluate the target function at another first hit, see ``Reservoir``.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions.
            bsdf: Their BSDFs.
            active: [N] mask of the active lanes.

        Returns:
            [N] target function p, and p W times the Jacobian.
        """
        value, cosine, distance2 = reached(si, bsdf, self, active & (self.W > 0))
        p = mi.luminance(value)
        back = self.p - self.x
        cosine_j = dr.dot(self.ns, back) * dr.rsqrt(dr.maximum(dr.squared_norm(back), 1e-20))
        jacobian = cosine / cosine_j * dr.squared_norm(back) / distance2
        return p, dr.select((p > 0) & (cosine_j > 0), p * self.W * jacobian, 0)

    def light(self, scene: Any, si: Any, bsdf: Any, active: mi.Bool) -> tuple[Any, mi.Bool]:
        """Evaluate the light of the secondary points, see ``Reservoir``.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions.
            bsdf: Their BSDFs.
            active: [N] mask of the active lanes.

        Returns:
            [N] radiance over W, and whether the points are visible.
        """
        value, _, _ = reached(si, bsdf, self, active)
        lit = active & (mi.luminance(value) > 0)
        return value, lit & ~scene.ray_test(si.spawn_ray_to(self.x), lit)


def direct_light(scene: Any, source: Emitters, si: Any, bsdf: Any, sampler: Any, active: Any) -> mi.Spectrum:
    """Sample an emitter at the first hit, with the MIS weight against BSDF sampling.

    Args:
        scene: Mitsuba scene.
        source: Its emitters.
        si: Surface interactions.
        bsdf: Their BSDFs.
        sampler: Source of random numbers.
        active: [N] mask of the active lanes.

    Returns:
        [N] weighted radiance.
    """
    aimed = aim_at_light(scene, si, source, sampler.next_2d(), active)
    value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(aimed.direction), active)
    light = aimed.traced(scene, active & (dr.max(value) > 0))
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
    rest = dr.select(usable, si.emitter(scene).eval(si, usable), 0) + direct_light(
        scene, context.emitters, si, bsdf, sampler, usable
    )
    sample, weight = bsdf.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d(), usable)
    path = CachePath()
    delta = is_delta(sample)
    path.leave(si, sample.wo, mi.Float(sample.pdf), mi.Spectrum(1), mi.Float(1), delta)
    path.active = usable & (dr.max(weight) > 0)
    path.depth = mi.UInt32(1)
    # The footprint of a secondary point counts as wide, so that the path ends in the cache there.
    path.foot.scattered, path.foot.run_pdf = mi.Bool(True), dr.select(delta, 0, path.prev_pdf)
    delta, active = mi.Bool(delta), mi.Bool(path.active)
    behind = scene.ray_intersect(path.ray, mi.RayFlags.All, False, active)
    Le, mis = path.meet(scene, behind, context.emitters)
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
    out.ns = dr.select(dr.dot(n, dr.normalize(behind.p - si.p)) > 0, -n, n)
    out.W, out.M = dr.select(shared, dr.rcp(sample.pdf), 0), dr.select(usable, mi.Float(1), 0)
    out.p, out.t, out.n = mi.Point3f(si.p), dr.select(usable, si.t, 0), mi.Vector3f(si.n)
    out.o, out.d = mi.Point3f(ray.o), mi.Vector3f(ray.d)
    return out, dr.select(dr.all(dr.isfinite(rest)), rest, 0), usable


def reached(si: Any, bsdf: Any, held: ReservoirSample, active: mi.Bool) -> tuple[Any, mi.Float, mi.Float]:
    """Evaluate the light from secondary points at first hits, without visibility.

    Args:
        si: Surface interactions of the first hits.
        bsdf: Their BSDFs.
        held: Secondary points and the radiance that leaves them.
        active: [N] mask of the active lanes.

    Returns:
        BSDF * L [N], cosine at the secondary point [N] and squared distance [N].
    """
    offset = held.x - si.p
    distance2 = dr.squared_norm(offset)
    direction = offset * dr.rsqrt(dr.maximum(distance2, 1e-20))
    cosine = -dr.dot(held.ns, direction)
    active = active & (cosine > 0) & (distance2 > 0)
    value = bsdf.eval(mi.BSDFContext(), si, si.to_local(direction), active) * held.L
    return dr.select(active & dr.all(dr.isfinite(value)), value, 0), cosine, distance2
