"""Radiance of what surrounds a scene: a constant sky, or an environment map."""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene

# Places along each edge of a pixel at which the radiance is evaluated.
PLACES = 4


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
