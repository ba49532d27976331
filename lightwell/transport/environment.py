"""Radiance of what surrounds a scene: a constant sky, or an environment map, which may turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lightwell.backend import dr, mi
from lightwell.core.environment_text import ROTATED, turn_range
from lightwell.scenes.scene import Scene

# Places along each edge of a pixel at which the radiance is evaluated.
PLACES = 4
# Rows of the picture by which a map is told from a constant sky, and the difference that is none, relative to its
# brightest direction.
ROWS, SAME = 64, 1e-4


def environment_picture(scene: Scene, height: int) -> np.ndarray | None:
    """Evaluate the environment of a scene in all directions.

    Args:
        scene: The scene.
        height: Rows of the picture, from +Y to -Y.

    Returns:
        [height, 2 height, 3] float32 mean radiance of each pixel, equirectangular: columns by atan2(z, x), from -π
        to π; a map that turns as its file has it. None where nothing surrounds the scene.
    """
    emitter = scene.surrounding or scene.mi.environment()
    if emitter is None:
        return None
    rows, columns = PLACES * height, 2 * PLACES * height
    index = dr.arange(mi.UInt32, rows * columns)
    theta = dr.pi * (mi.Float(index // columns) + 0.5) / rows
    phi = 2 * dr.pi * ((mi.Float(index % columns) + 0.5) / columns - 0.5)
    si = dr.zeros(mi.SurfaceInteraction3f, rows * columns)
    # Towards the eye, from where the light comes.
    si.wi = -mi.Vector3f(dr.sin(theta) * dr.cos(phi), dr.cos(theta), dr.sin(theta) * dr.sin(phi))
    # A constant emitter gives one value for all rays.
    radiance = np.array(dr.zeros(mi.Color3f, rows * columns) + emitter.eval(si), np.float32).T
    blocks = radiance.reshape(height, PLACES, 2 * height, PLACES, 3)
    return np.nan_to_num(blocks.mean(axis=(1, 3)), nan=0, posinf=0).clip(min=0)


def with_turning(scene: Scene, texts: Sequence[str]) -> Scene:
    """Take the environment map out of a scene's own emitters where declarations turn it.

    Args:
        scene: The scene; not changed.
        texts: Declarations, see ``core.vary.parse_vary``.

    Returns:
        A copy without the map as an emitter, which is its ``surrounding``; the scene itself where none turns.

    Raises:
        ValueError: The scene has no environment map, or it is the same in all directions.
    """
    if not any(turn_range(text) for text in texts):
        return scene
    map_ = scene.mi.environment()
    if map_ is None:
        raise ValueError(
            f"vary: scene '{scene.name}' has no environment map that could turn; add an <emitter type=\"envmap\"> to a "
            f"Mitsuba scene, or drop {ROTATED}"
        )
    picture = environment_picture(scene, ROWS)
    if picture is None or np.ptp(picture.mean(axis=0), axis=0).max() <= SAME * picture.max():
        raise ValueError(
            f"vary: the environment of scene '{scene.name}' does not change when it turns; give it a picture, or drop "
            f"{ROTATED}"
        )
    kept = [e for e in scene.mi.emitters() if not e.is_environment() and e.get_shape() is None]
    parts = {f"mesh_{k:06d}": shape for k, shape in enumerate(scene.mi.shapes())}
    parts |= {f"emitter_{k:06d}": emitter for k, emitter in enumerate(kept)}
    made = mi.load_dict({"type": "scene", **parts}, optimize=False)
    return replace(scene, mi=made, surrounding=map_, digest=f"{scene.digest}:{ROTATED}")
