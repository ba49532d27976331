"""Sides that light can reach: random walks from points towards places that are known to lie in the air.

Walls of real models have two faces, cushions are hollow and nearly closed: the orientation of triangles alone does not
identify their hidden sides. A walk bounces diffusely and at every vertex tests the visibility of a place that is known
to lie in the air (a camera, a lamp, the open sky), called a witness.
"""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.transport.interactions import DevicePoints, gather_interaction, upload
from lightwell.transport.path_numbers import random_streams
from lightwell.transport.queries import frames
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.tables import shape_index, shape_lookup, tables

# Walks per point before it counts as unreachable, and bounces per walk. Most visible points need one or two bounces.
WALKS, BOUNCES = 16, 6
# Shadow rays end this share of their length before the witness.
SHORT = 1e-3
# A witness of an emissive surface stands this far off it, in extents.
OFF_SURFACE = 1e-3


def witnesses(scene: Scene) -> np.ndarray:
    """List places in the air: cameras, punctual lights, and points in front of emissive surfaces.

    Args:
        scene: Scene to read.

    Returns:
        [K, 3] float32 positions, metres.
    """
    places = [np.asarray(c.position, np.float32) for c in scene.cameras]
    places += [np.asarray(l.position, np.float32) for l in scene.lights if l.kind != "directional"]
    for index, mesh in enumerate(scene.meshes):
        if max(mesh.emission) > 0:
            largest = np.argmax(mesh.triangle_areas)
            middle = SurfacePoints(
                np.uint32([index]),
                np.uint32([largest]),
                np.full((1, 2), 1 / 3, np.float32),
                np.zeros((1, 3), np.float32),
            )
            position, _, flat = frames(scene, middle)
            places.append((position + OFF_SURFACE * scene.core_extent * flat)[0])
    return np.array(places, np.float32).reshape(-1, 3)


def reached(scene: Scene, points: SurfacePoints, places: np.ndarray, is_open: bool, seed: int) -> np.ndarray:
    """Test whether some walk from the viewed side of points finds one of the places or, outdoors, the upper sky.

    Args:
        scene: Scene of the points.
        points: N points.
        places: [K, 3] places in the air, metres.
        is_open: Outdoor scene: the upper hemisphere of the sky counts as a place.
        seed: Seed of the walks.

    Returns:
        [N] bool; all True when there is no place to find.
    """
    if not len(points) or (not len(places) and not is_open):
        return np.ones(len(points), bool)
    device, row = DevicePoints(points), dr.arange(mi.UInt32, len(points))
    si = gather_interaction(scene, device, row)
    n = mi.Vector3f(si.n) * dr.sign(dr.dot(si.n, dr.gather(mi.Vector3f, device.view, row)))
    known = upload(mi.Point3f, places if len(places) else np.full((1, 3), np.nan))
    glass = mi.Bool(tables(scene).transmissive)
    rng = random_streams(dr.opaque(mi.UInt32, (seed + 1) & 0xFFFFFFFF), row, mi.UInt32(0))
    sky = dr.opaque(mi.Bool, is_open)
    number = dr.opaque(mi.UInt32, max(len(places), 1))
    found = _walk(scene.mi, shape_lookup(scene), glass, known, number, sky, si.spawn_ray(n).o, n, rng)
    dr.eval(found)
    return np.array(found, bool).reshape(-1)


@dr.syntax
def _walk(geometry, lookup, glass, known, number, sky, start, start_n, rng):
    """Walk from each point, one lane per point, until a place is found or the walks are used up."""
    o, n = mi.Point3f(start), mi.Vector3f(start_n)  # Current vertex and normal on the walker's side
    found = dr.full(mi.Bool, False, dr.width(start))
    walks, bounces = mi.UInt32(0), mi.UInt32(0)
    active = dr.full(mi.Bool, True, dr.width(start))
    while active:
        # Look for a witness.
        place = dr.minimum(mi.UInt32(rng.next_float32() * number), number - 1)
        offset = dr.gather(mi.Point3f, known, place, active) - o
        distance = dr.norm(offset)
        look = mi.Ray3f(o, offset / distance)
        look.maxt = distance * (1 - SHORT)
        before = active & (dr.dot(look.d, n) > 0)
        found |= before & ~geometry.ray_test(look, before)
        active &= ~found
        # Go on in a random direction; the upper sky is a witness outdoors.
        u = mi.Point2f(rng.next_float32(), rng.next_float32())
        ray = mi.Ray3f(o, mi.Frame3f(n).to_world(mi.warp.square_to_cosine_hemisphere(u)))
        pi = geometry.ray_intersect_preliminary(ray, active=active)
        si = pi.compute_surface_interaction(ray, mi.RayFlags.Minimal, active)
        escaped = active & ~pi.is_valid()
        found |= escaped & sky & (ray.d.y > 0)
        # Half of the walks that meet glass pass through it.
        clear = dr.gather(mi.Bool, glass, shape_index(lookup, pi.shape), active & pi.is_valid())
        through = clear & (rng.next_float32() < 0.5)
        n_next = mi.Vector3f(si.n) * dr.select((dr.dot(si.n, ray.d) < 0) ^ through, 1, -1)
        # Start a new walk where one has escaped or is too long.
        bounces += 1
        lost = escaped | (bounces >= BOUNCES)
        walks += dr.select(lost, 1, 0)
        bounces = dr.select(lost, 0, bounces)
        o = dr.select(lost, start, si.spawn_ray(n_next).o)
        n = dr.select(lost, start_n, n_next)
        active &= ~found & (walks < WALKS)
    return found
