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

# Neighbours and radius of spatial reuse (passes x neighbours: biased 2 x 5 as one pass of 5, unbiased 1 x 3), pixels.
NEIGHBOURS = {"biased": 5, "unbiased": 3}
RADIUS = 30.0
# Neighbours whose surfaces differ by more are not used: relative depth; cosine between normals (25 degrees).
DEPTH, NORMAL = 0.1, 0.906
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


def _past(before: Reservoirs, film, width, height, si, usable) -> tuple[Reservoirs, mi.Bool]:
    """Return the last pass's reservoir of each surface, and whether its point was on the film of that pass."""
    if film is None:
        return before, usable
    at = film @ si.p
    x, y = mi.Int32(dr.floor(at.x * mi.Float(width))), mi.Int32(dr.floor(at.y * mi.Float(height)))
    seen = usable & (x >= 0) & (y >= 0) & (x < mi.Int32(width)) & (y < mi.Int32(height)) & (at.z > 0) & (at.z < 1)
    return dr.gather(Reservoirs, before, mi.UInt32(y) * width + mi.UInt32(x), seen), seen


@dr.syntax
def shade(
    scene: Any, ray: Any, sampler: Any, held: Reservoirs, width: mi.UInt32, height: mi.UInt32, spp: mi.UInt32,
    count: int, unbiased: bool,
) -> tuple[Any, mi.Float, mi.Float]:  # fmt: skip
    """Compute the direct light at the first hits after spatial reuse of neighbours' reservoirs.

    Biased merging divides by all candidates and is too dark where neighbours could not have generated the sample.
    Unbiased merging divides by the candidates of those that could: their target function, with visibility, is evaluated
    again.

    Args:
        scene: Mitsuba scene.
        ray: [N] camera rays.
        sampler: Source of random numbers.
        held: Reservoirs of this pass.
        width: Image width, pixels.
        height: Image height, pixels.
        spp: Samples per pixel of this pass.
        count: Neighbours, ≥ 0.
        unbiased: Whether merging is unbiased.

    Returns:
        Radiance [N], 0 where there are no reservoirs; weights W [N] and candidate counts M [N] after merging.
    """
    N = dr.width(held.W)
    lane = dr.arange(mi.UInt32, N)
    pixel, s = lane // spp, lane % spp
    at = mi.Point2f(mi.Float(pixel % width), mi.Float(pixel // width))
    si, bsdf, usable = first_hit(scene, ray)
    angle, offset_r = sampler.next_1d() * dr.two_pi, sampler.next_1d()

    u, M = mi.Point2f(held.u), mi.Float(held.M)  # Copies: the next pass reuses ``held``.
    p = target(scene, si, bsdf, u, usable)
    total = p * held.W * held.M
    best = p
    k = mi.UInt32(0)
    while dr.hint(k < count, label="lightwell nrc neighbours"):
        i = _neighbour(at, angle, offset_r, k, count, width, height) * spp + s
        other = dr.gather(Reservoirs, held, i, usable)
        alike = usable & _alike(other, si, i != lane)
        p = target(scene, si, bsdf, other.u, alike)
        w = dr.select(alike, p * other.W * other.M, 0)
        total += w
        M += dr.select(alike, other.M, 0)
        taken = sampler.next_1d() * total < w
        u = dr.select(taken, other.u, u)
        best = dr.select(taken, p, best)
        k += 1
    if dr.hint(unbiased, mode="scalar"):
        M = dr.select(_possible(scene, held.o, held.d, u, usable), held.M, 0)
        k = mi.UInt32(0)
        while dr.hint(k < count, label="lightwell nrc possible"):
            i = _neighbour(at, angle, offset_r, k, count, width, height) * spp + s
            other = dr.gather(Reservoirs, held, i, usable)
            alike = usable & _alike(other, si, i != lane)
            M += dr.select(_possible(scene, other.o, other.d, u, alike), other.M, 0)
            k += 1
    W = dr.select((best > 0) & (M > 0), total / (M * best), 0)
    value, ds = contribution(scene, si, bsdf, u, usable & (W > 0))
    hidden = scene.ray_test(si.spawn_ray_to(ds.p), usable & (W > 0))
    L = dr.select(usable & ~hidden, value * W, 0)
    return dr.select(dr.all(dr.isfinite(L)), L, 0), W, M


def _neighbour(at, angle, radius, k, count, width, height):
    """Return the pixel index of the k-th neighbour: golden-angle spiral in a disc, mirrored at the image border."""
    r = dr.sqrt((mi.Float(k) + 0.25 + 0.75 * radius) / count) * RADIUS
    turn = angle + mi.Float(k) * 2.399963
    x, y = at.x + r * dr.cos(turn), at.y + r * dr.sin(turn)
    w, h = mi.Float(width), mi.Float(height)
    x, y = dr.abs(x), dr.abs(y)
    x = dr.clip(dr.select(x > w - 1, 2 * (w - 1) - x, x), 0, w - 1)
    y = dr.clip(dr.select(y > h - 1, 2 * (h - 1) - y, y), 0, h - 1)
    return mi.UInt32(dr.round(x)) + mi.UInt32(dr.round(y)) * width


def _alike(other: Reservoirs, si: Any, elsewhere: mi.Bool) -> mi.Bool:
    """Test whether a neighbour's surface has a similar depth and normal."""
    return elsewhere & (other.t > 0) & (dr.abs(other.t / si.t - 1) < DEPTH) & (dr.dot(other.n, si.n) > NORMAL)


def _possible(scene, o, d, u, active) -> mi.Bool:
    """Test whether the first hit of a camera ray could have generated sample u with a weight above 0."""
    si, bsdf, usable = first_hit(scene, mi.Ray3f(o, d), active)
    active = active & usable
    p = target(scene, si, bsdf, u, active)
    _, ds = contribution(scene, si, bsdf, u, active & (p > 0))
    hidden = scene.ray_test(si.spawn_ray_to(ds.p), active & (p > 0))
    return active & (p > 0) & ~hidden
