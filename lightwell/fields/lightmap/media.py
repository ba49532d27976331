"""Subsurface light: radiance of translucent solids, traced with Mitsuba's ``volpath``.

The scene's own data holds surfaces only; Mitsuba loads the same file once more, with the media inside its shapes.
Media between surfaces (fog) are not supported: rays start just above the surface that they look at.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.transport.interactions import upload
from lightwell.transport.path_numbers import check_halves
from lightwell.transport.queries import frames
from lightwell.transport.samples import SurfacePoints

# Bounces in the medium; beyond the second, paths may end early.
MAX_DEPTH, RR_DEPTH = 128, 32
# Rays start this share of the scene's extent above the surface, and rays of one launch.
LIFT, LAUNCH = 1e-3, 1 << 19


def media_meshes(scene: Scene) -> np.ndarray:
    """Find the meshes with a medium inside.

    Args:
        scene: M meshes.

    Returns:
        [M] bool.
    """
    return np.array([mesh.medium for mesh in scene.meshes], bool)


def volumetric(scene: Scene, points: SurfacePoints, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Trace radiance that leaves points towards their views, as ``static`` does, with subsurface light.

    Args:
        scene: The scene.
        points: N surface points.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the sampler.

    Returns:
        Two independent half means, [N, 3] each.

    Raises:
        ValueError: ``paths`` is odd or less than 2.
    """
    check_halves(paths)
    place, half = frames(scene, points)[0], paths // 2
    origin = place + LIFT * scene.core_extent * points.view
    batch, out = max(1, LAUNCH // half), np.zeros((2, len(points), 3), np.float32)
    for k in (0, 1):
        for start in range(0, len(points), batch):
            rows = slice(start, min(start + batch, len(points)))
            number = (seed * 2 + k) * 4099 + start // batch
            out[k, rows] = _mean(_with_media(scene), origin[rows], -points.view[rows], half, number & 0xFFFFFFFF)
    return out[0], out[1]


WITH_MEDIA = Derived[Any]("bake.scene_with_media")


def _with_media(scene: Scene) -> Any:
    """The Mitsuba scene of the file, media and all, loaded once."""
    return scene.cache.get(WITH_MEDIA, lambda: _whole(scene))


def _whole(scene: Scene) -> Any:
    if scene.whole is None:
        raise ValueError(f"transport: scene '{scene.name}' has no media; load a Mitsuba file")
    return scene.whole()


def _mean(geometry: Any, origin: np.ndarray, direction: np.ndarray, paths: int, seed: int) -> np.ndarray:
    """[N, 3] mean radiance of rays; a path that is not finite counts as 0."""
    count = len(origin) * paths
    row = dr.arange(mi.UInt32, count) // paths
    take = lambda rows, kind: dr.gather(kind, upload(kind, rows), row)  # noqa: E731
    ray = mi.RayDifferential3f(mi.Ray3f(take(origin, mi.Point3f), take(direction, mi.Vector3f)))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    integrator = mi.load_dict({"type": "volpath", "max_depth": MAX_DEPTH, "rr_depth": RR_DEPTH})
    light, _, _ = integrator.sample(geometry, sampler, ray)
    light = dr.select(dr.all(dr.isfinite(light)), light, 0)
    return np.array(dr.block_sum(light, paths)).T / paths
