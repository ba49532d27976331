"""Surfaces one behind the other along the rays of a camera, each with its radiance: the content of a deep picture."""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.camera import camera_rays
from lightwell.transport.first_surfaces import first_surface
from lightwell.transport.interactions import upload
from lightwell.transport.path_numbers import independent, random_streams
from lightwell.transport.paths import MAX_DEPTH, RR_DEPTH, trace
from lightwell.transport.radiance import LAUNCH
from lightwell.transport.sources import Emitters, declared

# Between the seeds of surfaces one behind the other.
SEED_STEP = 1_000_003


def deep_image(
    scene: Scene,
    camera: Camera,
    light: np.ndarray,
    variable: Variable | None,
    width: int,
    height: int,
    spp: int,
    surfaces: int,
    seed: int = 0,
    *,
    intensity: float = 1.0,
    color: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Path-trace the surfaces at the pixel centres, the hidden ones too.

    All surfaces stay in the scene: they light and shadow each other.

    Args:
        scene: Scene to look at.
        camera: Pinhole camera.
        light: [3] position of the declared light, metres (direction to the sun).
        variable: What the declared light is; None: there is none.
        width: Pixels of a row.
        height: Rows.
        spp: Paths per pixel and surface, ≥ 1.
        surfaces: K, surfaces of a pixel at most, ≥ 1.
        seed: Seed of the paths.
        intensity: Intensity of the declared light, cd (lx for a sun).
        color: Its linear sRGB colour.

    Returns:
        Radiance [K, H, W, 3] float32, and depth along the camera's axis [K, H, W] float32, metres, infinite where there
        is no such surface. What no surface hides, an environment, is the radiance of a first surface at infinity.
    """
    pixels, block = width * height, min(spp, LAUNCH)
    radiance, depth = np.zeros((surfaces, pixels, 3)), np.full((surfaces, pixels), np.inf, np.float32)
    tint = upload(mi.Color3f, np.float32(intensity * np.asarray([color])))
    source = None if variable is None else declared(variable, upload(mi.Vector3f, np.reshape(light, (1, 3))), scene)
    batch = max(1, LAUNCH // block)
    for start in range(0, pixels, batch):
        rows = slice(start, min(start + batch, pixels))
        for done in range(0, spp, block):
            part = min(block, spp - done)
            first, skip, size = (dr.opaque(mi.UInt32, v) for v in (start, done, part))
            lane = dr.arange(mi.UInt32, (rows.stop - start) * part)
            pixel = first + lane // size
            ray, there = camera_rays(camera, width, height, pixel, mi.Point2f(0.5)), mi.Bool(True)
            for k in range(surfaces):
                number = dr.opaque(mi.UInt32, (seed + k * SEED_STEP) & 0xFFFFFFFF)
                rng = random_streams(number, pixel, skip + lane % size)
                si, ray = _next(scene, ray)
                z = dr.dot(si.p - upload(mi.Point3f, np.asarray([camera.position])), _axis(camera))
                # A ray that has met nothing meets nothing more.
                hit, behind = there & si.is_valid(), si.spawn_ray(ray.d)
                L = _light(scene, si, source, tint, rng, there if k == 0 else hit)
                dr.eval(L, z, hit, behind)
                radiance[k, rows] += np.array(dr.block_sum(L, part)).T
                depth[k, rows] = np.where(np.array(hit), np.array(z), np.inf)[::part]
                ray, there = behind, hit
    shape = (surfaces, height, width)
    return (radiance / spp).reshape(*shape, 3).astype(np.float32), depth.reshape(shape)


def _axis(camera: Camera) -> mi.Vector3f:
    """The camera's axis, unit."""
    axis = np.subtract(camera.target, camera.position, dtype=np.float64)
    return upload(mi.Vector3f, (axis / np.linalg.norm(axis))[None])


def _next(scene: Scene, ray: mi.Ray3f) -> tuple[mi.SurfaceInteraction3f, mi.Ray3f]:
    """The next surface that is not cut away, and the ray that meets it."""
    pi, ray = first_surface(scene, ray)
    return pi.compute_surface_interaction(ray), ray


def _light(
    scene: Scene, si: mi.SurfaceInteraction3f, source: object, tint: mi.Color3f, rng: mi.PCG32, there: mi.Bool
) -> mi.Color3f:
    """Emission and all scattered light where ``there``; of first surfaces the environment counts, too."""
    limits = [dr.opaque(mi.UInt32, v) for v in (MAX_DEPTH, RR_DEPTH)]
    L = dr.select(there, si.emitter(scene.mi).eval(si), 0)
    if source is not None:
        L += tint * trace(scene.mi, si, source, rng, independent(rng), *limits, True)
    if scene.has_static_light:
        L += trace(scene.mi, si, Emitters.of(scene), rng, independent(rng), *limits, True)
    return dr.select(dr.all(dr.isfinite(L)) & there, L, 0)
