"""Reservoirs for direct light at the first hit, after Bitterli et al. 2020, in primary sample space.

A light sample is the pair of random numbers u in [0, 1)^2 that Mitsuba's emitter sampling maps to a point on a light.
The target function of a pixel is lum(BSDF * weight(u)) without visibility. Because all pixels share the unit square,
samples move between pixels without a Jacobian, for any kind of light.

Notation: N lanes, reservoir (u, W, M), candidates with density 1 in u.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.reservoir_merge import DEPTH, NORMAL, first_hit

# Neighbours of spatial reuse (passes x neighbours: biased 2 x 5 as one pass of 5, unbiased 1 x 3).
NEIGHBOURS = {"biased": 5, "unbiased": 3}
# Largest candidate count of a temporal reservoir over the number of new candidates.
HISTORY = 20.0


class Reservoirs:
    """One light sample per lane, and the surface it was chosen for."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "u": mi.Point2f, "W": mi.Float, "M": mi.Float, "t": mi.Float, "n": mi.Vector3f,
        "o": mi.Point3f, "d": mi.Vector3f,
    }  # fmt: skip

    def __init__(self) -> None:
        """Make empty reservoirs."""
        self.u, self.W, self.M = mi.Point2f(0), mi.Float(0), mi.Float(0)
        """Sample, its unbiased contribution weight, and its number of candidates."""
        self.t, self.n = mi.Float(0), mi.Vector3f(0)
        """Distance and normal of the surface; t = 0: no surface."""
        self.o, self.d = mi.Point3f(0), mi.Vector3f(0, 0, 1)
        """Camera ray, from which the surface is computed again."""

    def copy(self) -> Reservoirs:
        """Copy the sample, see ``Reservoir``.

        Returns:
            Reservoirs with the same sample.
        """
        out = Reservoirs()
        out.u = mi.Point2f(self.u)
        return out

    def take(self, other: Reservoirs, taken: mi.Bool) -> None:
        """Replace the sample, see ``Reservoir``.

        Args:
            other: Reservoirs with the new samples.
            taken: [N] where they are taken.
        """
        self.u = dr.select(taken, other.u, self.u)

    def target(self, scene: Any, si: Any, bsdf: Any, active: mi.Bool) -> mi.Float:
        """Evaluate the target function, see ``Reservoir``.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions.
            bsdf: Their BSDFs.
            active: [N] mask of the active lanes.

        Returns:
            [N] luminance of ``contribution``, ≥ 0.
        """
        return target(scene, si, bsdf, self.u, active)

    def moved(self, scene: Any, si: Any, bsdf: Any, active: mi.Bool) -> tuple[mi.Float, mi.Float]:
        """Evaluate the target function at another first hit; there is no Jacobian, see ``Reservoir``.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions.
            bsdf: Their BSDFs.
            active: [N] mask of the active lanes.

        Returns:
            [N] target function p, and p W.
        """
        p = target(scene, si, bsdf, self.u, active)
        return p, p * self.W

    def light(self, scene: Any, si: Any, bsdf: Any, active: mi.Bool) -> tuple[Any, mi.Bool]:
        """Evaluate the light of the sample, see ``Reservoir``.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions.
            bsdf: Their BSDFs.
            active: [N] mask of the active lanes.

        Returns:
            [N] radiance over W, and whether the light is visible.
        """
        value, ds = contribution(scene, si, bsdf, self.u, active)
        lit = active & (mi.luminance(value) > 0)
        return value, lit & ~scene.ray_test(si.spawn_ray_to(ds.p), lit)


def contribution(scene: Any, si: Any, bsdf: Any, u: mi.Point2f, active: mi.Bool) -> tuple[Any, Any]:
    """Evaluate a light sample without visibility; its density in u is 1.

    Args:
        scene: Mitsuba scene.
        si: Surface interactions.
        bsdf: Their BSDFs.
        u: [N] random numbers in [0, 1)^2.
        active: [N] mask of the active lanes.

    Returns:
        [N] BSDF times emitter weight, and the direction samples [N].
    """
    ds, weight = scene.sample_emitter_direction(si, u, False, active)
    value = bsdf.eval(mi.BSDFContext(), si, si.to_local(ds.d), active & (ds.pdf != 0))
    out = value * weight
    return dr.select(active & (ds.pdf != 0) & dr.all(dr.isfinite(out)), out, 0), ds


def target(scene: Any, si: Any, bsdf: Any, u: mi.Point2f, active: mi.Bool) -> mi.Float:
    """Evaluate the target function of the reservoirs.

    Args:
        scene: Mitsuba scene.
        si: Surface interactions.
        bsdf: Their BSDFs.
        u: [N] random numbers in [0, 1)^2.
        active: [N] mask of the active lanes.

    Returns:
        [N] luminance of ``contribution``, ≥ 0.
    """
    value, _ = contribution(scene, si, bsdf, u, active)
    return dr.maximum(mi.luminance(value), 0)


@dr.syntax
def choose(
    scene: Any, ray: Any, sampler: Any, candidates: mi.UInt32, before: Reservoirs, temporal: bool, film: Any = None,
    width: mi.UInt32 | int = 0, height: mi.UInt32 | int = 0,
) -> Reservoirs:  # fmt: skip
    """Fill one reservoir per lane: initial candidates, one shadow ray, and temporal reuse.

    Args:
        scene: Mitsuba scene.
        ray: [N] camera rays.
        sampler: Source of random numbers.
        candidates: Number of initial candidates, ≥ 1.
        before: Reservoirs of the last pass, one per pixel.
        temporal: Whether ``before`` is used.
        film: Projection of the last pass from world space to [0, 1]^2 (``world_to_film``), so that reservoirs follow
            their surfaces when the camera moves; None: the camera has not moved.
        width: Image width, pixels.
        height: Image height, pixels.

    Returns:
        Reservoirs of this pass.
    """
    out = Reservoirs()
    si, bsdf, usable = first_hit(scene, ray)
    u, best, total = mi.Point2f(0), mi.Float(0), mi.Float(0)
    k = mi.UInt32(0)
    while dr.hint(k < candidates, label="lightwell nrc candidates"):
        other = sampler.next_2d()
        p = target(scene, si, bsdf, other, usable)
        total += p
        taken = sampler.next_1d() * total < p
        u = dr.select(taken, other, u)
        best = dr.select(taken, p, best)
        k += 1
    M = mi.Float(candidates)
    W = dr.select(best > 0, total / (M * best), 0)
    _, ds = contribution(scene, si, bsdf, u, usable & (W > 0))
    hidden = scene.ray_test(si.spawn_ray_to(ds.p), usable & (W > 0))
    W = dr.select(hidden | ~usable, 0, W)
    if dr.hint(temporal, mode="scalar"):
        before, seen = _past(before, film, width, height, si, usable)
        alike = seen & (before.t > 0) & (dr.dot(before.n, si.n) > NORMAL)
        alike &= dr.abs(before.t / dr.norm(si.p - before.o) - 1) < DEPTH
        M_before = dr.select(alike, dr.minimum(before.M, HISTORY * M), 0)
        p_before = target(scene, si, bsdf, before.u, alike)
        w, w_before = best * W * M, p_before * before.W * M_before
        swap = alike & (sampler.next_1d() * (w + w_before) < w_before)
        u = dr.select(swap, before.u, u)
        best = dr.select(swap, p_before, best)
        M = M + M_before
        W = dr.select(best > 0, (w + dr.select(alike, w_before, 0)) / (M * best), 0)
    out.u, out.W, out.M = u, dr.select(dr.isfinite(W), W, 0), M
    out.t, out.n = dr.select(usable, si.t, 0), mi.Vector3f(si.n)
    out.o, out.d = ray.o, ray.d
    return out


def world_to_film(sensor: Any) -> Any:
    """Compute the projection of a sensor from world space to its film.

    Args:
        sensor: Mitsuba sensor.

    Returns:
        Transform to [0, 1]^2 of the film; None for sensors without a field of view.
    """
    parameters = mi.traverse(sensor)
    if "x_fov" not in parameters:
        return None
    film = sensor.film()
    angle = float(np.array(parameters["x_fov"]).ravel()[0])
    flat = mi.perspective_projection(
        film.size(), film.crop_size(), film.crop_offset(), angle, sensor.near_clip(), sensor.far_clip()
    )  # fmt: skip
    matrix = np.array(mi.Transform4f(flat).matrix).reshape(4, 4)
    pose = np.array(sensor.world_transform().inverse().matrix).reshape(4, 4)
    whole = mi.Matrix4f((matrix @ pose).tolist())
    dr.make_opaque(whole)
    return mi.ProjectiveTransform4f(whole)


def _past(
    before: Reservoirs, film: Any, width: mi.UInt32, height: mi.UInt32, si: Any, usable: mi.Bool
) -> tuple[Reservoirs, mi.Bool]:
    """Return the last pass's reservoir of each surface, and whether its point was on the film of that pass."""
    if film is None:
        return before, usable
    at = film @ si.p
    x, y = mi.Int32(dr.floor(at.x * mi.Float(width))), mi.Int32(dr.floor(at.y * mi.Float(height)))
    seen = usable & (x >= 0) & (y >= 0) & (x < mi.Int32(width)) & (y < mi.Int32(height)) & (at.z > 0) & (at.z < 1)
    return dr.gather(Reservoirs, before, mi.UInt32(y) * width + mi.UInt32(x), seen), seen
