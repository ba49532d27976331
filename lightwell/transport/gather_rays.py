"""Rays of a final gather: from surfaces, or from places in the air, to the first surface that scatters, or the sky."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from lightwell.backend import dr, mi
from lightwell.transport.interactions import own_sample, upload
from lightwell.transport.path_numbers import random_streams
from lightwell.transport.sky_source import CELLS, cell_of

# Mirrors, glass and cut-outs that a ray passes at most.
PASSED = 12
# A reflection of a larger density, per steradian, counts as that of a mirror (roughness below 0.17): what it shows is
# not the light of a bin of its own surface.
PEAKED = 100.0

Ends: TypeAlias = tuple[Any, Any, Any, tuple[Any, Any]]
"""Radiance per irradiance where rays end, the place, the normal there on the side that is met; for rays that leave the
scene, which have no such weight, their throughput and direction."""


@dr.syntax
def gather_ray(scene: mi.Scene, si: mi.SurfaceInteraction3f, rng: mi.PCG32, first: tuple) -> Ends:
    """Follow rays that leave surfaces by their BSDF.

    Args:
        scene: Mitsuba scene.
        si: [N] surface interactions.
        rng: [N] random streams.
        first: Numbers that choose the lobe and the direction, as ``path_numbers.stratified`` gives them.

    Returns:
        Where they end.
    """
    lobe, direction, _ = first
    sample, β = own_sample(si, si.bsdf(), lobe, direction)
    ray = si.spawn_ray(si.to_world(sample.wo))
    return ray_ends(scene, ray, β, rng)


def free_ray(scene: mi.Scene, origin: np.ndarray, direction: np.ndarray, seed: int, stream: int) -> Ends:
    """Follow rays that begin in the air, by cosine-distributed directions.

    Args:
        scene: Mitsuba scene.
        origin: [R, 3] where they begin, metres.
        direction: [R, 3] unit directions.
        seed: Seed.
        stream: Number of the first ray.

    Returns:
        Irradiance per irradiance where they end, the place, the normal there on the side that is met, and for rays that
        leave the scene irradiance per radiance and their direction.
    """
    ray = mi.Ray3f(upload(mi.Point3f, origin), upload(mi.Vector3f, direction))
    lane = dr.arange(mi.UInt32, len(origin)) + dr.opaque(mi.UInt32, stream)
    rng = random_streams(dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), lane, mi.UInt32(1))
    weight, p, n, (through, way) = ray_ends(scene, ray, mi.Spectrum(1), rng)
    return weight * dr.pi, p, n, (through * dr.pi, way)


def cosine_ray(
    scene: mi.Scene, place: np.ndarray, normal: np.ndarray, lift: float, seed: int, stream: tuple[int, int]
) -> Ends:
    """Follow rays that leave places by the cosine.

    Args:
        scene: Mitsuba scene.
        place: [R, 3] where they begin, metres.
        normal: [R, 3] unit normals there.
        lift: How far above they begin, metres.
        seed: Seed.
        stream: Numbers of the first ray, and of all of them.

    Returns:
        As ``free_ray``.
    """
    first, of_all, begin = (dr.opaque(t, v) for t, v in zip((mi.UInt32, mi.UInt32, mi.Float), (*stream, lift)))
    rng = random_streams(dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), dr.arange(mi.UInt32, len(place)) + first, of_all)
    n = upload(mi.Vector3f, normal)
    d = mi.warp.square_to_cosine_hemisphere(mi.Point2f(rng.next_float32(), rng.next_float32()))
    ray = mi.Ray3f(upload(mi.Point3f, place) + begin * n, mi.Frame3f(n).to_world(d))
    weight, p, met, (through, way) = ray_ends(scene, ray, mi.Spectrum(1), rng)
    return weight * dr.pi, p, met, (through * dr.pi, way)


def goes_straight(sample: mi.BSDFSample3f) -> mi.Bool:
    """Tell which rays go on as through mirrors, glass and holes: what they show is not the light of the surface met.

    Args:
        sample: [N] directions sampled by the BSDFs that the rays have met.

    Returns:
        [N] whether the ray goes on.
    """
    has = lambda flag: mi.has_flag(sample.sampled_type, flag)  # noqa: E731
    # Glass of a glTF file has a narrow lobe in place of a sharp one.
    clear = has(mi.BSDFFlags.Delta) | has(mi.BSDFFlags.Null) | has(mi.BSDFFlags.GlossyTransmission)
    return clear | (has(mi.BSDFFlags.GlossyReflection) & (sample.pdf > PEAKED))


@dr.syntax
def ray_ends(scene, ray, β, rng):
    """Follow rays through mirrors, glass and holes to the first surface that scatters.

    Args:
        scene: Mitsuba scene.
        ray: [N] rays.
        β: [N] their throughput.
        rng: [N] random streams.

    Returns:
        Radiance per irradiance there, place, normal on the side met; and for rays that leave the scene, which have no
        weight, their throughput and direction.
    """
    ctx = mi.BSDFContext()
    ray, β = mi.Ray3f(ray), mi.Spectrum(β)
    weight, p, n = mi.Spectrum(0), mi.Point3f(0), mi.Vector3f(0, 0, 1)
    through, way = mi.Spectrum(0), mi.Vector3f(ray.d)
    passed = mi.UInt32(0)
    active = dr.max(β) != 0
    while dr.hint(active, label="lightwell gather ray"):
        si = scene.ray_intersect(ray, mi.RayFlags.All, False, active)
        left = active & ~si.is_valid()
        through, way = dr.select(left, β, through), dr.select(left, ray.d, way)
        active &= si.is_valid()
        u = mi.Point2f(rng.next_float32(), rng.next_float32())
        sample, albedo = si.bsdf(ray).sample(ctx, si, rng.next_float32(), u, active)
        straight = goes_straight(sample)
        β = dr.select(active, β * albedo, β)
        ended = active & ~straight & (dr.max(albedo) > 0)
        weight = dr.select(ended, β * dr.inv_pi, weight)
        p = dr.select(ended, si.p, p)
        n = dr.select(ended, dr.select(dr.dot(si.n, ray.d) > 0, -si.n, si.n), n)
        ray = si.spawn_ray(si.to_world(sample.wo))
        passed += 1
        active &= straight & (passed < PASSED)
    return weight, p, n, (through, way)


def beyond(
    count: int, weight: mi.Spectrum, index: mi.UInt32, away: tuple[mi.Spectrum, mi.Vector3f]
) -> tuple[mi.Spectrum, mi.UInt32]:
    """Number the cells of the sky behind the bins, for rays that leave the scene.

    Args:
        count: Number of bins.
        weight: [R] weight of what rays met.
        index: [R] bins that they met, ``count`` where there is none.
        away: [R] weight and direction of rays that left the scene.

    Returns:
        Weight and index of all rays; ``count + CELLS``, which is dark, where there is neither bin nor sky.
    """
    through, way = away
    free = (dr.max(through) > 0) & (way.y > 0)
    # The number of no bin is that of the first cell: light of the horizon would appear in closed rooms.
    index = dr.select(index < count, index, count + CELLS)
    return dr.select(free, through, weight), dr.select(free, count + cell_of(way), index)


def cosine_directions(normal: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Map numbers to cosine-distributed directions.

    Args:
        normal: [R, 3] unit normals.
        u: [2, R] numbers in [0, 1).

    Returns:
        [R, 3] unit directions.
    """
    radius, angle = np.sqrt(u[0]), 2 * np.pi * u[1]
    helper = np.where(np.abs(normal[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    tangent = np.cross(normal, helper)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.cross(normal, tangent)
    up = np.sqrt(np.maximum(1 - u[0], 0))
    return (
        (radius * np.cos(angle))[:, None] * tangent + (radius * np.sin(angle))[:, None] * across + up[:, None] * normal
    )
