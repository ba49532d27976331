"""Reservoirs for direct light at the first hit, after Bitterli et al. 2020, in the space of random numbers.

A light sample is the pair of numbers u in [0, 1)^2 that Mitsuba's emitter sampling turns into a point on a light. The
target of a pixel is lum(BSDF * weight(u)) without visibility. Because all pixels share the square, samples move between
pixels without a Jacobian, whatever the kind of light.

Notation: N lanes, reservoir (u, W, M), candidates with density 1 in u.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi

# Neighbours and radius of spatial reuse (passes x neighbours: biased 2 x 5 as one pass of 5, unbiased 1 x 3), pixels.
NEIGHBOURS = {"biased": 5, "unbiased": 3}
RADIUS = 30.0
# Neighbours that differ by more are not asked: depth, relative; cosine between normals (25 degrees).
DEPTH, NORMAL = 0.1, 0.906
# The past counts at most so many times the present.
HISTORY = 20.0


class Reservoirs:
    """One light sample per lane, and the surface it was chosen for."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "u": mi.Point2f, "W": mi.Float, "M": mi.Float, "t": mi.Float, "n": mi.Vector3f,
        "o": mi.Point3f, "d": mi.Vector3f,
    }  # fmt: skip

    def __init__(self):
        self.u, self.W, self.M = mi.Point2f(0), mi.Float(0), mi.Float(0)
        """Sample, its weight, and how many candidates stand behind it."""
        self.t, self.n = mi.Float(0), mi.Vector3f(0)
        """Distance and normal of the surface; t = 0: none."""
        self.o, self.d = mi.Point3f(0), mi.Vector3f(0, 0, 1)
        """The camera ray, from which the surface is found again."""


def contribution(scene: Any, si: Any, bsdf: Any, u: mi.Point2f, active: mi.Bool):
    """(BSDF * weight of light sample u, unshadowed; the light sample). Density 1 in u."""
    ds, weight = scene.sample_emitter_direction(si, u, False, active)
    value = bsdf.eval(mi.BSDFContext(), si, si.to_local(ds.d), active & (ds.pdf != 0))
    out = value * weight
    return dr.select(active & (ds.pdf != 0) & dr.all(dr.isfinite(out)), out, 0), ds


def target(scene, si, bsdf, u, active) -> mi.Float:
    """The number that reservoirs aim at."""
    value, _ = contribution(scene, si, bsdf, u, active)
    return dr.maximum(mi.luminance(value), 0)


def first_hit(scene, ray, active=True):
    """(surface, material, whether it takes reservoirs)."""
    si = scene.ray_intersect(ray, mi.RayFlags.All, True, mi.Bool(active))
    bsdf = si.bsdf(ray)
    return si, bsdf, si.is_valid() & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)


@dr.syntax
def choose(scene, ray, sampler, candidates, before, temporal: bool, film=None, width=0, height=0) -> Reservoirs:
    """Candidates, one shadow ray, and the surface's own past.

    before  reservoirs of the last pass, one per pixel. film: takes a point of the world to where that pass saw it,
            [0, 1]^2 (``world_to_film``), so that the past follows its surface when the camera moves.
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
    """The transform from world to [0, 1]^2 of the film as the sensor stands now; None for sensors without a field of
    view."""
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
    """The last pass's reservoir of each surface, and whether that pass saw its place."""
    if film is None:
        return before, usable
    at = film @ si.p
    x, y = mi.Int32(dr.floor(at.x * mi.Float(width))), mi.Int32(dr.floor(at.y * mi.Float(height)))
    seen = usable & (x >= 0) & (y >= 0) & (x < mi.Int32(width)) & (y < mi.Int32(height)) & (at.z > 0) & (at.z < 1)
    return dr.gather(Reservoirs, before, mi.UInt32(y) * width + mi.UInt32(x), seen), seen


@dr.syntax
def shade(scene, ray, sampler, held, width, height, spp, count: int, unbiased: bool):
    """Direct light [N] at the first hits after merging ``count`` neighbours' reservoirs; 0 where there are none.

    Biased merging divides by all candidates met and darkens where neighbours could not have made the sample. Unbiased
    merging divides by the candidates of those that could: their target is asked again, visibility included.
    """
    N = dr.width(held.W)
    lane = dr.arange(mi.UInt32, N)
    pixel, s = lane // spp, lane % spp
    at = mi.Point2f(mi.Float(pixel % width), mi.Float(pixel // width))
    si, bsdf, usable = first_hit(scene, ray)
    angle, offset_r = sampler.next_1d() * dr.two_pi, sampler.next_1d()

    u, M = mi.Point2f(held.u), mi.Float(held.M)  # Copies: what is held is the past of the next pass.
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
    """Pixel number of the k-th neighbour: golden-angle spiral in a disc, mirrored at the border."""
    r = dr.sqrt((mi.Float(k) + 0.25 + 0.75 * radius) / count) * RADIUS
    turn = angle + mi.Float(k) * 2.399963
    x, y = at.x + r * dr.cos(turn), at.y + r * dr.sin(turn)
    w, h = mi.Float(width), mi.Float(height)
    x, y = dr.abs(x), dr.abs(y)
    x = dr.clip(dr.select(x > w - 1, 2 * (w - 1) - x, x), 0, w - 1)
    y = dr.clip(dr.select(y > h - 1, 2 * (h - 1) - y, y), 0, h - 1)
    return mi.UInt32(dr.round(x)) + mi.UInt32(dr.round(y)) * width


def _alike(other: Reservoirs, si: Any, elsewhere: mi.Bool) -> mi.Bool:
    """Whether a neighbour's surface is near enough in depth and direction."""
    return elsewhere & (other.t > 0) & (dr.abs(other.t / si.t - 1) < DEPTH) & (dr.dot(other.n, si.n) > NORMAL)


def _possible(scene, o, d, u, active) -> mi.Bool:
    """Whether the surface behind a camera ray could have given sample u with a weight above 0."""
    si, bsdf, usable = first_hit(scene, mi.Ray3f(o, d), active)
    active = active & usable
    p = target(scene, si, bsdf, u, active)
    _, ds = contribution(scene, si, bsdf, u, active & (p > 0))
    hidden = scene.ray_test(si.spawn_ray_to(ds.p), active & (p > 0))
    return active & (p > 0) & ~hidden
