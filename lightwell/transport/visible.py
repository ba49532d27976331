"""Which sides of which triangles can be seen at all: what a light map need not store.

Notation: T triangles of all meshes behind one another; side 0 is the front (the geometric normal's), side 1 the back.
"""

from __future__ import annotations

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.transport.air import Rejection, reject
from lightwell.transport.queries import frames
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.surface import candidates
from lightwell.transport.tables import tables

# Area-uniform points that look for large triangles which are visible in part.
POINTS = 1 << 14
# Points on every side for which nothing was found yet, one after the other: its middle.
PLACES = ((1 / 3, 1 / 3),)


def visible_sides(scene: Scene, seed: int = 0, report: Rejection | None = None) -> np.ndarray:
    """[2, T] bool: sides of which some point sees air (``lightwell.transport.air``)."""
    from scipy.stats import qmc

    t = tables(scene)
    found = np.zeros((2, len(t.area)), bool)
    numbers = qmc.Sobol(7, scramble=True, rng=np.random.default_rng([seed, 0xA7]))
    _look(scene, candidates(scene, numbers.random(POINTS)), found, seed, report)
    for place in PLACES:
        side, triangle = np.nonzero(~found & (t.area > 0))
        points = side_points(scene, triangle, side, np.broadcast_to(np.float32(place), (len(triangle), 2)))
        _look(scene, points, found, seed, report)
    return found


def side_points(scene: Scene, triangle: np.ndarray, side: np.ndarray, barycentric: np.ndarray) -> SurfacePoints:
    """Points on triangles [N] of the concatenation, seen along the geometric normal of a side [N]."""
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
    """[N] the side that each point's view looks at."""
    return ((frames(scene, points)[2] * points.view).sum(axis=1) < 0).astype(np.int64)


def _look(scene: Scene, points: SurfacePoints, found: np.ndarray, seed: int, report: Rejection | None) -> None:
    if not len(points):
        return
    keep = reject(scene, points, seed=seed, report=report)
    points = points[np.flatnonzero(keep)]
    found[seen_side(scene, points), tables(scene).first[points.shape] + points.triangle] = True
