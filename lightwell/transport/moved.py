"""Points of a scene whose mover stands in several poses: work is done pose by pose, in scenes that stand still."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lightwell.scenes.movers import Mover
from lightwell.scenes.posing import posed
from lightwell.scenes.scene import Scene
from lightwell.transport.samples import Query, SurfacePoints


def at_pose(points: SurfacePoints, slider: float) -> SurfacePoints:
    """Say in which pose points were found.

    Args:
        points: N points of a posed scene.
        slider: The pose, 0 to 1.

    Returns:
        The points, as those of the scene with its mover.
    """
    return replace(points, pose=np.full(len(points), slider, np.float32))


def by_pose(scene: Scene, points: SurfacePoints) -> Iterator[tuple[np.ndarray, Scene, SurfacePoints]]:
    """Split points by their pose.

    Args:
        scene: Scene with a mover.
        points: N points; those without a pose belong to the scene at rest.

    Yields:
        Rows, the scene in their pose, and the points of it.
    """
    if points.pose is None:
        yield np.arange(len(points)), replace(scene, mover=None), points
        return
    for slider in np.unique(points.pose):
        rows = np.flatnonzero(points.pose == slider)
        yield rows, posed(scene, float(slider)), replace(points[rows], pose=None)


def with_rest(mover: Mover, query: Query, shape: np.ndarray, slider: np.ndarray) -> Query:
    """Add what a field of a moving scene reads: the pose, and each surface where it is at rest.

    Args:
        mover: The mover.
        query: N queries in their poses.
        shape: [N] indices into ``Scene.meshes``.
        slider: [N] poses, 0 to 1.

    Returns:
        The queries with ``pose``, ``rest_position`` and ``rest_normal``.
    """
    position, normal = np.array(query.position, np.float64), np.array(query.normal, np.float64)
    moves = np.isin(shape, mover.meshes)
    for at in np.unique(slider[moves]):
        rows = np.flatnonzero(moves & (slider == at))
        turn, offset = (motion[0] for motion in mover.motion(np.array([at])))
        # The inverse of a rigid motion: x = Rᵀ (y − c).
        position[rows] = (position[rows] - offset) @ turn
        normal[rows] = normal[rows] @ turn
    return replace(
        query,
        pose=np.asarray(slider, np.float32).reshape(-1, 1),
        rest_position=position.astype(np.float32),
        rest_normal=normal.astype(np.float32),
    )
