"""Visible sides of triangles: a light map stores no others.

Notation: T triangles of all meshes behind one another; side 0 is the front (the geometric normal's), side 1 the back.
"""

from __future__ import annotations

import numpy as np

from lightwell.core.sobol import Sobol
from lightwell.scenes.scene import Scene
from lightwell.transport.pieces import whole
from lightwell.transport.point_rejection import Rejection, reject
from lightwell.transport.queries import frames
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.surface import candidates
from lightwell.transport.tables import tables

# Area-uniform points, which find large triangles that are partly visible.
POINTS = 1 << 14
# Barycentric weights of further points, one after the other, on every side without a visible point: its middle.
PLACES = ((1 / 3, 1 / 3),)


def visible_sides(
    scene: Scene, seed: int = 0, report: Rejection | None = None, within: np.ndarray | None = None
) -> np.ndarray:
    """Find the sides of triangles on which some point borders on air (``lightwell.transport.point_rejection``).

    Args:
        scene: Scene with T triangles.
        seed: Seed of the points that are tested.
        report: Receives the counts of dropped points, by reason.
        within: [T] bool: triangles of which each is tested; of the others, only those that random points lie on.
            None: all.

    Returns:
        [2, T] bool.
    """
    t = tables(scene)
    found = np.zeros((2, len(t.area)), bool)
    numbers = Sobol(7, np.random.default_rng([seed, 0xA7]))
    _look(scene, candidates(scene, numbers.random(POINTS), whole(scene)), found, seed, report)
    each = t.area > 0 if within is None else (t.area > 0) & within
    for place in PLACES:
        side, triangle = np.nonzero(~found & each)
        points = side_points(scene, triangle, side, np.broadcast_to(np.float32(place), (len(triangle), 2)))
        _look(scene, points, found, seed, report)
    return found


def side_points(scene: Scene, triangle: np.ndarray, side: np.ndarray, barycentric: np.ndarray) -> SurfacePoints:
    """Make points on given sides of triangles, seen along the geometric normal of the side.

    Args:
        scene: Scene with T triangles.
        triangle: [N] triangles, in [0, T).
        side: [N] sides: 0 front, 1 back.
        barycentric: [N, 2] weights of the second and third vertex.

    Returns:
        N points.
    """
    t = tables(scene)
    shape = t.mesh_of[triangle]
    points = SurfacePoints(
        shape=shape.astype(np.uint32),
        triangle=(triangle - t.first[shape]).astype(np.uint32),
        barycentric=np.asarray(barycentric, np.float32),
        view=np.zeros((len(triangle), 3), np.float32),
    )
    flat = frames(scene, points)[2]
    view = np.where(np.asarray(side)[:, None] == 0, flat, -flat)
    return SurfacePoints(points.shape, points.triangle, points.barycentric, view.astype(np.float32))


def seen_side(scene: Scene, points: SurfacePoints) -> np.ndarray:
    """Find the side that each point's view looks at.

    Args:
        scene: Scene of the points.
        points: N points.

    Returns:
        [N] int64: 0 front, 1 back.
    """
    return ((frames(scene, points)[2] * points.view).sum(axis=1) < 0).astype(np.int64)


def _look(scene: Scene, points: SurfacePoints, found: np.ndarray, seed: int, report: Rejection | None) -> None:
    if not len(points):
        return
    keep = reject(scene, points, seed=seed, report=report)
    points = points[np.flatnonzero(keep)]
    found[seen_side(scene, points), tables(scene).first[points.shape] + points.triangle] = True
