"""Accumulation of the denoised frames of a sequence along the motion of the first surfaces.

Each pixel looks up where its surface point was on the film of the frame before (reprojection). Where the surface seen
there is the same one, the light of the pixel is averaged with that of the frames before it, which is first clamped to
the range of the light around the pixel, so that highlights and changes of light do not lag. Images are divided by the
albedo, so that looking up between pixels does not blur textures.

Frames are averaged after they were denoised: bright single paths would be spread over all frames that follow, as noise
that the denoiser takes for light (measured, veach-ajar, 4 samples per pixel, without the clamp: averaged before, the
error of denoised frames grows from 0.43 to 1.2; averaged after, it falls to 0.37).

Geometry is taken to be at rest: the points of a moved object are not found where they were, and begin anew.

Notation: H rows, W columns.

References: Nehab et al. 2007, *Accelerating Real-Time Shading with Reverse Reprojection Caching*; Schied et al. 2017,
*Spatiotemporal Variance-Guided Filtering*, § 4.1 (tests of surface and normal for each of the four pixels).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from lightwell.backend import dr, mi
from lightwell.cache.denoise_blend import LEAST_ALBEDO
from lightwell.cache.restir import world_to_film
from lightwell.files import Arrays

# A point of the frame before is on the same surface when it lies this close to the plane of the pixel, relative to the
# distance of the camera, and the cosine between the normals is this large.
NEAR_PLANE, SAME_SIDE = 0.01, 0.9
# Largest ratio of their albedos.
ALBEDO_RATIO = 1.5
# Edge of the square around a pixel to whose range earlier light is clamped, pixels.
RANGE = 7
# Least part of the four pixels around the place that shows the surface.
LEAST_WEIGHT = 0.2


@dataclass(frozen=True)
class Surfaces:
    """First surfaces of a frame, at the centres of the pixels."""

    p: np.ndarray
    """[H, W, 3] positions, metres."""
    n: np.ndarray
    """[H, W, 3] unit normals."""
    distance: np.ndarray
    """[H, W] distance of the camera, metres."""
    albedo: np.ndarray
    """[H, W, 3] what images are divided by, > 0."""
    usable: np.ndarray
    """[H, W] whether this pixel and those around it show surfaces that neither emit light nor have a specular
    component; a pixel that shows a part of a lamp would spread its light."""


@dataclass(frozen=True)
class Past:
    """The frame before."""

    light: np.ndarray
    """[H, W, 3] averaged radiance over albedo."""
    count: np.ndarray
    """[H, W] frames in the average."""
    surfaces: Surfaces
    film: np.ndarray
    """[4, 4] projection from world space to [0, 1]^2 of the film."""


class TemporalHistory:
    """Average of the frames of a sequence."""

    def __init__(self, most: int) -> None:
        """Start without a frame.

        Args:
            most: Largest number of frames in the average, ≥ 1; 1: nothing is averaged.
        """
        self.most = most
        self.past: Past | None = None

    def forget(self) -> None:
        """Begin anew, after a change of the scene."""
        self.past = None

    def accumulate(self, picture: np.ndarray, surfaces: Surfaces, film: np.ndarray) -> np.ndarray:
        """Average a frame with those before it.

        Args:
            picture: [H, W, 3] denoised radiance.
            surfaces: First surfaces.
            film: [4, 4] projection from world space to [0, 1]^2 of the film.

        Returns:
            [H, W, 3] averaged radiance.
        """
        light = picture / surfaces.albedo
        before, count = np.zeros_like(light), np.zeros(light.shape[:2])
        if self.past is not None and self.past.light.shape == light.shape:
            before, count = reprojected(self.past, surfaces)
            before = clamped(before, light, surfaces.usable)
            count = np.minimum(count, self.most - 1)
        mean = (count[..., None] * before + light) / (count[..., None] + 1)
        self.past = Past(mean, count + 1, surfaces, film)
        averaged: np.ndarray = mean * surfaces.albedo
        return averaged

    def arrays(self) -> Arrays:
        """Return the frame before as arrays.

        Returns:
            Name to array; empty without a frame.
        """
        if self.past is None:
            return {}
        s = self.past.surfaces
        return {
            "light": self.past.light, "count": self.past.count, "film": self.past.film, "p": s.p, "n": s.n,
            "distance": s.distance, "albedo": s.albedo, "usable": s.usable,
        }  # fmt: skip

    def restore(self, arrays: Arrays) -> None:
        """Restore what ``arrays`` returned.

        Args:
            arrays: Name to array; empty: no frame.
        """
        self.past = None
        if arrays:
            names = ("p", "n", "distance", "albedo", "usable")
            surfaces = Surfaces(*(arrays[name] for name in names))
            self.past = Past(arrays["light"], arrays["count"], surfaces, arrays["film"])


def reprojected(past: Past, surfaces: Surfaces) -> tuple[np.ndarray, np.ndarray]:
    """Look up the light of surfaces in the frame before.

    Args:
        past: The frame before.
        surfaces: First surfaces of this frame.

    Returns:
        Light [H, W, 3] and frames in its average [H, W]; 0 where the surface was not seen.
    """
    height, width = surfaces.usable.shape
    at = surfaces.p @ past.film[:, :3].T + past.film[:, 3]
    ahead = surfaces.usable & (at[..., 3] > 0)
    place = at[..., :2] / np.where(ahead, at[..., 3], 1)[..., None] * (width, height) - 0.5
    place = np.where(ahead[..., None], np.clip(place, -2, (width + 1, height + 1)), -2)
    corner = np.floor(place).astype(np.int64)
    part = place - corner
    light, count, total = np.zeros_like(past.light), np.zeros((height, width)), np.zeros((height, width))
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = corner[..., 0] + dx, corner[..., 1] + dy
        inside = ahead & (x >= 0) & (y >= 0) & (x < width) & (y < height)
        row, column = np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)
        weight = np.abs(1 - dx - part[..., 0]) * np.abs(1 - dy - part[..., 1])
        weight = np.where(inside & _same(past.surfaces, surfaces, row, column), weight, 0)
        light += weight[..., None] * past.light[row, column]
        count += weight * past.count[row, column]
        total += weight
    seen = total > LEAST_WEIGHT
    total = np.where(seen, total, 1)
    return np.where(seen[..., None], light / total[..., None], 0), np.where(seen, count / total, 0)


def _same(past: Surfaces, now: Surfaces, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Whether pixels of the frame before show the surfaces of this one [H, W]."""
    off = np.abs(((past.p[row, column] - now.p) * now.n).sum(axis=-1))
    turned = (past.n[row, column] * now.n).sum(axis=-1)
    ratio = past.albedo[row, column].sum(axis=-1) / now.albedo.sum(axis=-1)
    alike = (ratio < ALBEDO_RATIO) & (ratio > 1 / ALBEDO_RATIO)
    return past.usable[row, column] & alike & (off < NEAR_PLANE * now.distance) & (turned > SAME_SIDE)


def clamped(before: np.ndarray, light: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Clamp earlier light to the range of the light around each pixel.

    Args:
        before: [H, W, 3] earlier light.
        light: [H, W, 3] light of this frame.
        usable: [H, W] pixels that count.

    Returns:
        [H, W, 3] clamped light; 0 where no pixel around counts.
    """
    size = (RANGE, RANGE, 1)
    low = minimum_filter(np.where(usable[..., None], light, np.inf), size)
    high = maximum_filter(np.where(usable[..., None], light, -np.inf), size)
    return np.where(low <= high, np.clip(before, low, np.maximum(low, high)), 0)


def first_surfaces(scene: Any, sensor: Any, albedo: np.ndarray) -> Surfaces:
    """Trace rays through the centres of the pixels.

    Args:
        scene: Mitsuba scene.
        sensor: Mitsuba sensor.
        albedo: [H, W, 3] albedo of the pixels, in [0, 1].

    Returns:
        First surfaces.
    """
    width, height = (int(x) for x in sensor.film().crop_size())
    lane = dr.arange(mi.UInt32, width * height)
    place = (mi.Point2f(lane % width, lane // width) + 0.5) / mi.Vector2f(width, height)
    ray, _ = sensor.sample_ray(sensor.shutter_open(), 0.5, place, mi.Point2f(0.5))
    si = scene.ray_intersect(ray)
    specular = mi.has_flag(si.bsdf(ray).flags(), mi.BSDFFlags.Delta)
    usable = si.is_valid() & ~specular & (si.emitter(scene) == None)  # noqa: E711
    shape = (height, width)
    return Surfaces(
        np.array(dr.select(usable, si.p, 0)).T.reshape(*shape, 3), np.array(si.n).T.reshape(*shape, 3),
        np.array(dr.select(usable, si.t, 0)).reshape(shape), np.maximum(albedo, 0) + LEAST_ALBEDO,
        minimum_filter(np.array(usable).reshape(shape).astype(bool), 3),
    )  # fmt: skip


def film_of(sensor: Any) -> np.ndarray | None:
    """Return the projection of a sensor as numbers.

    Args:
        sensor: Mitsuba sensor.

    Returns:
        [4, 4] projection from world space to [0, 1]^2 of the film; None for sensors without a field of view.
    """
    film = world_to_film(sensor)
    return None if film is None else np.array(film.matrix, np.float64).reshape(4, 4)
