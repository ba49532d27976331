"""The baked field on the live page: its light at what the camera sees."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lightwell.cache.live_scene import LiveScene
from lightwell.cache.warm_start import BakedLight, check_light, scattered
from lightwell.scenes.scene import Camera
from lightwell.transport.camera import gbuffer


def read_shown(live: LiveScene, path: Path) -> BakedLight:
    """Read a bake that the page can show.

    Args:
        live: The scene of the page.
        path: ``scene.glb`` of a bake of it.

    Returns:
        The fields.

    Raises:
        ValueError: The bake has things that move, lacks light of the scene, or reads what the page does not know.
        OSError: The file cannot be read.
    """
    baked = BakedLight.read(path)
    check_light(live, baked)
    return baked


def baked_image(live: LiveScene, baked: BakedLight, size: int) -> np.ndarray:
    """Evaluate a baked field at the centres of the pixels.

    The field knows the scene as it was baked: it follows the added lamp, but no object that was moved and no light that
    was dimmed since.

    Args:
        live: The scene and its camera.
        baked: Fields of a bake of the scene.
        size: Edge of the square picture, pixels.

    Returns:
        [size, size, 3] float32 radiance.
    """
    scene, orbit = replace(live.loaded, mi=live.scene), live.camera
    position, target, up = ((float(v[0]), float(v[1]), float(v[2])) for v in (orbit.position, orbit.target, orbit.up))
    points, mask, emission = gbuffer(scene, Camera(position, target, up, orbit.fov), size, size)
    picture, seen = np.array(emission, np.float32), np.flatnonzero(mask)
    if len(seen):
        picture[seen] += scattered(live, scene, points[seen], baked)
    return picture.reshape(size, size, 3)
