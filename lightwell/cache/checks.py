"""Checks of the Mitsuba variant, scenes and sensors; each failure is one line: what, where, and the cure."""

from __future__ import annotations

from typing import Any

from lightwell.backend import mi


def check_variant(variant: str | None) -> None:
    """Check a Mitsuba variant: training needs derivatives, kernels need arrays, the network needs RGB.

    Args:
        variant: Name of the active variant; None: none is active.

    Raises:
        ValueError: The variant is not ``llvm_ad_rgb`` or ``cuda_ad_rgb``.
    """
    if variant is None or not variant.endswith("_ad_rgb"):
        raise ValueError(
            f"nrc: the Mitsuba variant is '{variant or 'none'}', lightwell_nrc needs llvm_ad_rgb or cuda_ad_rgb; "
            "call mitsuba.set_variant('llvm_ad_rgb') before importing lightwell.cache"
        )


def check_scene(scene: Any) -> None:
    """Check that a scene has emitters and shapes.

    Args:
        scene: Mitsuba scene.

    Raises:
        ValueError: The scene has no emitter or no shape.
    """
    if not scene.emitters():
        raise ValueError("nrc: the scene has no emitter, every pixel would be black; add an area light or environment")
    if not scene.shapes():
        raise ValueError("nrc: the scene has no shape, there is nothing to learn on; add one, or use integrator 'path'")


def check_sensor(sensor: Any) -> None:
    """Check that the film of a sensor has pixels.

    Args:
        sensor: Mitsuba sensor.

    Raises:
        ValueError: The film is smaller than 1 x 1 pixels.
    """
    width, height = (int(x) for x in sensor.film().crop_size())
    if width < 1 or height < 1:
        raise ValueError(f"nrc: the film is {width} x {height} pixels, expected at least 1 x 1; set width and height")


def check_hits(hits: int, sensor: Any) -> None:
    """Check that the camera sees a surface.

    Args:
        hits: Training paths that met a surface, ≥ 0.
        sensor: Mitsuba sensor that the paths started from.

    Raises:
        ValueError: ``hits`` is 0.
    """
    if hits:
        return
    transform = sensor.world_transform()
    place = [round(float(x[0]), 3) for x in transform @ mi.Point3f(0, 0, 0)]
    raise ValueError(
        f"nrc: no ray of the sensor at {place} meets a surface; it stands outside the scene or looks away from it, "
        "correct its to_world"
    )
