"""Trace samples of a Mitsuba scene through its ``thinlens`` sensor, with all that ``samples.reconstruct`` needs.

Each sample keeps its raster position, its point on the lens and the camera-axis depth of its first hit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.lens.camera import LensCamera, from_thin_lens
from lightwell.lens.errors import LensError
from lightwell.lens.samples import LensSamples


@dataclass(frozen=True)
class View:
    """Properties of a sensor that the lens needs."""

    width: int
    height: int
    camera: LensCamera
    """The same blur as the sensor's aperture and focus."""


def view(scene: Any, sensor: int = 0) -> View:
    """Read the size and camera of a thin-lens sensor.

    Args:
        scene: Mitsuba scene.
        sensor: Index of the sensor.

    Returns:
        The view.

    Raises:
        LensError: The sensor is not a ``thinlens``.
    """
    eye = scene.sensors()[sensor]
    values = mi.traverse(eye)
    width, height = (int(v) for v in eye.film().size())
    try:
        fov, focus, radius = (float(np.ravel(values[n])[0]) for n in ("x_fov", "focus_distance", "aperture_radius"))
    except KeyError:
        raise LensError(
            "lens: the scene's sensor is not a 'thinlens'; give it that type, aperture_radius and focus_distance"
        ) from None
    return View(width, height, from_thin_lens(width, fov, radius, focus))


def trace(
    scene: Any, spp: int, sensor: int = 0, seed: int = 0, integrator: Any = None, time: float = 0.5
) -> LensSamples:
    """Trace rays through random points of the lens.

    Args:
        scene: Mitsuba scene.
        spp: Rays per pixel, ≥ 1.
        sensor: Index of a ``thinlens`` sensor.
        seed: Seed of the sampler.
        integrator: Mitsuba integrator; None for the scene's.
        time: Time in [0, 1] that is stored with the samples. Mitsuba's shapes do not move: the caller places a moving
            scene
            at that time and adds ``motion``.

    Returns:
        height · width · spp samples.
    """
    eye = scene.sensors()[sensor]
    integrator = integrator or scene.integrator()
    seen = view(scene, sensor)
    sampler = mi.load_dict({"type": "independent"})
    count = seen.width * seen.height * spp
    sampler.seed(seed, count)
    index = dr.arange(mi.UInt32, count) // spp
    pixel = mi.Vector2f(mi.Float(index % seen.width), mi.Float(index // seen.width))
    raster = pixel + sampler.next_2d()
    lens = sampler.next_2d()
    ray, weight = eye.sample_ray_differential(
        0.0, sampler.next_1d(), raster / mi.Vector2f(seen.width, seen.height), lens
    )
    found = scene.ray_intersect_preliminary(ray, coherent=True)
    radiance, _, _ = integrator.sample(scene, sampler, ray)
    inverse = eye.world_transform().inverse()
    axis = mi.Vector3f(inverse @ mi.Vector3f(ray.d))
    depth = dr.select(found.is_valid(), found.t * axis.z + (inverse @ mi.Point3f(ray.o)).z, dr.inf)
    on_lens = inverse @ mi.Point3f(ray.o)
    radius = float(np.ravel(mi.traverse(eye)["aperture_radius"])[0])
    # Mitsuba's camera looks along +z with +x to the left of the picture and +y up: both are negated for image axes.
    disc = np.stack([-np.array(on_lens.x), -np.array(on_lens.y)], 1) / max(radius, 1e-30)
    rgb: Any = np.array(radiance * weight).T if not isinstance(radiance, mi.Float) else None
    when = np.full(count, time, np.float32)
    return LensSamples(
        np.array(raster.x), np.array(raster.y), rgb, np.array(depth), disc, when, shape=_shape(scene, found)
    )


def _shape(scene: Any, found: Any) -> np.ndarray:
    """Return the index of the shape that was hit [n], −1 for none."""
    index = np.full(dr.width(found.t), -1, np.int32)
    for i, shape in enumerate(scene.shapes()):
        index[np.array(found.is_valid() & (found.shape == mi.ShapePtr(shape)))] = i
    return index
