"""The progressive picture of the live page.

While something moves, each frame traces a quarter of the pixels; their light is carried along from frame to frame,
denoised at half of the resolution, and read by all pixels. At rest, samples of all pixels are averaged, and their mean
is denoised at full size now and then.
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.frames import film_mark
from lightwell.cache.live_samples import (
    LightHistory,
    LiveSurface,
    frozen_history,
    frozen_surfaces,
    frozen_upsampling,
    samples_of,
)
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.restir import world_to_film
from lightwell.core.denoise import denoise_fast, missing

# Order in which the pixels of a square are traced: column and row.
ORDER = ((0, 0), (1, 1), (1, 0), (0, 1))
# Frames in the average of light: largest number; number after a change of the scene, and frames for which it holds.
MOST, MOST_CHANGED, CHANGED_FRAMES = 32.0, 1.0, 4
# Samples per pixel at rest from which the mean of the pixels is shown; factor of the samples to the next picture.
SHOWN_SPP, LATER = 2, 1.5
# Samples per pixel after which nothing is traced any more.
MOST_SPP = 256
# Seed of the samples at rest.
SEED = 7


Traced = tuple[LiveSurface, mi.Color3f, mi.Float]
"""Surfaces [M], radiance [M] and light [3 M] of one pixel of each square."""


class LivePicture:
    """Picture of one integrator, which gets better while nothing moves."""

    def __init__(self, size: int, caching: bool) -> None:
        """Start without samples.

        Args:
            size: Edge of the square picture, pixels.
            caching: Whether paths end in the cache.
        """
        self.size, self.caching = size, caching
        self.image: mi.Float = dr.zeros(mi.Float, 3 * size * size)
        """[3 N] radiance that is shown."""
        self.frames = 0
        """Frames since the picture began."""
        self._half = (size + 1) // 2
        self._denoises = missing() is None
        self._surfaces: LiveSurface | None = None
        self._film: Any = None
        self._changed = 0
        self.forget()

    def forget(self) -> None:
        """Restart without light of earlier frames."""
        self._history = LightHistory(self._half**2)
        self._film = None
        self.moved()

    def moved(self) -> None:
        """Restart the averages of the pixels after the camera has moved; the light of surfaces is kept."""
        self._surfaces = None
        self.still = 0
        """Frames since something moved."""
        self._sums: list[list[mi.Float] | None] = [None] * len(ORDER)
        self._counts = [0] * len(ORDER)
        self._shown_at = 0.0

    def changed(self) -> None:
        """Restart the averages of the pixels after the scene has changed; earlier light fades in four frames."""
        self.moved()
        self._changed = CHANGED_FRAMES

    @property
    def spp(self) -> int:
        """Return the samples that every pixel has."""
        return min(self._counts)

    def advance(self, scene: Any, sensor: Any, cache: RadianceCache, scale: float) -> bool:
        """Trace a quarter of the pixels, and make the picture anew where that pays.

        Args:
            scene: Mitsuba scene.
            sensor: Its sensor, a perspective camera.
            cache: Cache of the scene.
            scale: What makes the radiance about 1.

        Returns:
            Whether ``image`` has changed.
        """
        if self.spp >= MOST_SPP:
            return False
        phase = self.frames % len(ORDER)
        surfaces, L, light = self._trace(scene, sensor, cache, phase)
        self._add(phase, surfaces, L)
        self.frames += 1
        self.still += 1
        if self.spp < SHOWN_SPP:
            self._carry(scene, sensor, cache, surfaces, light, scale)
            return True
        if self.still < self._shown_at:
            return False
        self._resolve(scale)
        self._shown_at = LATER * self.still
        return True

    def _trace(self, scene: Any, sensor: Any, cache: RadianceCache, phase: int) -> Traced:
        """Trace a pixel of each square."""
        x, y = ORDER[phase]
        seed = SEED if self.still else self.frames & 0xFFFFFF
        numbers = [dr.opaque(mi.UInt32, n) for n in (x, y, self._counts[phase], seed)]
        traced = samples_of(cache.predictor.model, self.size, self.caching, sensor)
        found: Traced = traced(scene, sensor, cache.region.context, cache.predictor.packed("ema"), *numbers)
        return found

    def _add(self, phase: int, surfaces: LiveSurface, L: mi.Color3f) -> None:
        """Add samples to the sums of their pixels: radiance, albedo and normal."""
        new = [dr.ravel(L), dr.ravel(surfaces.white), dr.ravel(mi.Color3f(surfaces.n))]
        before = self._sums[phase]
        self._sums[phase] = new if before is None else [a + b for a, b in zip(before, new)]
        dr.eval(self._sums[phase])
        self._counts[phase] += 1

    def _carry(
        self, scene: Any, sensor: Any, cache: RadianceCache, surfaces: LiveSurface, light: mi.Float, scale: float
    ) -> None:
        """Denoise the light, average it with that of the frames before, and shade all pixels with it."""
        if self._denoises:
            white = dr.full(mi.Float, 0.5, 3 * self._half**2)
            light = _denoised(light, white, dr.ravel(mi.Color3f(surfaces.n)), self._half, scale)
        film = world_to_film(sensor).matrix
        most = MOST_CHANGED if self._changed else MOST
        self._changed = max(self._changed - 1, 0)
        self._history = frozen_history(self._half)(
            scene, surfaces, light, self._history, film if self._film is None else self._film, dr.opaque(mi.Float, most)
        )
        self._film = film
        if self._surfaces is None:
            self._surfaces = frozen_surfaces(self.size, film_mark(sensor))(scene, sensor, cache.region.context)
        self.image = frozen_upsampling(self.size)(scene, self._surfaces, self._history)

    def _resolve(self, scale: float) -> None:
        """Denoise the means of all pixels."""
        pixel = dr.arange(mi.UInt32, self.size**2)
        y = pixel // self.size
        x = pixel - y * self.size
        index = (y // 2) * self._half + x // 2
        images = [mi.Color3f(0), mi.Color3f(0), mi.Color3f(0)]
        for (column, row), sums, count in zip(ORDER, self._sums, self._counts):
            here = ((x & 1) == column) & ((y & 1) == row)
            share = dr.opaque(mi.Float, 1 / count)
            for k, total in enumerate(sums or ()):
                images[k] += dr.gather(mi.Color3f, total, index, here) * share
        color, white, normal = (dr.ravel(image) for image in images)
        self.image = _denoised(color, white, normal, self.size, scale) if self._denoises else color
        dr.eval(self.image)


def _denoised(color: mi.Float, white: mi.Float, normal: mi.Float, size: int, scale: float) -> mi.Float:
    """Denoise images [3 N] that are ``size`` pixels wide and high."""
    shape = (size, size, 3)
    noisy, albedo, normals = (mi.TensorXf(image, shape) for image in (color, dr.clip(white, 0, 1), normal))
    return denoise_fast(noisy, albedo, normals, scale).array
