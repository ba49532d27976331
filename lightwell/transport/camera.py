"""Images of a camera: G-buffers, reference radiance at the pixel centres, and path-traced images.

Notation: H x W pixels, row-major, first row at the top.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, TypedDict

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable, from_json, to_json
from lightwell.transport.first_surfaces import first_drawn, first_surface
from lightwell.transport.interactions import upload
from lightwell.transport.path_numbers import independent, random_streams
from lightwell.transport.paths import MAX_DEPTH, RR_DEPTH, trace
from lightwell.transport.queries import make_query
from lightwell.transport.radiance import LAUNCH, PathReport, direct, indirect, static
from lightwell.transport.row_tasks import rows_of
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.sky_source import DayEmitter
from lightwell.transport.sources import Emitters, declared
from lightwell.transport.tables import shape_index, shape_lookup
from lightwell.transport.turned_source import TurnedEmitter

# Samples per pixel of the guides of a denoiser.
GUIDE_SAMPLES = 4


class ReferenceImages(TypedDict):
    """The reference of one view under a white unit light; [H, W, 3] float32 unless said otherwise."""

    points: SurfacePoints
    """H * W points; rows outside the mask are meaningless."""
    mask: np.ndarray
    """[H, W] bool: pixels that show a surface."""
    indirect_a: np.ndarray
    """Indirect radiance at the pixel centre, mean over the first half of the paths."""
    indirect_b: np.ndarray
    """Mean over the second, independent half."""
    direct: np.ndarray
    """Direct radiance of the declared light at the pixel centre."""
    emission: np.ndarray
    """Emission seen directly, the environment where no surface is."""


def gbuffer(
    scene: Scene, camera: Camera, width: int, height: int, seed: int | None = None
) -> tuple[SurfacePoints, np.ndarray, np.ndarray]:
    """Find the surface points that a camera sees, one per pixel.

    Args:
        scene: Scene to look at.
        camera: Pinhole camera.
        width: Pixels of a row.
        height: Rows.
        seed: None: rays through the pixel centres; else through a random place in each pixel.

    Returns:
        H * W points, a mask [H * W] of the pixels that show a surface, and emission seen directly [H * W, 3] float32.
    """
    pixel = dr.arange(mi.UInt32, width * height)
    offset = mi.Point2f(0.5)
    if seed is not None:
        rng = random_streams(dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), pixel, mi.UInt32(0))
        offset = mi.Point2f(rng.next_float32(), rng.next_float32())
    ray = camera_rays(camera, width, height, pixel, offset)
    pi, ray = first_surface(scene, ray)
    si = pi.compute_surface_interaction(ray)
    emission = dr.select(dr.isfinite(ray.d.x), si.emitter(scene.mi).eval(si), 0)
    hit = pi.is_valid()
    shape = dr.select(hit, shape_index(shape_lookup(scene), pi.shape), 0)
    triangle = dr.select(hit, pi.prim_index, 0)
    uv = dr.select(hit, pi.prim_uv, 0)
    dr.eval(shape, triangle, uv, ray.d, hit, emission)
    points = SurfacePoints(np.array(shape), np.array(triangle), _rows(uv), -_rows(ray.d))
    return points, np.array(hit, bool), _rows(emission)


def camera_points(camera: Camera, size: tuple[int, int], light: np.ndarray | None = None) -> Recipe:
    """Describe to workers the surface points at the pixel centres of a camera, without pixels that show no surface.

    Args:
        camera: The camera.
        size: Width and height, pixels.
        light: [3] light of all points; None: they have none.

    Returns:
        The recipe.
    """
    place = None if light is None else np.asarray(light, np.float32).reshape(3).tolist()
    return Recipe("camera-points", {"camera": asdict(camera), "size": list(size), "light": place})


def camera_inputs(scene: Scene, settings: Mapping[str, Any], arrays: Arrays) -> Inputs:
    """Find what a camera sees; see ``row_recipes.RecipeFunction``.

    Args:
        scene: Scene to look at.
        settings: ``camera``, ``size`` and ``light``, as ``camera_points`` writes them.
        arrays: Not used.

    Returns:
        Columns of ``SurfacePoints`` and, with a light, ``light`` [N, 3].
    """
    points, mask, _ = gbuffer(scene, Camera(**settings["camera"]), *settings["size"])
    columns = columns_of(points[np.flatnonzero(mask)])
    if settings["light"] is not None:
        columns["light"] = np.broadcast_to(np.float32(settings["light"]), (len(columns["shape"]), 3))
    return Inputs(columns)


def reference_image(
    scene: Scene,
    camera: Camera,
    light: np.ndarray,
    variable: Variable,
    width: int,
    height: int,
    paths: int,
    seed: int = 0,
    *,
    max_depth: int = MAX_DEPTH,
    report: PathReport | None = None,
) -> ReferenceImages:
    """Render the reference: direct and indirect radiance at the surface points of the pixel centres.

    The declared light is white, 1 cd (a sun: 1 lx). Nothing is filtered, so that a field evaluated at the same points
    is compared without differences in antialiasing.

    Args:
        scene: Scene to look at.
        camera: Pinhole camera.
        light: [3] position of the declared light, metres (direction to the sun).
        variable: What the declared light is.
        width: Pixels of a row.
        height: Rows.
        paths: Paths per pixel, even; each half gets half of them.
        seed: Seed of the paths.
        max_depth: Longest path, 2 = direct light only.
        report: Receives the path counts.

    Returns:
        Images [H, W, 3] float32, the points and their mask.
    """
    points, mask, emission = gbuffer(scene, camera, width, height)
    seen = np.flatnonzero(mask)
    recipe = camera_points(camera, (width, height), light)
    a, b = indirect(
        scene, points[seen], light, variable, paths, seed, max_depth=max_depth, report=report, recipe=recipe
    )
    lit = direct(scene, points[seen], light, variable, paths, seed + 1, recipe=recipe)

    def image(values: np.ndarray) -> np.ndarray:
        full = np.zeros((height * width, 3), np.float32)
        full[seen] = values
        return full.reshape(height, width, 3)

    return ReferenceImages(
        points=points,
        mask=mask.reshape(height, width),
        indirect_a=image(a),
        indirect_b=image(b),
        direct=image(lit),
        emission=emission.reshape(height, width, 3),
    )


def guide_images(
    scene: Scene, camera: Camera, width: int, height: int, samples: int = GUIDE_SAMPLES
) -> tuple[np.ndarray, np.ndarray]:
    """Render the guides of a denoiser: reflectance and normals of the first surfaces, with normal maps, antialiased.

    Args:
        scene: Scene to look at.
        camera: Pinhole camera.
        width: Pixels of a row.
        height: Rows.
        samples: Random places in each pixel.

    Returns:
        Reflectance in [0, 1] (1 where no surface is seen) and normals in [-1, 1] (0 there), [H, W, 3] float32 each.
    """
    albedo, normal = np.zeros((2, height * width, 3), np.float32)
    for seed in range(samples):
        points, mask, _ = gbuffer(scene, camera, width, height, seed)
        seen = np.flatnonzero(mask)
        query = make_query(scene, points[seen], np.zeros(3, np.float32))
        albedo[~mask] += 1
        albedo[seen] += np.clip(query.reflectance, 0, 1)
        normal[seen] += query.shading_normal
    return tuple(image.reshape(height, width, 3) / samples for image in (albedo, normal))


def static_image(
    scene: Scene, camera: Camera, width: int, height: int, paths: int, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Render the light of the scene's own emitters at the pixel centres, without emission seen directly.

    Args:
        scene: Scene to look at.
        camera: Pinhole camera.
        width: Pixels of a row.
        height: Rows.
        paths: Paths per pixel, even; each half gets half of them.
        seed: Seed of the paths.

    Returns:
        Two independent half means [H, W, 3] float32.
    """
    points, mask, _ = gbuffer(scene, camera, width, height)
    images = np.zeros((2, height * width, 3), np.float32)
    recipe = camera_points(camera, (width, height))
    images[:, mask] = static(scene, points[np.flatnonzero(mask)], paths, seed, recipe=recipe)
    a, b = images.reshape(2, height, width, 3)
    return a, b


def total_image(
    scene: Scene,
    camera: Camera,
    light: np.ndarray,
    variable: Variable | None,
    width: int,
    height: int,
    spp: int,
    seed: int = 0,
    *,
    intensity: float = 1.0,
    color: tuple[float, float, float] = (1.0, 1.0, 1.0),
    with_static: bool = False,
    max_depth: int = MAX_DEPTH,
) -> np.ndarray:
    """Render a path-traced image: emission, direct and indirect light, antialiased with a box filter.

    Args:
        scene: Scene to look at.
        camera: Pinhole camera.
        light: [3] position of the declared light, metres (direction to the sun).
        variable: What the declared light is; None: there is none.
        width: Pixels of a row.
        height: Rows.
        spp: Paths per pixel, ≥ 1.
        seed: Seed of the paths.
        intensity: Intensity of the declared light, cd (lx for a sun).
        color: Its linear sRGB colour.
        with_static: Let the scene's own emitters shine too.
        max_depth: Longest path, 2 = direct light only.

    Returns:
        [H, W, 3] float32 linear radiance.
    """
    columns = {"pixel": np.arange(width * height, dtype=np.uint32)}
    settings = {
        "camera": asdict(camera), "light": np.asarray(light, np.float32).reshape(3).tolist(),
        "variable": None if variable is None else to_json(variable), "size": [width, height], "spp": spp, "seed": seed,
        "intensity": float(intensity), "color": [float(c) for c in color], "max_depth": max_depth,
        "with_static": with_static and scene.has_static_light,
    }  # fmt: skip
    recipe = Recipe("pixels", {"count": width * height})
    return rows_of(scene, "picture", settings, columns, spp, recipe=recipe)["radiance"].reshape(height, width, 3)


def picture_rows(scene: Scene, settings: Mapping[str, Any], columns: Arrays, first: int, shared: Arrays) -> Arrays:
    """Trace pixels of ``total_image``; see ``row_tasks.RowFunction``.

    Args:
        scene: Scene to look at.
        settings: The other arguments of ``total_image``.
        columns: ``pixel`` [N], numbers of pixels that follow each other.
        first: Number of the first pixel.
        shared: Not used.

    Returns:
        ``radiance`` [N, 3] float32.
    """
    variable = None if settings["variable"] is None else from_json(settings["variable"])
    camera, (width, height), spp = Camera(**settings["camera"]), settings["size"], settings["spp"]
    pixels = len(columns["pixel"])
    tint = upload(mi.Color3f, settings["intensity"] * np.asarray([settings["color"]]))
    source = upload(mi.Vector3f, np.float32([settings["light"]]))
    numbers = (settings["seed"] & 0xFFFFFFFF, settings["max_depth"], RR_DEPTH)
    seed, *depths = (dr.opaque(mi.UInt32, v) for v in numbers)
    total, running = np.zeros((pixels, 3), np.float64), None

    def add(start: int, count: int, sums: mi.Spectrum) -> None:
        total[start : start + count] += _rows(sums)

    for start, count, done, block in _launches(pixels, spp):
        at, skip, size = (dr.opaque(mi.UInt32, v) for v in (first + start, done, block))
        lane = dr.arange(mi.UInt32, count * block)
        pixel = at + lane // size
        rng = random_streams(seed, pixel, skip + lane % size)
        ray = camera_rays(camera, width, height, pixel, mi.Point2f(rng.next_float32(), rng.next_float32()))
        si, ray = first_drawn(scene, ray)
        L = si.emitter(scene.mi).eval(si)
        if variable is not None:
            L += tint * _lit(scene.mi, si, ray, declared(variable, source, scene), rng, depths)
        if settings["with_static"]:
            L += trace(scene.mi, si, Emitters.of(scene), rng, independent(rng), *depths, True)
        L = dr.select(dr.all(dr.isfinite(L)), L, 0)
        # A launch is recorded while the one before it runs.
        if running is not None:
            add(*running)
        dr.eval(L)
        running = start, count, dr.block_sum(L, block)
        dr.eval(running[2])
    if running is not None:
        add(*running)
    return {"radiance": (total / spp).astype(np.float32)}


def _lit(geometry, si, ray, light, rng, depths) -> mi.Spectrum:
    """Estimate the light of a declared light that camera rays see; the sky or the map behind everything included."""
    L = trace(geometry, si, light, rng, independent(rng), *depths, True)
    if not isinstance(light, (DayEmitter, TurnedEmitter)):
        return L
    return light.level * (L + light.sky(ray.d, ~si.is_valid()))


def camera_rays(camera: Camera, width: int, height: int, pixel: mi.UInt32, offset: mi.Point2f) -> mi.Ray3f:
    """Make pinhole rays through places in pixels.

    Args:
        camera: Pinhole camera.
        width: Pixels of a row.
        height: Rows.
        pixel: Row-major number of the pixel of each ray.
        offset: Place in the pixel from its top left corner, in [0, 1)².

    Returns:
        World-space rays with unit directions.
    """
    forward = np.subtract(camera.target, camera.position, dtype=np.float64)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, camera.up)
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    half = np.tan(np.radians(camera.fov_y) / 2)
    axes = [upload(mi.Vector3f, a[None]) for a in (right * half * width / height, up * half, forward)]
    w, h = dr.opaque(mi.UInt32, width), dr.opaque(mi.UInt32, height)
    x = 2 * (mi.Float(pixel % w) + offset.x) / w - 1
    y = 1 - 2 * (mi.Float(pixel // w) + offset.y) / h
    d = dr.normalize(axes[0] * x + axes[1] * y + axes[2])
    return mi.Ray3f(upload(mi.Point3f, np.asarray([camera.position])), d)


def _launches(pixels: int, spp: int):
    """(first pixel, pixels, first path, paths) of each launch."""
    block = min(spp, LAUNCH)
    batch = max(1, LAUNCH // block)
    for start in range(0, pixels, batch):
        for done in range(0, spp, block):
            yield start, min(batch, pixels - start), done, min(block, spp - done)


def _rows(vector) -> np.ndarray:
    """[N, C] float32 rows of a Dr.Jit vector."""
    return np.ascontiguousarray(np.array(vector).T, np.float32)
