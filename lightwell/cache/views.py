"""Debug views: predictions of the cache and properties of the paths as images."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.features import Vertex
from lightwell.cache.frames import LAUNCH, Rays, evaluator, sobol_rays
from lightwell.cache.path_context import PathContext
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.render_paths import render_path
from lightwell.cache.training_frame import shared_offset

# Largest number of mirrors and panes that a view looks through, and samples per pixel of the denoiser's guide images.
MIRRORS, GUIDE_SPP = 8, 4
# Edge of the squares over which the bias view averages, pixels: single pixels would show noise.
BLOCK = 8


@dr.syntax
def first_vertex(scene: Any, sampler: Any, ray: Any, context: PathContext) -> tuple[Vertex, mi.Bool, Any, Any]:
    """Follow rays through mirrors and clear glass to the first surface that is not specular.

    Args:
        scene: Mitsuba scene.
        sampler: Source of random numbers.
        ray: [N] camera rays.
        context: ``PathContext`` of the cache.

    Returns:
        Vertices, mask of rays with one [N], throughput [N], and emission of the surfaces on the way [N].
    """
    ray = mi.Ray3f(dr.detach(ray))
    β, L = mi.Spectrum(1), mi.Spectrum(0)
    vertex, found = Vertex(), mi.Bool(False)
    passed, active = mi.UInt32(0), mi.Bool(True)
    while dr.hint(active, label="lightwell nrc view"):
        si = scene.ray_intersect(ray, active)
        L += dr.select(active, β * si.emitter(scene).eval(si, active), 0)
        bsdf = si.bsdf(ray)
        active &= si.is_valid()
        here = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        vertex = dr.select(here, context.vertex(si, bsdf, here), vertex)
        found |= here
        active &= ~here & (passed < MIRRORS)
        sample, weight = bsdf.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d(), active)
        β = dr.select(active, β * weight, β)
        ray = si.spawn_ray(si.to_world(sample.wo))
        passed += 1
    return vertex, found, β, L


def _image(values: mi.Color3f, sensor: Any, spp: int) -> np.ndarray:
    """Means per pixel [H, W, 3]."""
    width, height = (int(x) for x in sensor.film().crop_size())
    values = dr.select(dr.isfinite(values), values, 0)
    dr.eval(values)
    return np.array(values).T.reshape(height, width, spp, 3).mean(axis=2).astype(np.float32)


def _rays(sensor: Any, spp: int, seed: int, first: int = 0) -> Rays:
    width, height = (int(x) for x in sensor.film().crop_size())
    numbers = [dr.opaque(mi.UInt32, x & 0xFFFFFFFF) for x in (first, spp, seed)]
    return sobol_rays(sensor, numbers, dr.arange(mi.UInt32, width * height * spp))


def guides(scene: Any, sensor: Any, cache: RadianceCache, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Render the guide images of the denoiser at the first surfaces that are not specular.

    Args:
        scene: Mitsuba scene.
        sensor: Mitsuba sensor.
        cache: ``RadianceCache`` of the scene.
        seed: Seed.

    Returns:
        Albedo [H, W, 3] in [0, 1] and normal [H, W, 3].
    """
    ray, _, _, sampler = _rays(sensor, GUIDE_SPP, seed)
    v, found, β, _ = first_vertex(scene, sampler, ray, cache.region.context)
    albedo = dr.clip(dr.select(found, β * v.reflectance(), 0), 0, 1)
    normal = dr.select(found, mi.Color3f(v.n.x, v.n.y, v.n.z), 0)
    return _image(albedo, sensor, GUIDE_SPP), _image(normal, sensor, GUIDE_SPP)


def view(scene: Any, sensor: Any, cache: RadianceCache, name: str, spp: int, seed: int) -> np.ndarray:
    """Render a debug view; docs/radiance-cache.md describes each.

    Args:
        scene: Mitsuba scene.
        sensor: Mitsuba sensor.
        cache: ``RadianceCache`` of the scene.
        name: Name of the view, see ``settings.VIEWS``.
        spp: Samples per pixel, ≥ 1.
        seed: Seed.

    Returns:
        [H, W, 3] linear image.

    Raises:
        ValueError: There is no view of that name.
    """
    if name in ("training", "tiles"):
        return _training(sensor, cache, name, seed)
    width, height = (int(x) for x in sensor.film().crop_size())
    # In parts, as pictures are: memory grows with the samples of a launch.
    part, image = max(1, LAUNCH // (width * height)), np.zeros((height, width, 3), np.float32)
    for first in range(0, spp, part):
        count = min(part, spp - first)
        image += _samples(scene, sensor, cache, name, (first, count, seed)) * np.float32(count / spp)
    return _blocks(image) if name == "bias" else image


def _samples(scene: Any, sensor: Any, cache: RadianceCache, name: str, numbers: tuple[int, int, int]) -> np.ndarray:
    """Means [H, W, 3] of some samples per pixel: the first one, their number, and the seed."""
    first, spp, seed = numbers
    rays = _rays(sensor, spp, seed, first)
    ray, weight, _, sampler = rays
    if name in ("depth", "spread", "dropped", "cache-2", "bias"):
        return _image(_path_view(scene, cache, rays, name), sensor, spp)
    v, found, β, L = first_vertex(scene, sampler, ray, cache.region.context)
    if name == "albedo":
        return _image(dr.select(found, v.reflectance(), 0), sensor, spp)
    shown = dr.select(found, β * cache.predictor.radiance(cache.predictor.packed("ema"), v), 0)
    if name == "cache":
        return _image((L + shown) * weight, sensor, spp)
    if name == "raw-minus-ema":
        raw = dr.select(found, β * cache.predictor.radiance(cache.predictor.packed("raw"), v), 0)
        return _image(raw - shown, sensor, spp)
    if name == "residual":
        traced = _path_view(scene, cache, _rays(sensor, spp, seed, first), "image")
        return _image((L + shown) * weight, sensor, spp) - _image(traced, sensor, spp)
    raise ValueError(f"nrc: there is no view '{name}' here")


def _blocks(image: np.ndarray) -> np.ndarray:
    """Means over squares of ``BLOCK`` pixels, shown at full size."""
    height, width, _ = image.shape
    out = np.empty_like(image)
    for y in range(0, height, BLOCK):
        for x in range(0, width, BLOCK):
            out[y : y + BLOCK, x : x + BLOCK] = image[y : y + BLOCK, x : x + BLOCK].mean(axis=(0, 1))
    return out


def _path_view(scene: Any, cache: RadianceCache, rays: Rays, name: str) -> mi.Color3f:
    ray, weight, _, sampler = rays
    context = cache.region.context
    if name == "cache-2":
        context = cache.region.context_with(0.0)
    kind = "difference" if name == "bias" else "biased"
    L, _, depth, ratio = render_path(
        scene, sampler, ray, context, evaluator(cache), dr.opaque(mi.Float, 1), cache.settings.caching, kind, True
    )
    if name == "depth":
        return mi.Color3f(mi.Float(depth))
    if name == "spread":
        return mi.Color3f(ratio)
    if name == "dropped":
        return dr.select(dr.all(dr.isfinite(L)), mi.Color3f(0), mi.Color3f(1, 0, 1))
    return L * weight


def _training(sensor: Any, cache: RadianceCache, name: str, seed: int) -> np.ndarray:
    """White at the training pixels of the last frame; 'tiles': a checkerboard of the tiles."""
    width, height = (int(x) for x in sensor.film().crop_size())
    columns, rows, tile_w, tile_h = cache.schedule.tiles_of(width, height).grid(width, height)
    image = np.zeros((height, width, 3), np.float32)
    if name == "tiles":
        x, y = np.meshgrid((np.arange(width) / tile_w).astype(int), (np.arange(height) / tile_h).astype(int))
        image[:] = (0.25 + 0.5 * ((x + y) % 2))[..., None]
        return image
    frame = dr.opaque(mi.UInt32, max(cache.schedule.frame - 1, 0))
    at = shared_offset(frame, dr.opaque(mi.UInt32, seed & 0xFFFFFFFF))
    offset = float(at.x[0]), float(at.y[0])
    x = np.floor((np.arange(columns) + offset[0]) * tile_w).astype(int)
    y = np.floor((np.arange(rows) + offset[1]) * tile_h).astype(int)
    image[np.clip(y, 0, height - 1)[:, None], np.clip(x, 0, width - 1)[None, :]] = 1
    return image
