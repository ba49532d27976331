"""A quick picture of a scene's surfaces, which needs no light and no tracing of paths."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lightwell.backend import dr, mi
from lightwell.core.color import srgb_bytes

if TYPE_CHECKING:
    from lightwell.scenes.scene import Scene

# Rays per pixel along each axis, share of the colour that surfaces seen edge-on keep, and colour where no surface is.
SUBPIXELS, AMBIENT, BACKGROUND = 2, 0.25, 0.02
# A scene without a camera is seen from outside, from this direction, by so many times its size.
FROM, DISTANCE, FOV_Y = (0.55, 0.45, 0.7), 1.7, 40.0


class _Eye(NamedTuple):
    position: np.ndarray
    target: np.ndarray
    up: tuple[float, float, float]
    fov_y: float


def preview(scene: Scene, width: int = 400, height: int = 250) -> np.ndarray:
    """Draw the surfaces of a scene, shaded as by a lamp at the camera.

    Args:
        scene: The scene; seen from its first camera, or as a whole from outside.
        width: Pixels of a row.
        height: Rows.

    Returns:
        [height, width, 3] uint8 sRGB.
    """
    eye = _eye(scene)
    size = (SUBPIXELS * height, SUBPIXELS * width)
    ray = mi.Ray3f(mi.Point3f(*(float(c) for c in eye.position)), mi.Vector3f(*_directions(eye, *size).T))
    si = scene.mi.ray_intersect(ray)
    facing = dr.abs(dr.dot(si.sh_frame.n, ray.d))
    color = si.bsdf().eval_diffuse_reflectance(si) * (AMBIENT + (1 - AMBIENT) * facing)
    color = np.array(dr.select(si.is_valid(), color, BACKGROUND)).T.reshape(*size, 3)
    tiles = np.nan_to_num(color).reshape(height, SUBPIXELS, width, SUBPIXELS, 3)
    return srgb_bytes(tiles.mean(axis=(1, 3)))


def _eye(scene: Scene) -> _Eye:
    """The first camera of a scene, or a place outside from which all of it is seen."""
    if scene.cameras:
        camera = scene.cameras[0]
        return _Eye(np.asarray(camera.position), np.asarray(camera.target), camera.up, camera.fov_y)
    away = np.asarray(FROM) / np.linalg.norm(FROM) * DISTANCE * np.linalg.norm(np.diff(scene.bounds, axis=0))
    return _Eye(scene.center + away, scene.center, (0.0, 1.0, 0.0), FOV_Y)


def _directions(eye: _Eye, height: int, width: int) -> np.ndarray:
    """Unit directions [N, 3] float32 through the pixel centres, first row at the top."""
    forward = np.subtract(eye.target, eye.position, dtype=np.float64)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, eye.up)
    right /= np.linalg.norm(right)
    half = np.tan(np.radians(eye.fov_y) / 2)
    y, x = np.mgrid[height - 1 : -height : -2, 1 - width : width : 2]
    across = x.reshape(-1, 1) / height * half * right + y.reshape(-1, 1) / height * half * np.cross(right, forward)
    directions = forward + across
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(directions, np.float32)
