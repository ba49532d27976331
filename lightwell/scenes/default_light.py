"""A light for scenes without any light, when no variable light was declared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from lightwell.backend import mi
from lightwell.scenes.scene import Scene

# Radiance of the sky, and candela of the lamp; the exposure adapts to either.
SKY, LAMP = 1.0, 10.0


def under_sky(scene: Scene) -> Scene:
    """Surround a scene with a white sky.

    Args:
        scene: Scene without light; not changed.

    Returns:
        A copy of the scene with the sky.
    """
    return _with(scene, {"type": "constant", "radiance": {"type": "rgb", "value": [SKY] * 3}})


def with_lamp(scene: Scene, place: Sequence[float]) -> Scene:
    """Add a small lamp to a scene.

    Args:
        scene: Scene without light; not changed.
        place: [3] position, metres.

    Returns:
        A copy of the scene with a point light.
    """
    return _with(scene, {"type": "point", "position": [float(c) for c in place], "intensity": LAMP})


def _with(scene: Scene, emitter: dict[str, Any]) -> Scene:
    shapes = {f"mesh_{k:06d}": shape for k, shape in enumerate(scene.mi.shapes())}
    built = mi.load_dict({"type": "scene", **shapes, "default_light": emitter}, optimize=False)
    return replace(scene, mi=built, digest=f"{scene.digest}:{sorted(emitter)}")
