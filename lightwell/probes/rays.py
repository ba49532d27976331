"""Casts the rays of the probe bake in batches: inside or outside of geometry, visibility, distances."""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi
from lightwell.probes.sh import directions
from lightwell.scenes.free_air import free_air
from lightwell.scenes.scene import Scene
from lightwell.transport.interactions import upload
from lightwell.transport.point_rejection import room

# A point that sees more than this fraction of back faces lies inside geometry (RTXGI's threshold).
BACK_FACES = 0.25
# Rays of the first test, and of a second one for results closer to the threshold than CLOSE.
FIRST, SECOND, CLOSE = 16, 64, 0.15
# In a closed scene, a point with a smaller fraction of hits lies outside.
SEEN = 0.05
# Visibility rays are shortened by this fraction of their length; those shorter than this fraction of the scene's
# extent are free.
SHORT, LEAST = 1e-4, 1e-6
LAUNCH = 1 << 21


def valid(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Test whether points lie in air: at most a quarter of the surfaces that they see are back faces.

    Args:
        scene: The scene.
        points: [N, 3] points, metres.

    Returns:
        [N] bool.
    """
    is_room = room(scene)
    wrong, seen = _votes(scene, points, FIRST)
    close = np.flatnonzero((np.abs(wrong - BACK_FACES) < CLOSE) & (wrong > 0))
    if len(close):
        wrong[close], seen[close] = _votes(scene, points[close], SECOND)
    return (wrong <= BACK_FACES) & ((seen >= SEEN) | (not is_room))


def _votes(scene: Scene, points: np.ndarray, rays: int) -> tuple[np.ndarray, np.ndarray]:
    """Fraction [N] of hits that are back faces, and fraction [N] of rays that hit."""
    sheets = mi.Bool(free_air(scene)._sheets)
    compass = upload(mi.Vector3f, directions(rays).astype(np.float32))
    out = np.zeros((2, len(points)), np.float32)
    batch = LAUNCH // rays
    for start in range(0, len(points), batch):
        part = points[start : start + batch]
        lane = dr.arange(mi.UInt32, len(part) * rays)
        origin = dr.gather(mi.Point3f, upload(mi.Point3f, part), lane // rays)
        ray = mi.Ray3f(origin, dr.gather(mi.Vector3f, compass, lane % rays))
        hit, wrong, _ = _first(scene, sheets, ray)
        values = [dr.select(wrong, mi.Float(1), 0), dr.select(hit, mi.Float(1), 0)]
        dr.eval(values)
        wrong, hit = (np.array(dr.block_sum(v, rays)) for v in values)
        out[:, start : start + len(part)] = wrong / np.maximum(hit, 1), hit / rays
    return out[0], out[1]


def _first(scene: Scene, sheets: mi.Bool, ray: mi.Ray3f) -> tuple[mi.Bool, mi.Bool, mi.Float]:
    """Whether rays hit, whether they hit the back of a solid (not of a sheet), and the distance."""
    pi = scene.mi.ray_intersect_preliminary(ray)
    si = pi.compute_surface_interaction(ray, mi.RayFlags.Minimal)
    hit = pi.is_valid()
    sheet = dr.gather(mi.Bool, sheets, dr.reinterpret_array(mi.UInt32, pi.shape), hit)
    return hit, hit & ~sheet & (dr.dot(si.n, ray.d) > 0), pi.t


def free(scene: Scene, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Test whether pairs of points see each other.

    Args:
        scene: The scene.
        a: [N, 3] first points, metres.
        b: [N, 3] second points, metres.

    Returns:
        [N] bool.
    """
    out = np.empty(len(a), bool)
    for start in range(0, len(a), LAUNCH):
        rows = slice(start, start + LAUNCH)
        out[rows] = free_rows(scene, upload(mi.Point3f, a[rows]), upload(mi.Point3f, b[rows]))
    return out


def free_rows(scene: Scene, a: mi.Point3f, b: mi.Point3f) -> np.ndarray:
    """Test whether pairs of points on the device see each other.

    Args:
        scene: The scene.
        a: N first points, metres.
        b: N second points, metres.

    Returns:
        [N] bool.
    """
    way = b - a
    length = dr.norm(way)
    ray = mi.Ray3f(a, way * dr.rcp(dr.maximum(length, 1e-30)))
    ray.maxt = length * (1 - SHORT)
    blocked = scene.mi.ray_test(ray) & (length > LEAST * scene.core_extent)
    return ~np.array(blocked, bool).reshape(-1)


def ends(scene: Scene, a: np.ndarray, d: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Find where short rays end.

    Args:
        scene: The scene.
        a: [N, 3] origins, metres.
        d: [N, 3] unit directions.
        most: Length of the rays, metres.

    Returns:
        [N] bool, whether a ray hits a surface; and [N] float32 its distance in metres, 0 without a hit.
    """
    hit, t = np.zeros(len(a), bool), np.zeros(len(a), np.float32)
    for start in range(0, len(a), LAUNCH):
        rows = slice(start, start + LAUNCH)
        ray = mi.Ray3f(upload(mi.Point3f, a[rows]), upload(mi.Vector3f, d[rows].astype(np.float32)))
        ray.maxt = mi.Float(most)
        pi = scene.mi.ray_intersect_preliminary(ray)
        hit[rows], t[rows] = np.array(pi.is_valid(), bool), np.array(dr.select(pi.is_valid(), pi.t, 0))
    return hit, t


def distances(scene: Scene, points: np.ndarray, compass: np.ndarray) -> np.ndarray:
    """Measure the distance to the first surface along the same directions from every point.

    Args:
        scene: The scene.
        points: [N, 3] origins, metres.
        compass: [D, 3] unit directions.

    Returns:
        [N, D] float32, metres; negative where the surface is seen from behind, infinite where there is none.
    """
    sheets, count = mi.Bool(free_air(scene)._sheets), len(compass)
    on_device = upload(mi.Vector3f, compass.astype(np.float32))
    out = np.empty((len(points), count), np.float32)
    batch = max(1, LAUNCH // count)
    for start in range(0, len(points), batch):
        part = points[start : start + batch]
        lane = dr.arange(mi.UInt32, len(part) * count)
        origin = dr.gather(mi.Point3f, upload(mi.Point3f, part), lane // count)
        ray = mi.Ray3f(origin, dr.gather(mi.Vector3f, on_device, lane % count))
        hit, wrong, t = _first(scene, sheets, ray)
        t = dr.select(hit, dr.select(wrong, -t, t), dr.inf)
        out[start : start + len(part)] = np.array(t).reshape(len(part), count)
    return out
