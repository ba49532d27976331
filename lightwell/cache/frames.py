"""One pass of rendering paths over a film, and the rays that start it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.draws import Draws, draws
from lightwell.cache.paths import render_path
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.recorded import Recorded

# Lanes of one launch: large enough to fill the machine; of a picture by time, small enough to end in time.
LAUNCH, SMALL_LAUNCH = 1 << 21, 1 << 18


def sobol_rays(sensor: Any, first: mi.UInt32, spp: mi.UInt32, seed: mi.UInt32, count: int):
    """Camera rays of ``count`` lanes, sample ``first`` ... of each pixel: (ray, weight, place on the film, numbers)."""
    film = sensor.film()
    size = film.crop_size()
    lane = dr.arange(mi.UInt32, count)
    pixel = lane // spp
    sampler = draws(pixel, first + lane - pixel * spp, seed)
    width = dr.opaque(mi.UInt32, int(size.x))
    y = pixel // width
    at = mi.Point2f(pixel - y * width, y)
    offset = mi.Vector2f(film.crop_offset())
    place = at + sampler.next_2d()
    aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    time = mi.Float(sensor.shutter_open())
    if sensor.shutter_open_time() > 0:
        time += sampler.next_1d() * sensor.shutter_open_time()
    ray, weight = sensor.sample_ray_differential(time, 0.0, place / mi.Vector2f(size), aperture)
    box = film.rfilter().is_box_filter()
    return ray, weight, (at if box else place) + offset, sampler


def sampled_rays(sensor: Any, sampler: Any, spp: int):
    """The same from a Mitsuba sampler, drawing numbers as Mitsuba's own integrators do."""
    film = sensor.film()
    size = film.crop_size()
    lane = dr.arange(mi.UInt32, int(size.x) * int(size.y) * spp) // dr.opaque(mi.UInt32, spp)
    width = dr.opaque(mi.UInt32, int(size.x))
    y = lane // width
    offset = mi.Vector2f(film.crop_offset())
    at = mi.Vector2f(mi.Float(lane - y * width), mi.Float(y)) + offset
    place = at + sampler.next_2d()
    scale = dr.rcp(mi.ScalarVector2f(size))
    adjusted = dr.fma(place, scale, -mi.ScalarVector2f(film.crop_offset()) * scale)
    aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    time = mi.Float(sensor.shutter_open())
    if sensor.shutter_open_time() > 0:
        time += sampler.next_1d() * sensor.shutter_open_time()
    ray, weight = sensor.sample_ray_differential(time, 0.0, adjusted, aperture)
    return ray, weight, at if film.rfilter().is_box_filter() else place, sampler


def evaluator(cache: RadianceCache) -> Callable[[Any, Any], mi.Color3f]:
    """What ``render_path`` asks at query vertices."""
    if not cache.settings.caching:
        return lambda v, active: mi.Color3f(0)
    packed = cache.packed("ema")
    return lambda v, active: cache.radiance(packed, v)


def trace_pass(
    scene: Any, cache: RadianceCache, rays: Any, estimator: str, q: float, first_direct: bool = True,
    caching: bool = True, guide: Any = None,
):  # fmt: skip
    """Radiance [N], validity, path length, spread and place for camera rays; what is not finite becomes 0."""
    return _traced(
        scene, rays, cache.around, evaluator(cache), dr.opaque(mi.Float, q), caching, estimator, first_direct, guide
    )  # fmt: skip


def _traced(scene, rays, around, evaluate, q, caching, estimator, first_direct, guide):
    ray, weight, place, sampler = rays
    L, valid, depth, ratio = render_path(
        scene, sampler, ray, around, evaluate, q, caching, estimator, first_direct, guide
    )  # fmt: skip
    L = L * weight
    L = dr.select(dr.all(dr.isfinite(L)), L, 0)
    return L, valid, depth, ratio, place


@dataclass(frozen=True)
class PassShape:
    """What a recording of a pass depends on beside its arrays."""

    N: int
    caching: bool
    estimator: str
    first_direct: bool
    film: str
    """Kind of the sensor, its film and its shutter, all of which are baked in."""
    guided: bool = False


def film_mark(sensor: Any) -> str:
    """What of a sensor is no array."""
    film = sensor.film()
    shutter = (sensor.shutter_open(), sensor.shutter_open_time())
    box = film.rfilter().is_box_filter()
    return f"{sensor.class_name()} {film.crop_size()} {film.crop_offset()} {film.size()} {shutter} {box}"


@functools.lru_cache(maxsize=64)
def frozen_pass(model: Any, shape: PassShape) -> Callable[..., Any]:
    """f(scene, sensor, around, weights, guide, q, first sample, samples per pixel, seed) -> what ``trace_pass`` gives,
    and the rays. Recorded once: to trace its Python takes longer than a small pass."""

    def run(scene, sensor, around, weights, guide, q, first, spp, seed):
        rays = sobol_rays(sensor, first, spp, seed, shape.N)
        evaluate = lambda v, active: model.radiance(weights[0], v, weights[1])  # noqa: E731
        out = _traced(scene, rays, around, evaluate, q, shape.caching, shape.estimator, shape.first_direct, guide)
        dr.eval(out)
        return out

    return Recorded(run)


def sobol_pass(
    scene: Any, sensor: Any, cache: RadianceCache, numbers: Any, N: int, estimator: str, q: float, caching: bool,
    guide: Any = None,
):  # fmt: skip
    """One pass of N lanes with the cache's own numbers; ``numbers``: first sample, samples per pixel, seed."""
    shape = PassShape(N, caching, estimator, True, film_mark(sensor), guide is not None)
    around, weights = cache.around, cache.packed("ema")
    return frozen_pass(cache.model, shape)(scene, sensor, around, weights, guide, dr.opaque(mi.Float, q), *numbers)


def splat(film: Any, L: mi.Spectrum, valid: mi.Bool, place: mi.Point2f, wavelengths: Any, coalesce: bool) -> Any:
    """A new block of the film with the values put in."""
    block = film.create_block()
    block.set_coalesce(block.coalesce() and coalesce)
    alpha = dr.select(valid, mi.Float(1), mi.Float(0))
    if mi.has_flag(film.flags(), mi.FilmFlags.Special):
        raise ValueError(f"nrc: the film '{film.class_name()}' wants its samples prepared; use an hdrfilm")
    values = [L.x, L.y, L.z, alpha, mi.Float(1)] if block.channel_count() == 5 else [L.x, L.y, L.z, mi.Float(1)]
    block.put(place, values)
    return block


__all__ = [
    "LAUNCH", "Draws", "evaluator", "sampled_rays", "sobol_pass", "sobol_rays", "splat", "trace_pass",
]  # fmt: skip
