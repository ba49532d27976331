"""A light for scenes that have none of their own, where nothing was declared that moves."""

from __future__ import annotations

from dataclasses import replace

from lightwell.backend import mi
from lightwell.scenes.scene import Scene

# Radiance of the sky, and candela of the lamp: the exposure follows either.
SKY, LAMP = 1.0, 10.0


def under_sky(scene: Scene) -> Scene:
    """The same scene in a white sky."""
    return _with(scene, {"type": "constant", "radiance": {"type": "rgb", "value": [SKY] * 3}})


def with_lamp(scene: Scene, place) -> Scene:
    """The same scene with a small lamp; no ray meets it but those that look for light."""
    return _with(scene, {"type": "point", "position": [float(c) for c in place], "intensity": LAMP})


def _with(scene: Scene, emitter: dict) -> Scene:
    shapes = {f"mesh_{k:06d}": shape for k, shape in enumerate(scene.mi.shapes())}
    built = mi.load_dict({"type": "scene", **shapes, "still_light": emitter}, optimize=False)
    return replace(scene, mi=built, digest=f"{scene.digest}:{sorted(emitter)}")
