"""Points of a scene whose movers stand in several poses: work is done pose by pose, in scenes that stand still."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from lightwell.scenes.movers import Mover
from lightwell.scenes.posing import posed
from lightwell.scenes.scene import Scene
from lightwell.transport.samples import Query, SurfacePoints


def at_pose(points: SurfacePoints, pose: Sequence[float]) -> SurfacePoints:
    """Say in which pose points were found.

    Args:
        points: N points of a posed scene.
        pose: M sliders, 0 to 1.

    Returns:
        The points, as those of the scene with its movers.
    """
    return replace(points, pose=poses_of(len(points), pose))


def poses_of(count: int, pose: Sequence[float]) -> np.ndarray:
    """Repeat a pose.

    Args:
        count: N.
        pose: M sliders, 0 to 1.

    Returns:
        [N, M] float32.
    """
    return np.tile(np.asarray(pose, np.float32), (count, 1))


def by_pose(scene: Scene, points: SurfacePoints) -> Iterator[tuple[np.ndarray, Scene, SurfacePoints]]:
    """Split points by their pose.

    Args:
        scene: Scene with movers.
        points: N points; those without a pose belong to the scene at rest.

    Yields:
        Rows, the scene in their pose, and the points of it.
    """
    if points.pose is None:
        yield np.arange(len(points)), replace(scene, movers=()), points
        return
    poses, of = np.unique(points.pose, axis=0, return_inverse=True)
    for k, pose in enumerate(poses):
        rows = np.flatnonzero(of.reshape(-1) == k)
        yield rows, posed(scene, pose), replace(points[rows], pose=None)


def with_rest(movers: Sequence[Mover], query: Query, shape: np.ndarray, pose: np.ndarray) -> Query:
    """Add what a field of a moving scene reads: the pose, and each surface where it is at rest.

    Args:
        movers: M movers.
        query: N queries in their poses.
        shape: [N] indices into ``Scene.meshes``.
        pose: [N, M] sliders, 0 to 1.

    Returns:
        The queries with ``pose``, ``rest_position`` and ``rest_normal``.
    """
    position, normal = np.array(query.position, np.float64), np.array(query.normal, np.float64)
    for k, mover in enumerate(movers):
        for part in mover.parts:
            moves = np.isin(shape, part.meshes)
            for at in np.unique(pose[moves, k]):
                rows = np.flatnonzero(moves & (pose[:, k] == at))
                turn, offset = (motion[0] for motion in part.motion(np.array([at])))
                # The inverse of a rigid motion: x = Rᵀ (y − c).
                position[rows] = (position[rows] - offset) @ turn
                normal[rows] = normal[rows] @ turn
    return replace(
        query,
        pose=np.asarray(pose, np.float32),
        rest_position=position.astype(np.float32),
        rest_normal=normal.astype(np.float32),
    )
