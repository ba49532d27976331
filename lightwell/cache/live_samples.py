"""Samples of the live page: a quarter of the pixels per frame, carried along when the camera moves.

A frame traces one pixel of each square of 2 x 2, another one each time. Their light is radiance without what the first
surface emits, divided by its albedo, so that it may be averaged over the pixels of a surface. It is denoised first,
while its pixels are independent; then, where a surface was seen before, the average of its light goes on
(reprojection). Surfaces of the frame at full size read the squares around them that show the same surface.

Notation: N pixels, M squares of 2 x 2 pixels.

References: Nehab et al. 2007, *Accelerating Real-Time Shading with Reverse Reprojection Caching*; Schied et al. 2017,
*Spatiotemporal Variance-Guided Filtering*, § 4.1 (tests of surface and normal for each of the four pixels).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.denoise_blend import LEAST_ALBEDO
from lightwell.cache.frames import film_mark, sobol_rays
from lightwell.cache.model import Model
from lightwell.cache.path_context import PathContext
from lightwell.cache.predictor import PackedWeights
from lightwell.cache.recorded import Recorded
from lightwell.cache.render_paths import render_path
from lightwell.cache.temporal import LEAST_WEIGHT, NEAR_PLANE, SAME_SIDE
from lightwell.transport.first_surfaces import past_backs

# Weight of a square that shows another surface: only where no square around shows the same one does it count.
OTHER_SURFACE = 1e-4
# Frames in the average of light that depends on the direction of view.
MOST_GLOSSY = 3.0


class LiveSurface:
    """What camera rays meet first."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "p": mi.Point3f, "n": mi.Vector3f, "t": mi.Float, "white": mi.Color3f, "emission": mi.Color3f,
        "gloss": mi.Float, "usable": mi.Bool,
    }  # fmt: skip

    def __init__(self) -> None:
        """Meet nothing."""
        self.p, self.n, self.t = mi.Point3f(0), mi.Vector3f(0), mi.Float(0)
        """Position, normal on the side of the viewer, distance; metres."""
        self.white, self.emission = mi.Color3f(1), mi.Color3f(0)
        """What light is divided by, > 0; radiance of the surface or the environment itself."""
        self.gloss = mi.Float(0)
        """Share of the reflectance that depends on the direction of view."""
        self.usable = mi.Bool(False)
        """Whether light may be averaged over the pixels that show it: neither a mirror nor clear glass."""


def _one_sided(si: mi.SurfaceInteraction3f, _: mi.Bool) -> mi.Bool:
    """Whether the backs of surfaces are not drawn, by their material alone: it may have been painted."""
    return ~mi.has_flag(si.bsdf().flags(), mi.BSDFFlags.BackSide)


def surface_of(scene: Any, ray: Any, context: PathContext) -> tuple[LiveSurface, Any]:
    """Find what camera rays meet first.

    Args:
        scene: Mitsuba scene.
        ray: [N] camera rays.
        context: Parameters of the paths.

    Returns:
        Surfaces [N], and the rays that meet them: they begin behind the backs that they have passed.
    """
    start, ray = mi.Point3f(ray.o), mi.RayDifferential3f(ray)
    si, moved = past_backs(scene, ray, _one_sided)
    ray.o = moved.o
    bsdf, met = si.bsdf(ray), si.is_valid()
    vertex, found = context.vertex(si, bsdf, met), LiveSurface()
    found.p, found.n = dr.select(met, si.p, 0), dr.select(met, vertex.n, 0)
    found.t = dr.select(met, dr.norm(si.p - start), 0)
    reflectance = dr.select(met, dr.clip(vertex.reflectance(), 0, 1), 1)
    found.white = reflectance + LEAST_ALBEDO
    emission = si.emitter(scene).eval(si)
    found.emission = dr.select(dr.all(dr.isfinite(emission)), emission, 0)
    found.gloss = dr.select(met, dr.mean(dr.clip(vertex.b, 0, 1)) / dr.maximum(dr.mean(reflectance), 1e-3), 0)
    found.usable = met & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    return found, ray


class LightHistory:
    """Averaged light of squares, and where it was seen; numbers in fours, as they are read together."""

    DRJIT_STRUCT = {"light": mi.Float, "place": mi.Float, "normal": mi.Float}  # noqa: RUF012

    def __init__(self, squares: int = 0) -> None:
        """Start without light.

        Args:
            squares: Their number M.
        """
        self.light, self.place, self.normal = (dr.zeros(mi.Float, 4 * squares) for _ in range(3))
        """[4 M]: light and frames in its average; position and 1 where it is usable; normal and 0."""


@dataclass(frozen=True)
class SampleShape:
    """Constants of a recorded pass of samples."""

    size: int
    """Edge of the picture, pixels."""
    caching: bool
    """Whether paths may end in the cache."""
    film: str
    """See ``film_mark``."""

    @property
    def half(self) -> int:
        """Squares along an edge."""
        return (self.size + 1) // 2


@functools.lru_cache(maxsize=16)
def frozen_samples(model: Model, shape: SampleShape) -> Callable[..., Any]:
    """Return the pass that traces one pixel of each square, as a recorded function.

    Args:
        model: Network of the cache.
        shape: Constants of the recording.

    Returns:
        Function of (scene, sensor, context, weights, column and row in the squares, sample, seed) with the surfaces
        [M], the radiance [M] and the light [3 M].
    """

    def run(
        scene: Any, sensor: Any, context: PathContext, weights: PackedWeights, x: mi.UInt32, y: mi.UInt32,
        first: mi.UInt32, seed: mi.UInt32,
    ) -> tuple[LiveSurface, mi.Color3f, mi.Float]:  # fmt: skip
        half, size = shape.half, shape.size
        lane = dr.arange(mi.UInt32, half * half)
        row = lane // half
        column = lane - row * half
        pixel = dr.minimum(2 * row + y, size - 1) * size + dr.minimum(2 * column + x, size - 1)
        ray, weight, _, sampler = sobol_rays(sensor, (first, mi.UInt32(1), seed), lane, pixel)
        surface, ray = surface_of(scene, ray, context)
        evaluate = lambda v, active: model.radiance(weights[0], v, weights[1])  # noqa: E731
        L, *_ = render_path(
            scene, sampler, ray, context, evaluate, mi.Float(1), shape.caching, "biased", True
        )  # fmt: skip
        L = L * weight
        L = dr.select(dr.all(dr.isfinite(L)), L, 0)
        light = dr.ravel(dr.maximum(L - surface.emission, 0) / surface.white)
        dr.eval(surface, L, light)
        return surface, L, light

    return Recorded(run)


def samples_of(model: Model, size: int, caching: bool, sensor: Any) -> Callable[..., Any]:
    """Return the pass of samples of a picture; see ``frozen_samples``."""
    return frozen_samples(model, SampleShape(size, caching, film_mark(sensor)))


@functools.lru_cache(maxsize=4)
def frozen_surfaces(size: int, film: str) -> Callable[..., Any]:
    """Return the pass that finds the surfaces at the centres of all pixels, as a recorded function.

    Args:
        size: Edge of the picture, pixels.
        film: See ``film_mark``.

    Returns:
        Function of (scene, sensor, context) with the surfaces [N].
    """

    def run(scene: Any, sensor: Any, context: PathContext) -> LiveSurface:
        lane = dr.arange(mi.UInt32, size * size)
        place = (mi.Point2f(lane % size, lane // size) + 0.5) / size
        ray, _ = sensor.sample_ray_differential(sensor.shutter_open(), 0.5, place, mi.Point2f(0.5))
        surface = surface_of(scene, ray, context)[0]
        dr.eval(surface)
        return surface

    return Recorded(run)


@functools.lru_cache(maxsize=4)
def frozen_history(half: int) -> Callable[..., Any]:
    """Return the function that averages light with that of the frames before, recorded.

    Args:
        half: Squares along an edge.

    Returns:
        Function of (scene, surfaces [M], light [3 M], history, projection of the frame before to [0, 1]^2 of its film
        as a matrix, largest number of frames in the average) with the new history.
    """

    def run(
        scene: Any, surface: LiveSurface, light: mi.Float, past: LightHistory, film: mi.Matrix4f, most: mi.Float
    ) -> LightHistory:  # fmt: skip
        now = dr.gather(mi.Color3f, light, dr.arange(mi.UInt32, half * half))
        at = film @ mi.Vector4f(surface.p.x, surface.p.y, surface.p.z, 1)
        ahead = surface.usable & (at.w > 0)
        place = mi.Point2f(at.x, at.y) / dr.select(ahead, at.w, 1) * half - 0.5
        ahead &= dr.all((place > -1) & (place < half))
        corner = dr.floor(dr.select(ahead, place, 0))
        part = place - corner
        before, frames, total = mi.Color3f(0), mi.Float(0), mi.Float(0)
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            x, y = mi.Int32(corner.x) + dx, mi.Int32(corner.y) + dy
            inside = ahead & (x >= 0) & (y >= 0) & (x < half) & (y < half)
            index = mi.UInt32(dr.select(inside, y * half + x, 0))
            seen = _same(surface, past, index, inside)
            weight = dr.select(seen, dr.abs(1 - dx - part.x) * dr.abs(1 - dy - part.y), 0)
            held = dr.gather(mi.Vector4f, past.light, index, inside)
            before += weight * mi.Color3f(held.x, held.y, held.z)
            frames += weight * held.w
            total += weight
        known = total > LEAST_WEIGHT
        scale = dr.rcp(dr.select(known, total, 1))
        limit = dr.lerp(most, dr.minimum(most, MOST_GLOSSY), dr.clip(surface.gloss, 0, 1))
        count = dr.select(known, dr.minimum(frames * scale, limit), 0)
        mean = (count * scale * before + now) / (count + 1)
        new = LightHistory()
        new.light = dr.ravel(mi.Vector4f(mean.x, mean.y, mean.z, count + 1))
        new.place = dr.ravel(mi.Vector4f(surface.p.x, surface.p.y, surface.p.z, dr.select(surface.usable, 1.0, 0.0)))
        new.normal = dr.ravel(mi.Vector4f(surface.n.x, surface.n.y, surface.n.z, 0))
        dr.eval(new)
        return new

    return Recorded(run)


def _same(surface: LiveSurface, past: LightHistory, index: mi.UInt32, active: mi.Bool) -> mi.Bool:
    """Whether squares show the surfaces [N]: near the plane, and turned alike."""
    place = dr.gather(mi.Vector4f, past.place, index, active)
    normal = dr.gather(mi.Vector4f, past.normal, index, active)
    off = dr.abs(dr.dot(mi.Vector3f(place.x, place.y, place.z) - surface.p, surface.n))
    turned = dr.dot(mi.Vector3f(normal.x, normal.y, normal.z), surface.n)
    return active & (place.w > 0.5) & (off < NEAR_PLANE * surface.t) & (turned > SAME_SIDE)


@functools.lru_cache(maxsize=4)
def frozen_upsampling(size: int) -> Callable[..., Any]:
    """Return the function that shades all pixels with the light of squares, recorded.

    Args:
        size: Edge of the picture, pixels.

    Returns:
        Function of (scene, surfaces [N], history) with radiance [3 N].
    """
    half = (size + 1) // 2

    def run(scene: Any, surface: LiveSurface, history: LightHistory) -> mi.Float:
        lane = dr.arange(mi.UInt32, size * size)
        place = (mi.Point2f(lane % size, lane // size) + 0.5) / 2 - 0.5
        corner = dr.floor(place)
        part = place - corner
        mean, total = mi.Color3f(0), mi.Float(0)
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            x = dr.clip(mi.Int32(corner.x) + dx, 0, half - 1)
            y = dr.clip(mi.Int32(corner.y) + dy, 0, half - 1)
            index = mi.UInt32(y * half + x)
            same = _same(surface, history, index, surface.usable)
            weight = dr.abs(1 - dx - part.x) * dr.abs(1 - dy - part.y) + 1e-3
            weight *= dr.select(same | ~surface.usable, 1, OTHER_SURFACE)
            held = dr.gather(mi.Vector4f, history.light, index)
            mean += weight * mi.Color3f(held.x, held.y, held.z)
            total += weight
        lit = dr.select(surface.t > 0, surface.white * mean / total, 0)
        out = dr.ravel(surface.emission + lit)
        dr.eval(out)
        return out

    return Recorded(run)
