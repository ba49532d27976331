"""Rays of the probe bake: inside or outside, free segments, distances. All batched, none of them path traced."""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi
from lightwell.probes.sh import directions
from lightwell.scenes.free_air import free_air
from lightwell.scenes.scene import Scene
from lightwell.transport.air import room
from lightwell.transport.interactions import upload

# More than this share of back faces: the point lies inside geometry (RTXGI's threshold).
BACK_FACES = 0.25
# Rays of the first vote and, where it is close, of the second; what counts as close.
FIRST, SECOND, CLOSE = 16, 64, 0.15
# Fewer hits than this in a room: the point lies outside of everything.
SEEN = 0.05
# Segments end this share of their length before the end, and no nearer than this share of the extent.
SHORT, LEAST = 1e-4, 1e-6
LAUNCH = 1 << 21


def valid(scene: Scene, points: np.ndarray) -> np.ndarray:
    """[N] bool: whether points [N, 3] lie in air: at most a quarter of what they see are back faces."""
    is_room = room(scene)
    wrong, seen = _votes(scene, points, FIRST)
    close = np.flatnonzero((np.abs(wrong - BACK_FACES) < CLOSE) & (wrong > 0))
    if len(close):
        wrong[close], seen[close] = _votes(scene, points[close], SECOND)
    return (wrong <= BACK_FACES) & ((seen >= SEEN) | (not is_room))


def _votes(scene: Scene, points: np.ndarray, rays: int) -> tuple[np.ndarray, np.ndarray]:
    """Share of hits that are back faces and share of rays that hit: [N] each."""
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
    """Whether rays hit, whether the back of something that has an inside, and the distance."""
    pi = scene.mi.ray_intersect_preliminary(ray)
    si = pi.compute_surface_interaction(ray, mi.RayFlags.Minimal)
    hit = pi.is_valid()
    sheet = dr.gather(mi.Bool, sheets, dr.reinterpret_array(mi.UInt32, pi.shape), hit)
    return hit, hit & ~sheet & (dr.dot(si.n, ray.d) > 0), pi.t


def free(scene: Scene, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[N] bool: whether nothing stands between points a and b, [N, 3] each."""
    out = np.empty(len(a), bool)
    for start in range(0, len(a), LAUNCH):
        rows = slice(start, start + LAUNCH)
        out[rows] = free_rows(scene, upload(mi.Point3f, a[rows]), upload(mi.Point3f, b[rows]))
    return out


def free_rows(scene: Scene, a: mi.Point3f, b: mi.Point3f) -> np.ndarray:
    """The same for points that lie on the device."""
    way = b - a
    length = dr.norm(way)
    ray = mi.Ray3f(a, way * dr.rcp(dr.maximum(length, 1e-30)))
    ray.maxt = length * (1 - SHORT)
    blocked = scene.mi.ray_test(ray) & (length > LEAST * scene.extent)
    return ~np.array(blocked, bool).reshape(-1)


def ends(scene: Scene, a: np.ndarray, d: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Whether rays from a [N, 3] along d [N, 3] hit within ``most`` metres, and the distance: [N] each."""
    hit, t = np.zeros(len(a), bool), np.zeros(len(a), np.float32)
    for start in range(0, len(a), LAUNCH):
        rows = slice(start, start + LAUNCH)
        ray = mi.Ray3f(upload(mi.Point3f, a[rows]), upload(mi.Vector3f, d[rows].astype(np.float32)))
        ray.maxt = mi.Float(most)
        pi = scene.mi.ray_intersect_preliminary(ray)
        hit[rows], t[rows] = np.array(pi.is_valid(), bool), np.array(dr.select(pi.is_valid(), pi.t, 0))
    return hit, t


def distances(scene: Scene, points: np.ndarray, compass: np.ndarray) -> np.ndarray:
    """[N, D] metres to the first surface along directions [D, 3]; negative where it is a back face, inf: none."""
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
