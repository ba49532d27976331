"""One pass of rendering paths over a film, and the camera rays that start it.

Notation: N lanes, one per sample of a pixel.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.guide import Guide
from lightwell.cache.model import Model
from lightwell.cache.path_context import PathContext
from lightwell.cache.predictor import PackedWeights
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.recorded import Recorded
from lightwell.cache.render_paths import render_path
from lightwell.cache.sobol_sampler import draws

# Lanes of one launch: enough to occupy the device; for an image with a time limit, few enough to meet the limit.
LAUNCH, SMALL_LAUNCH = 1 << 21, 1 << 18


Rays = tuple[Any, Any, mi.Point2f, Any]
"""Ray, weight, position on the film and source of random numbers of each lane."""
Traced = tuple[Any, mi.Bool, mi.Point2f]
"""Radiance, whether a surface was hit, and position on the film, of each lane."""


def sobol_rays(sensor: Any, numbers: Sequence[mi.UInt32], lane: mi.UInt32, pixel: mi.UInt32 | None = None) -> Rays:
    """Sample camera rays with the integrator's own (0,2) sequences.

    Args:
        sensor: Mitsuba sensor.
        numbers: Index of the first sample of each pixel, samples per pixel of this pass (≥ 1), and seed of the image.
        lane: [N] numbers of the lanes, from 0; N = pixels * samples per pixel.
        pixel: [N] row-major pixel of each lane, of one sample each; None: all pixels in order.

    Returns:
        Rays [N], their weights [N], positions on the film in pixels [N], and the random numbers for the rest of the
        path.
    """
    first, spp, seed = numbers
    film = sensor.film()
    size = film.crop_size()
    if pixel is None:
        pixel = lane // spp
        first = first + lane - pixel * spp
    sampler = draws(pixel, first, seed)
    width = dr.opaque(mi.UInt32, int(size.x))
    y = pixel // width
    at = mi.Point2f(pixel - y * width, y)
    offset = mi.Vector2f(film.crop_offset())
    place = at + sampler.next_2d()
    ray, weight = _sensor_rays(sensor, sampler, place / mi.Vector2f(size))
    box = film.rfilter().is_box_filter()
    return ray, weight, (at if box else place) + offset, sampler


def sampled_rays(sensor: Any, sampler: Any, spp: int) -> Rays:
    """Sample camera rays with a Mitsuba sampler, in the order of Mitsuba's own integrators.

    Args:
        sensor: Mitsuba sensor.
        sampler: Seeded Mitsuba sampler of pixels * ``spp`` lanes.
        spp: Samples per pixel of this pass, ≥ 1.

    Returns:
        Rays [N], their weights [N], positions on the film in pixels [N], and the sampler.
    """
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
    ray, weight = _sensor_rays(sensor, sampler, adjusted)
    return ray, weight, at if film.rfilter().is_box_filter() else place, sampler


def _sensor_rays(sensor: Any, sampler: Any, position: mi.Point2f) -> tuple[Any, Any]:
    """Sample aperture and time, and return rays through positions [N] in [0, 1)^2 on the film, with their weights."""
    aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    time = mi.Float(sensor.shutter_open())
    if sensor.shutter_open_time() > 0:
        time += sampler.next_1d() * sensor.shutter_open_time()
    return sensor.sample_ray_differential(time, 0.0, position, aperture)


def evaluator(cache: RadianceCache) -> Callable[[Any, Any], mi.Color3f]:
    """Return the function that ``render_path`` calls for radiance at query vertices.

    Args:
        cache: Cache of the scene.

    Returns:
        Function of vertices and a mask, with radiance [N]; constant 0 when paths do not end in the cache.
    """
    if not cache.settings.caching:
        return lambda v, active: mi.Color3f(0)
    packed = cache.predictor.packed("ema")
    return lambda v, active: cache.predictor.radiance(packed, v)


def trace_pass(
    scene: Any, cache: RadianceCache, rays: Rays, estimator: str, q: float, first_direct: bool = True,
    caching: bool = True, guide: Guide | None = None,
) -> Traced:  # fmt: skip
    """Trace one path per camera ray; radiance that is not finite becomes 0.

    Args:
        scene: Mitsuba scene.
        cache: Cache of the scene.
        rays: Result of ``sobol_rays`` or ``sampled_rays``.
        estimator: "biased", "residual", "difference" or "guided", see ``render_path``.
        q: Probability that a path continues behind a query, in (0, 1].
        first_direct: Whether direct light at the primary hit is counted.
        caching: Whether paths may end in the cache.
        guide: ``Guide`` to sample directions from beside the BSDF; None: the BSDF alone.

    Returns:
        Radiance [N], mask of rays that hit a surface [N], and positions on the film in pixels [N].
    """
    context, evaluate = cache.region.context, evaluator(cache)
    return _traced(scene, rays, context, evaluate, dr.opaque(mi.Float, q), caching, estimator, first_direct, guide)


def _traced(
    scene: Any, rays: Rays, context: PathContext, evaluate: Callable[[Any, Any], Any], q: mi.Float, caching: bool,
    estimator: str, first_direct: bool, guide: Guide | None,
) -> Traced:  # fmt: skip
    ray, weight, place, sampler = rays
    L, valid, _, _ = render_path(
        scene, sampler, ray, context, evaluate, q, caching, estimator, first_direct, guide
    )  # fmt: skip
    L = L * weight
    L = dr.select(dr.all(dr.isfinite(L)), L, 0)
    return L, valid, place


@dataclass(frozen=True)
class PassShape:
    """Constants of a recorded pass; one recording serves passes of all sizes."""

    caching: bool
    """Whether paths may end in the cache."""
    estimator: str
    """Name of the estimator, see ``render_path``."""
    first_direct: bool
    """Whether direct light at the primary hit is counted."""
    film: str
    """Sensor class, film and shutter, see ``film_mark``."""
    guided: bool = False
    """Whether directions are sampled from a guide, too."""


def film_mark(sensor: Any) -> str:
    """Describe the properties of a sensor that a recorded function treats as constants.

    Args:
        sensor: Mitsuba sensor.

    Returns:
        Text that is equal for sensors that can share a recording.
    """
    film = sensor.film()
    shutter = (sensor.shutter_open(), sensor.shutter_open_time())
    box = film.rfilter().is_box_filter()
    return f"{sensor.class_name()} {film.crop_size()} {film.crop_offset()} {film.size()} {shutter} {box}"


@functools.lru_cache(maxsize=64)
def frozen_pass(model: Model, shape: PassShape) -> Callable[..., Any]:
    """Return a pass over a film as a function that is recorded once; tracing its Python takes longer than a small pass.

    Args:
        model: Network of the cache.
        shape: Constants of the recording.

    Returns:
        Function of (scene, sensor, context, weights, guide, q, lanes, first sample, samples per pixel, seed) with the
        result of ``trace_pass``.
    """

    def run(
        scene: Any, sensor: Any, context: PathContext, weights: PackedWeights, guide: Guide | None, q: mi.Float,
        lane: mi.UInt32, first: mi.UInt32, spp: mi.UInt32, seed: mi.UInt32,
    ) -> Traced:  # fmt: skip
        rays = sobol_rays(sensor, (first, spp, seed), lane)
        evaluate = lambda v, active: model.radiance(weights[0], v, weights[1])  # noqa: E731
        out = _traced(scene, rays, context, evaluate, q, shape.caching, shape.estimator, shape.first_direct, guide)
        dr.eval(out)
        return out

    return Recorded(run)


def sobol_pass(
    scene: Any, sensor: Any, cache: RadianceCache, numbers: Sequence[mi.UInt32], N: int, estimator: str, q: float,
    caching: bool, guide: Guide | None = None,
) -> Traced:  # fmt: skip
    """Trace one pass with the integrator's own random numbers.

    Args:
        scene: Mitsuba scene.
        sensor: Mitsuba sensor.
        cache: Cache of the scene.
        numbers: First sample, samples per pixel and seed, opaque 32-bit numbers.
        N: Number of lanes: pixels * samples per pixel.
        estimator: "biased", "residual", "difference" or "guided".
        q: Probability that a path continues behind a query, in (0, 1].
        caching: Whether paths may end in the cache.
        guide: ``Guide``; None: sample the BSDF alone.

    Returns:
        Result of ``trace_pass``.
    """
    shape = PassShape(caching, estimator, True, film_mark(sensor), guide is not None)
    context, weights = cache.region.context, cache.predictor.packed("ema")
    lane = dr.arange(mi.UInt32, N)
    dr.make_opaque(lane)
    return frozen_pass(cache.predictor.model, shape)(
        scene, sensor, context, weights, guide, dr.opaque(mi.Float, q), lane, *numbers
    )


def splat(film: Any, L: mi.Spectrum, valid: mi.Bool, place: mi.Point2f, coalesce: bool) -> Any:
    """Accumulate samples in a new image block.

    Args:
        film: Mitsuba film.
        L: [N] radiance.
        valid: [N] mask of samples with alpha 1.
        place: [N] positions on the film in pixels.
        coalesce: Whether neighbouring lanes fall into the same pixel and may be merged.

    Returns:
        Image block with the sums.

    Raises:
        ValueError: The film prepares samples itself, which only hdrfilm-like films do not.
    """
    block = film.create_block()
    block.set_coalesce(block.coalesce() and coalesce)
    alpha = dr.select(valid, mi.Float(1), mi.Float(0))
    if mi.has_flag(film.flags(), mi.FilmFlags.Special):
        raise ValueError(f"nrc: the film '{film.class_name()}' wants its samples prepared; use an hdrfilm")
    values = [L.x, L.y, L.z, alpha, mi.Float(1)] if block.channel_count() == 5 else [L.x, L.y, L.z, mi.Float(1)]
    block.put(place, values)
    return block
