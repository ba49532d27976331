"""Rejection of surface points that no light can reach or no camera can see, because they lie inside solids or walls.

All tests trace short rays from the points; none depends on the paths of the samples.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.transport.interactions import DevicePoints, gather_interaction, upload
from lightwell.transport.path_numbers import random_streams
from lightwell.transport.queries import frames
from lightwell.transport.reachability import reached, witnesses
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.tables import shape_index, shape_lookup, tables

# Cosine-distributed rays per point (specification 2.5).
RAYS = 32
# Largest share of rays that may first meet a side of a surface that cannot border on air.
WRONG_SHARE = 0.25
# Share of rays that meet something nearer than TOUCH x the core's extent when a point is covered by another surface.
COVERED_SHARE = 0.95
# ... and when such a surface lies in its plane, with the opposite normal.
TOUCHED_SHARE = 0.25
# ... and for dim points (``covered``): more than in the corner of three walls.
DIM_COVERED_SHARE = 0.875
TOUCH = 1e-3
# A point is buried when nearly all rays are stopped by opaque surfaces no higher above its plane than this x the core's
# extent, and no more than so many metres: a floor under another floor, a wall behind panelling, the inside of a shell;
# or by any that are nearer than CLOSE x the core's extent: what small bodies enclose. Fields cannot tell it from what
# lies over it, and learned a mean of both. benchmarks/buried.py: 19 % of the surface of the courtyard and 36 % of
# modern-house are so, and 0.1 % at most of what cameras see.
BURIED_SHARE, LOW, LOW_METRES, CLOSE = 1 - 0.5 / RAYS, 0.04, 0.5, 0.01
# Where so much of all surface is buried, people look into it: a flat case, a narrow pipe.
MOST_BURIED = 0.95
# Surfaces nearer than this x the core's extent (far from the origin: x the coordinates) lie in the same plane: a few
# rounding errors of single precision.
SAME_PLANE = 3e-6
# Surfaces that a parity ray passes at most.
CROSSINGS = 32
# ... and surfaces of one plane that the touching test looks at.
COPLANAR = 4
# Rays that leave the scene from points inside its bounds, below which the scene counts as a room.
ROOM_ESCAPE = 1 / 3
# Points and rays per point of the test for a room, and points on surfaces that look for another surface.
ROOM_POINTS, ROOM_RAYS, LONE_POINTS = 128, 64, 1 << 12
# Rejection rays of one launch.
LAUNCH = 1 << 21


@dataclass
class Rejection:
    """Numbers of candidate points that were dropped, by reason; counts add up over calls."""

    candidates: int = 0
    covered: int = 0
    """Another surface touches the point."""
    buried: int = 0
    """The point sees nothing but opaque surfaces close above it."""
    back_faces: int = 0
    """More than a quarter of the hemisphere is the inside of solids or surfaces that neither reflect nor transmit."""
    inside: int = 0
    """The point lies inside closed geometry, or on a side that has no BSDF."""
    outside: int = 0
    """The point is on the outside of a room."""
    unreachable: int = 0
    """No random walk from the point finds a camera, a lamp or the sky (``lightwell.transport.reachability``)."""

    @property
    def dropped(self) -> int:
        """Points dropped for any reason."""
        return self.covered + self.buried + self.back_faces + self.inside + self.outside + self.unreachable

    def add(self, other: Rejection) -> None:
        """Add the counts of another run.

        Args:
            other: Counts to add; not changed.
        """
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + getattr(other, f.name))

    def __str__(self) -> str:
        return (
            f"{self.dropped} of {self.candidates} candidate points dropped: "
            f"{self.covered} covered, {self.buried} buried, {self.inside} inside, "
            f"{self.back_faces} facing insides, {self.outside} outside the room, {self.unreachable} unreachable"
        )


def reject(
    scene: Scene,
    points: SurfacePoints,
    *,
    is_open: bool | None = None,
    seed: int = 0,
    report: Rejection | None = None,
    walks: bool = True,
    buried: bool = True,
) -> np.ndarray:
    """Test whether points can be lit and seen from the side of their view (specification 2.5).

    Args:
        scene: Scene of the points.
        points: N points.
        is_open: Outdoor scene: keep sides that see nothing but the sky. None: measured, see ``room``.
        seed: Seed of the test rays.
        report: Receives the counts of dropped points, by reason.
        walks: Drop points from which random walks find no camera, no lamp and no sky: also those of closed rooms.
        buried: Drop points close under others. Light maps, in which each surface has texels of its own, keep them.

    Returns:
        [N] bool, True for points to keep.
    """
    is_open = not room(scene) if is_open is None else is_open
    rows = np.flatnonzero(own_side(scene, points, frames(scene, points)[2]))
    keep = np.zeros(len(points), bool)
    keep[rows] = True
    found = Rejection(candidates=len(points), inside=len(points) - len(rows))
    if not len(rows):
        if report is not None:
            report.add(found)
        return keep
    near, wrong, escaped, low = _shares(scene, points[rows], seed)
    under = (low > BURIED_SHARE) & (buried and _buries(scene))
    inside, facing = _inside(scene, points[rows])
    reasons = {
        "covered": (near >= COVERED_SHARE) | facing,
        "buried": under,
        "inside": inside,
        "back_faces": wrong > WRONG_SHARE,
        "outside": (wrong + escaped > 1 - 0.5 / RAYS) & (not is_open),
    }
    for reason, mask in reasons.items():
        setattr(found, reason, getattr(found, reason) + int((mask & keep[rows]).sum()))
        keep[rows[mask]] = False
    # Random walks are the most expensive test: they run only for points that passed the others.
    rows = np.flatnonzero(keep & walks)
    hidden = rows[~reached(scene, points[rows], _witnesses(scene), is_open, seed)]
    keep[hidden] = False
    found.unreachable = len(hidden)
    if report is not None:
        report.add(found)
    return keep


def covered(scene: Scene, points: SurfacePoints, seed: int = 0) -> np.ndarray:
    """Test whether another body touches dim points, so that nobody sees them.

    Args:
        scene: Scene of the points.
        points: N points with less light than their surroundings.
        seed: Seed of the test rays.

    Returns:
        [N] bool.
    """
    if not len(points):
        return np.zeros(0, bool)
    near, facing = _shares(scene, points, seed)[0], _inside(scene, points)[1]
    # A sheet of two faces back to back touches its own other face, but nothing is near it.
    return (near >= DIM_COVERED_SHARE) | (facing & (near >= TOUCHED_SHARE))


IS_ROOM = Derived[bool]("transport.is_room")
BURIES = Derived[bool]("transport.buries")
WITNESSES = Derived[np.ndarray]("transport.witnesses")


def room(scene: Scene) -> bool:
    """Decide whether a scene is a room rather than an outdoor place: most rays from points within it meet a surface.

    Args:
        scene: Scene to test; the answer is kept with it.

    Returns:
        True for a room; False where these rays meet the inside of a solid alone, as in a scene of one sphere.
    """
    return scene.cache.get(IS_ROOM, lambda: _escape_share(scene) < ROOM_ESCAPE and not _lone(scene))


def _buries(scene: Scene) -> bool:
    """Decide whether buried points of a scene are hidden from people."""
    return scene.cache.get(BURIES, lambda: _buried_share(scene) < MOST_BURIED)


def _buried_share(scene: Scene) -> float:
    """Measure the share of buried points among those on sides that can be lit."""
    on = _on_sides(scene)
    return float((_shares(scene, on, 0)[3] > BURIED_SHARE).mean()) if len(on) else 0.0


def _lone(scene: Scene) -> bool:
    """Test whether no surface sees another one from a side that borders on air."""
    on = _on_sides(scene)
    if not len(on):
        return False
    _, wrong, escaped, _ = _shares(scene, on, 0)
    return bool((wrong + escaped > 1 - 0.5 / RAYS).all())


def _on_sides(scene: Scene) -> SurfacePoints:
    """Draw area-uniform points, viewed along the normal from either side, and keep those on sides that can be lit."""
    t, random = tables(scene), np.random.default_rng(0)
    cdf = np.cumsum(t.area)
    triangle = np.searchsorted(cdf, random.random(LONE_POINTS) * cdf[-1], side="right").clip(0, len(cdf) - 1)
    shape = t.mesh_of[triangle]
    root, v = np.sqrt(random.random(LONE_POINTS)), random.random(LONE_POINTS)
    place, view = np.stack([root * (1 - v), root * v], axis=1), np.zeros((LONE_POINTS, 3), np.float32)
    on = SurfacePoints(shape, (triangle - t.first[shape]).astype(np.uint32), place.astype(np.float32), view)
    flat = frames(scene, on)[2]
    on = replace(on, view=flat * np.where(np.arange(LONE_POINTS) % 2, -1, 1)[:, None].astype(np.float32))
    return on[np.flatnonzero(own_side(scene, on, flat))]


def _escape_share(scene: Scene) -> float:
    """Measure the share of rays that leave the scene from points in the inner 80 % of its core."""
    lane = dr.arange(mi.UInt32, ROOM_POINTS * ROOM_RAYS)
    rng = random_streams(mi.UInt32(0), lane // ROOM_RAYS, mi.UInt32(0))
    low, high = (mi.ScalarPoint3f(list(b)) for b in scene.core)
    u = mi.Vector3f(rng.next_float32(), rng.next_float32(), rng.next_float32())
    origin = mi.Point3f(low) + (0.1 + 0.8 * u) * mi.Vector3f(high - low)
    rng = random_streams(mi.UInt32(1), lane, mi.UInt32(0))
    d = mi.warp.square_to_uniform_sphere(mi.Point2f(rng.next_float32(), rng.next_float32()))
    return 1 - float(dr.mean(dr.select(scene.mi.ray_test(mi.Ray3f(origin, d)), 1.0, 0.0))[0])


def _witnesses(scene: Scene) -> np.ndarray:
    """Return [K, 3] cameras and lamps that stand in the air: at most half of their rays meet wrong sides."""
    return scene.cache.get(WITNESSES, lambda: _checked_witnesses(scene))


def _checked_witnesses(scene: Scene) -> np.ndarray:
    places = witnesses(scene)
    if not len(places):
        return places
    lane = dr.arange(mi.UInt32, len(places) * ROOM_RAYS)
    rng = random_streams(mi.UInt32(2), lane, mi.UInt32(0))
    d = mi.warp.square_to_uniform_sphere(mi.Point2f(rng.next_float32(), rng.next_float32()))
    ray = mi.Ray3f(dr.gather(mi.Point3f, upload(mi.Point3f, places), lane // ROOM_RAYS), d)
    pi = scene.mi.ray_intersect_preliminary(ray)
    right = ~pi.is_valid() | right_side(scene, air_sides(scene), pi, ray)
    return places[np.array(right, bool).reshape(-1, ROOM_RAYS).mean(axis=1) >= 0.5]


def air_sides(scene: Scene) -> tuple[mi.Bool, mi.Bool]:
    """List the sides of meshes that can border on air.

    Args:
        scene: Scene with M meshes.

    Returns:
        [M] front and [M] back, on the device.
    """
    t = tables(scene)
    front = (t.front & (t.air != -1)) | t.transmissive
    back = (t.back & (t.air != 1)) | t.transmissive
    return mi.Bool(front), mi.Bool(back)


def _shares(scene: Scene, points: SurfacePoints, seed: int) -> tuple[np.ndarray, ...]:
    """Shares of the cosine rays that hit within touch, hit a wrong side, leave the scene, and are stopped by something
    opaque that is no higher than LOW or nearer than CLOSE: each [N]."""
    device, sides = DevicePoints(points), air_sides(scene)
    opaque, solid = _opaque_sides(scene)
    touch = dr.opaque(mi.Float, TOUCH * scene.core_extent)
    low = dr.opaque(mi.Float, min(LOW * scene.core_extent, LOW_METRES))
    close = dr.opaque(mi.Float, CLOSE * scene.core_extent)
    found = np.zeros((4, len(points)), np.float32)
    batch = LAUNCH // RAYS
    for start in range(0, len(points), batch):
        count = min(batch, len(points) - start)
        lane = dr.arange(mi.UInt32, count * RAYS)
        row = dr.opaque(mi.UInt32, start) + lane // RAYS
        si = gather_interaction(scene, device, row)
        rng = random_streams(dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), row, lane % RAYS)
        d = mi.warp.square_to_cosine_hemisphere(mi.Point2f(rng.next_float32(), rng.next_float32()))
        ray = si.spawn_ray(mi.Frame3f(_viewed(si, device, row)).to_world(d))
        pi = scene.mi.ray_intersect_preliminary(ray)
        hit = pi.is_valid()
        wrong = hit & ~right_side(scene, sides, pi, ray)
        under = hit & (
            ((pi.t * d.z < low) & right_side(scene, opaque, pi, ray))
            | ((pi.t < close) & right_side(scene, solid, pi, ray))
        )
        masks = (hit & (pi.t < touch), wrong, ~hit, under)
        values = [dr.select(m, mi.Float(1), 0) for m in masks]
        dr.eval(values)
        found[:, start : start + count] = [np.array(dr.block_sum(v, RAYS)) / RAYS for v in values]
    return tuple(found)


def _opaque_sides(scene: Scene) -> tuple[tuple[mi.Bool, mi.Bool], tuple[mi.Bool, mi.Bool]]:
    """[M] front and [M] back of meshes that nobody looks through from the other side, and of all that is no glass."""
    t = tables(scene)
    opaque = ~(t.transmissive | t.looked_through)
    return (mi.Bool(opaque & ~t.culled), mi.Bool(opaque)), (mi.Bool(opaque), mi.Bool(opaque))


def _viewed(si, device: DevicePoints, row) -> mi.Vector3f:
    """Return the geometric normal on the viewer's side."""
    view = dr.gather(mi.Vector3f, device.view, row)
    return mi.Vector3f(si.n) * dr.sign(dr.dot(si.n, view))


def right_side(
    scene: Scene, sides: tuple[mi.Bool, mi.Bool], pi: mi.PreliminaryIntersection3f, ray: mi.Ray3f
) -> mi.Bool:
    """Test whether rays met a side that can border on air.

    Args:
        scene: Scene that was traced.
        sides: Result of ``air_sides``.
        pi: Intersections of the rays.
        ray: The rays.

    Returns:
        One value per ray; undefined for rays that met nothing.
    """
    si = pi.compute_surface_interaction(ray, mi.RayFlags.Minimal)
    mesh = shape_index(shape_lookup(scene), pi.shape)
    front = dr.gather(mi.Bool, sides[0], mesh, pi.is_valid())
    back = dr.gather(mi.Bool, sides[1], mesh, pi.is_valid())
    return dr.select(dr.dot(si.n, ray.d) < 0, front, back)


def own_side(scene: Scene, points: SurfacePoints, normals: np.ndarray) -> np.ndarray:
    """Test whether the viewed side of points can be lit at all: it has a BSDF and is not the inside of a closed mesh.

    Args:
        scene: Scene of the points.
        points: N points.
        normals: [N, 3] geometric normals on the front of the triangles.

    Returns:
        [N] bool.
    """
    t = tables(scene)
    front = (normals * points.view).sum(-1) > 0
    lit_front, lit_back = t.front & (t.air != -1), t.back & (t.air != 1)
    return np.where(front, lit_front[points.shape], lit_back[points.shape])


def _inside(scene: Scene, points: SurfacePoints) -> tuple[np.ndarray, np.ndarray]:
    """Test [N] whether points lie in a solid (rays along +n and -n leave it), and whether another surface touches."""
    device = DevicePoints(points)
    row = dr.arange(mi.UInt32, len(points))
    si = gather_interaction(scene, device, row)
    n = _viewed(si, device, row)
    lookup, volume = shape_lookup(scene), mi.Int32(tables(scene).volume.astype(np.int32))
    origin = si.spawn_ray(n).o
    inside = (_leaving(scene.mi, lookup, volume, origin, n) > 0) & (_leaving(scene.mi, lookup, volume, origin, -n) > 0)
    shape = dr.gather(mi.UInt32, device.shape, row)
    triangle = dr.gather(mi.UInt32, device.triangle, row)
    least, most = (dr.opaque(mi.Float, SAME_PLANE * size) for size in (scene.core_extent, scene.extent))
    reach = dr.minimum(dr.maximum(least, SAME_PLANE * dr.max(dr.abs(si.p))), most)
    facing = _face_to_face(scene.mi, lookup, si.p, n, shape, triangle, reach)
    dr.eval(inside, facing)
    return np.array(inside, bool).reshape(-1), np.array(facing, bool).reshape(-1)


@dr.syntax
def _face_to_face(geometry, lookup, p, n, shape, triangle, reach):
    """Test whether a triangle with the opposite normal lies in the same plane: two bodies that touch."""
    found = dr.full(mi.Bool, False, dr.width(p))
    ray = mi.Ray3f(p + reach * n, -n)
    ray.maxt = 2 * reach
    crossed = mi.UInt32(0)
    active = dr.full(mi.Bool, True, dr.width(p))
    while active:
        pi = geometry.ray_intersect_preliminary(ray, active=active)
        active &= pi.is_valid()
        si = pi.compute_surface_interaction(ray, mi.RayFlags.Minimal, active)
        other = (shape_index(lookup, pi.shape) != shape) | (pi.prim_index != triangle)
        found |= active & other & (dr.dot(si.n, n) < 0)
        ray.maxt = ray.maxt - pi.t - 0.01 * reach
        ray.o = ray(pi.t + 0.01 * reach)
        crossed += 1
        active &= (crossed < COPLANAR) & (ray.maxt > 0)
    return found


@dr.syntax
def _leaving(geometry, lookup, volume, origin, d):
    """Count the solids that a ray leaves minus those that it enters."""
    count = mi.Int32(0)
    ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(d))
    crossed = mi.UInt32(0)
    active = dr.full(mi.Bool, True, dr.width(origin))
    while active:
        pi = geometry.ray_intersect_preliminary(ray, active=active)
        active &= pi.is_valid()
        si = pi.compute_surface_interaction(ray, mi.RayFlags.Minimal, active)
        out = dr.select(dr.dot(si.n, ray.d) > 0, mi.Int32(1), mi.Int32(-1))
        sign = dr.gather(mi.Int32, volume, shape_index(lookup, pi.shape), active)
        count += dr.select(active, out * sign, 0)
        ray = si.spawn_ray(ray.d)
        crossed += 1
        active &= crossed < CROSSINGS
    return count
