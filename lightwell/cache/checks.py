"""What a scene and a sensor must be like; each failure is one line that says what, where, and the cure."""

from __future__ import annotations

from typing import Any

from lightwell.backend import mi


def check_variant() -> None:
    """RGB, differentiable, and not scalar: training needs gradients, kernels need arrays."""
    variant = mi.variant() or "none"
    if not variant.endswith("_ad_rgb"):
        raise ValueError(
            f"nrc: the Mitsuba variant is '{variant}', lightwell_nrc needs llvm_ad_rgb or cuda_ad_rgb; "
            "call mitsuba.set_variant('llvm_ad_rgb') before importing lightwell.cache"
        )


def check_scene(scene: Any) -> None:
    """There must be light and surface."""
    if not scene.emitters():
        raise ValueError("nrc: the scene has no emitter, every pixel would be black; add an area light or environment")
    if not scene.shapes():
        raise ValueError("nrc: the scene has no shape, there is nothing to learn on; add one, or use integrator 'path'")


def check_sensor(sensor: Any) -> None:
    """The film must have pixels."""
    width, height = (int(x) for x in sensor.film().crop_size())
    if width < 1 or height < 1:
        raise ValueError(f"nrc: the film is {width} x {height} pixels, expected at least 1 x 1; set width and height")


def check_hits(hits: int, sensor: Any) -> None:
    """A camera that meets no surface at all looks the wrong way or stands outside the scene."""
    if hits:
        return
    transform = sensor.world_transform()
    place = [round(float(x[0]), 3) for x in transform @ mi.Point3f(0, 0, 0)]
    raise ValueError(
        f"nrc: no ray of the sensor at {place} meets a surface; it stands outside the scene or looks away from it, "
        "correct its to_world"
    )
