"""Further channels of a rendered picture (arbitrary output variables): depth, motion, albedo and normal per pixel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from lightwell.files import whole_file
from lightwell.scenes.scene import Camera, Scene
from lightwell.transport.camera import gbuffer
from lightwell.transport.queries import make_query

# Channels of each variable in the file: the names by which compositing programs and `lightwell lens` find them.
CHANNELS = {
    "depth": ("depth.Z",),
    "motion": ("motion.X", "motion.Y"),
    "albedo": ("albedo.R", "albedo.G", "albedo.B"),
    "normal": ("normal.X", "normal.Y", "normal.Z"),
}


def channels(scene: Scene, camera: Camera, width: int, height: int, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Compute output variables at the pixel centres.

    Args:
        scene: Scene to look at.
        camera: Pinhole camera.
        width: Pixels of a row.
        height: Rows.
        names: Keys of ``CHANNELS``.

    Returns:
        Channel → [height, width] float32. Depth is along the camera's axis in metres, infinite where nothing is;
        motion is in pixels per frame, 0 in a single picture, where nothing moves; normals are in world space.
    """
    points, mask, _ = gbuffer(scene, camera, width, height)
    query = make_query(scene, points[mask], np.zeros(3, np.float32))
    eye = np.asarray(camera.position, np.float32)
    axis = np.subtract(camera.target, camera.position)
    depth = (query.position - eye) @ np.asarray(axis / np.linalg.norm(axis), np.float32)
    values = {"depth": (depth[:, None], np.inf), "albedo": (query.reflectance, 0), "normal": (query.normal, 0)}
    values["motion"] = (np.zeros((len(query), 2), np.float32), 0)
    found = {}
    for name in names:
        rows, empty = values[name]
        plane = np.full((height * width, rows.shape[1]), empty, np.float32)
        plane[mask] = rows
        for index, channel in enumerate(CHANNELS[name]):
            found[channel] = plane[:, index].reshape(height, width)
    return found


def write_with_channels(path: Path, picture: np.ndarray, more: Mapping[str, np.ndarray]) -> None:
    """Write a picture and further channels to an EXR file; the file is either complete or absent.

    Args:
        path: File to write, .exr.
        picture: [H, W, 3] linear radiance.
        more: Channel → [H, W] float32.
    """
    import OpenEXR

    planes = {name: np.ascontiguousarray(picture[..., k], np.float32) for k, name in enumerate("RGB")}
    planes |= {name: np.ascontiguousarray(plane, np.float32) for name, plane in more.items()}
    with whole_file(path) as temporary:
        OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, planes).write(str(temporary))
