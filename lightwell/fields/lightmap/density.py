"""How many texels each mesh gets: more where people look.

With equal texels per metre, a sky dome or the ground of a landscape would take all texels of an atlas, and the rooms
that are looked at none. Here the share of texels of a mesh lies between its share of the area and its share of the
pixels of likely views.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import declare
from lightwell.scenes.viewpoints import sample_cameras
from lightwell.transport.camera import camera_rays
from lightwell.transport.interactions import upload
from lightwell.transport.tables import shape_index, shape_lookup, tables

# Likely views that are counted, the scene's own among them, and their pixels.
VIEWS, WIDTH, HEIGHT = 24, 64, 48
# Share of texels ~ (share of pixels)^SEEN (share of area)^(1 - SEEN).
SEEN = 0.75
# Pixels of a mesh that no view shows; texels per metre relative to the mean, at least and at most.
UNSEEN, LEAST, MOST = 2.0, 1e-4, 1e4


def seen_density(scene: Scene, lit: np.ndarray, seed: int) -> np.ndarray:
    """Choose the texels per metre of each mesh.

    Args:
        scene: T triangles in M meshes.
        lit: [2, T] bool: sides that are stored.
        seed: Seed of the views.

    Returns:
        [M] texels per metre, relative to equal ones; 1 for meshes that are not stored.
    """
    t = tables(scene)
    area = np.bincount(t.mesh_of, weights=t.area * lit.sum(axis=0), minlength=len(scene.meshes))
    pixels = np.maximum(pixels_of_meshes(scene, sample_cameras(scene, declare((), scene), VIEWS, seed, True)), UNSEEN)
    stored = area > 0
    density = np.ones(len(area), np.float32)
    if not stored.any():
        return density
    share = pixels[stored] / pixels[stored].sum() / (area[stored] / area[stored].sum())
    square = share**SEEN
    square /= np.average(square, weights=area[stored])
    density[stored] = np.clip(np.sqrt(square), LEAST, MOST)
    return density


def pixels_of_meshes(scene: Scene, cameras: Sequence[Camera]) -> np.ndarray:
    """Count the pixels in which each mesh is the first surface.

    Args:
        scene: Scene of M meshes.
        cameras: Views to count, each of ``WIDTH`` x ``HEIGHT`` pixels.

    Returns:
        [M] counts.
    """
    pixel, centre = np.arange(WIDTH * HEIGHT, dtype=np.uint32), np.full((WIDTH * HEIGHT, 2), 0.5, np.float32)
    found = np.zeros(len(scene.meshes))
    for camera in cameras:
        ray = camera_rays(camera, WIDTH, HEIGHT, mi.UInt32(pixel), upload(mi.Point2f, centre))
        pi = scene.mi.ray_intersect_preliminary(ray)
        hit, mesh = pi.is_valid(), shape_index(shape_lookup(scene), pi.shape)
        dr.eval(hit, mesh)
        found += np.bincount(np.array(mesh)[np.array(hit, bool)], minlength=len(found))[: len(found)]
    return found
