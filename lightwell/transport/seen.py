"""Where samples are taken: mostly where people look, a share over all surfaces.

A picture's error is judged where it is seen, and of a house most surface never is. Half of the points are what the
pixels of many cameras show, a quarter is met by rays from random places of the air, a quarter is area-uniform, so that
no surface that sees air is left undefined. Notation: N points asked for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.free_air import free_air
from lightwell.scenes.placing import sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import PointLight, Variable
from lightwell.scenes.viewpoints import camera_frame
from lightwell.transport.first_surfaces import first_surface
from lightwell.transport.interactions import upload
from lightwell.transport.point_rejection import room
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.surface import SurfaceDraw, draw_surface
from lightwell.transport.tables import shape_index, shape_lookup

# Shares of the points: through cameras, from random places of the air; the rest is area-uniform.
CAMERA_SHARE, AIR_SHARE = 0.5, 0.25
# Sampled cameras of one draw, beside the scene's own.
CAMERAS = 64
# Width of a picture over its height.
ASPECT = 1.6
# Candidates tried per eye wanted, and eyes of one draw.
EYE_CANDIDATES, EYES = 8, 512
# Rays per point wanted, and rounds in which misses are made up for.
SPARE, ROUNDS = 1.25, 6


def draw_seen(
    scene: Scene, variable: Variable, count: int, seed: int, *, floor: int, shown: bool = False
) -> SurfaceDraw:
    """Draw surface points, mostly where cameras and rays from the air meet surfaces. Their weights are 1.

    Args:
        scene: The scene.
        variable: The light, near whose positions cameras stand.
        count: Points.
        seed: The same seed gives the same points.
        floor: Points per visible object at least, among the area-uniform ones.
        shown: Without the backs of one-sided materials among those.

    Returns:
        The points in random order; all area-uniform where no camera can stand.
    """
    random = np.random.default_rng([seed, 11])
    parts = [
        _met(scene, int(CAMERA_SHARE * count), random, _camera_rays(scene, variable, seed)),
        _met(scene, int(AIR_SHARE * count), random, _air_rays(scene, variable, random)),
    ]
    area = draw_surface(scene, count - sum(map(len, parts)), seed, floor=floor, core=not room(scene), shown=shown)
    points = _join([*parts, area.points])
    order = random.permutation(len(points))
    return replace(area, points=points[order], weight=np.ones(len(points), np.float32))


def _camera_rays(scene: Scene, variable: Variable, seed: int):
    """(count, random) → origins and directions [K, 3] through random pixels of the scene's own and sampled cameras."""
    try:
        # Cameras that stand outside say little about where people look if the scene has cameras of its own.
        sampled = sample_cameras(scene, variable, CAMERAS, seed, outside=not scene.cameras)
    except ValueError:
        sampled = []
    cameras: list[Camera] = [*scene.cameras, *sampled]
    if not cameras:
        return None
    eye = np.array([c.position for c in cameras], np.float64)
    frame = np.array([camera_frame(c) for c in cameras])
    half = np.tan(np.radians([c.fov_y for c in cameras]) / 2)

    def rays(count: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        which = random.integers(len(cameras), size=count)
        x, y = 2 * random.random((2, count)) - 1
        right, up, forward = frame[which].transpose(1, 0, 2)
        way = forward + (half[which] * ASPECT * x)[:, None] * right + (half[which] * y)[:, None] * up
        return eye[which], way / np.linalg.norm(way, axis=1, keepdims=True)

    return rays


def _air_rays(scene: Scene, variable: Variable, random: np.random.Generator):
    """The same from random places of the free air in all directions."""
    eyes = _air(scene, variable, random)
    if not len(eyes):
        return None

    def rays(count: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        way = random.standard_normal((count, 3))
        return eyes[random.integers(len(eyes), size=count)], way / np.linalg.norm(way, axis=1, keepdims=True)

    return rays


def _air(scene: Scene, variable: Variable, random: np.random.Generator) -> np.ndarray:
    """[<= EYES, 3] random places of the air where the light may be, or of the bounds for a sun."""
    low, high = scene.bounds
    if isinstance(variable, PointLight):
        low, high = np.asarray(variable.low), np.asarray(variable.high)
    places = low + random.random((EYE_CANDIDATES * EYES, 3)) * (high - low)
    clearance = getattr(variable, "clearance", 0.0)
    return places[free_air(scene).accepts(places, clearance)][:EYES]


def _met(scene: Scene, count: int, random: np.random.Generator, rays) -> SurfacePoints:
    """Up to ``count`` first surfaces of rays, fewer where most rays escape; none without rays."""
    found, have = [_nothing()], 0
    for _ in range(ROUNDS if rays is not None else 0):
        if have >= count:
            break
        points = trace_rays(scene, *rays(int(SPARE * (count - have)) + 64, random))
        found.append(points)
        have += len(points)
    return _join(found)[np.arange(min(have, count))]


def trace_rays(scene: Scene, origin: np.ndarray, direction: np.ndarray) -> SurfacePoints:
    """Find the first surfaces that rays meet; cut-outs and clear glass are passed.

    Args:
        scene: The scene.
        origin: [K, 3] origins, metres.
        direction: [K, 3] unit directions.

    Returns:
        The points that were met, viewed from the origins.
    """
    ray = mi.Ray3f(upload(mi.Point3f, origin), upload(mi.Vector3f, direction))
    pi, ray = first_surface(scene, ray)
    hit = pi.is_valid()
    shape = dr.select(hit, shape_index(shape_lookup(scene), pi.shape), 0)
    triangle, uv = dr.select(hit, pi.prim_index, 0), dr.select(hit, pi.prim_uv, 0)
    dr.eval(shape, triangle, uv, hit)
    rows = np.flatnonzero(np.array(hit))
    view = -np.asarray(direction, np.float32)
    points = SurfacePoints(np.array(shape), np.array(triangle), np.array(uv).T, view)
    return points[rows]


def _join(parts: list[SurfacePoints]) -> SurfacePoints:
    names = ("shape", "triangle", "barycentric", "view")
    return SurfacePoints(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})


def _nothing() -> SurfacePoints:
    none = np.zeros(0, np.uint32)
    return SurfacePoints(none, none, np.zeros((0, 2), np.float32), np.zeros((0, 3), np.float32))
