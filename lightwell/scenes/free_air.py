"""Points of a scene that are free air: not inside a solid, not outside the building, not too near a surface.

Two tests are made. The distance to the nearest surface: a kd-tree over points on the surfaces proposes triangles, to
which the distance is exact. Visibility: rays in all directions count front faces, back faces and misses; from inside a
solid, or from behind the walls of a room, most hits are back faces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from lightwell.backend import dr, mi, upload_floats

from .scene import Mesh, Scene
from .scene_cache import Derived
from .welding import equal_rows

# A point is inside something, or behind the walls of a room, when more of its first hits than this are back faces.
BACK_FACES = 0.25

# A point is outside the scene when fewer of its rays than this meet a surface.
SEEN = 0.05

# ... unless this share of the points that are not inside a solid is outside: then the scene is open.
OPEN_SCENE = 0.8

# Rays per point, points on the surfaces, triangles that also get their centroid, triangles measured per point.
RAYS, CLOUD, CENTROIDS, NEAREST = 64, 100_000, 400_000, 12

# Steps of the R2 low-discrepancy sequence (Roberts 2018): 1/p and 1/p² with p³ = p + 1.
R2 = (0.7548776662466927, 0.5698402909980532)

# A two-sided closed mesh that spans this part of the scene along every axis is a room, not a solid.
ENCLOSURE = 0.8


@dataclass(frozen=True)
class Views:
    """Results of rays in all directions from N points."""

    back: np.ndarray
    """[N] part of the hits that are back faces; 0 where nothing is hit."""
    hit: np.ndarray
    """[N] part of the rays that meet anything."""


class FreeAir:
    """Tests of points in one scene; see the module. Build it with ``free_air``."""

    def __init__(self, scene: Scene) -> None:
        """Build the kd-tree and the tables of a scene.

        Args:
            scene: Scene to test points in.
        """
        self._scene = scene.mi
        # [T, 3, 3] corners of all triangles.
        self._corners = np.concatenate([m.positions[m.indices] for m in scene.meshes]).astype(np.float64)
        # [P] triangle of each surface point in the kd-tree.
        points, self._owner = _surface_points(self._corners)
        self._tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
        # [ids] bool by Dr.Jit's shape number: back faces of these are not counted.
        self._sheets = _by_shape_number(scene, [_is_sheet(scene, m) for m in scene.meshes])

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Measure the distance to the nearest surface.

        Args:
            points: [N, 3] positions, metres.

        Returns:
            [N] metres.
        """
        points = np.asarray(points, dtype=np.float64)
        count = min(NEAREST, len(self._owner))
        _, found = self._tree.query(points, k=count)
        corners = self._corners[self._owner[found.reshape(len(points), count)]]
        return triangle_distance(points[:, None], corners).min(axis=1)

    def views(self, points: np.ndarray, rays: int = RAYS) -> Views:
        """Trace rays in all directions from points.

        Args:
            points: [N, 3] positions, metres.
            rays: Directions per point, the same for all points.

        Returns:
            Shares of hits and of back faces.
        """
        directions = even_directions(rays)
        hit, back, _, _ = self.trace(np.repeat(points, rays, axis=0), np.tile(directions, (len(points), 1)))
        hits = hit.reshape(-1, rays).sum(axis=1)
        return Views(back.reshape(-1, rays).sum(axis=1) / np.maximum(hits, 1), hits / rays)

    def trace(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, ...]:
        """Find the first hits of rays.

        Args:
            origins: [K, 3] positions, metres.
            directions: [K, 3] unit directions.

        Returns:
            [K] each: whether a surface was hit, whether on a solid's back face, distance (inf: none) and shape number.
        """
        ray = mi.Ray3f(mi.Point3f(_columns(origins)), _columns(directions))
        si = self._scene.ray_intersect(ray)
        valid = si.is_valid()
        shape = dr.reinterpret_array(mi.UInt32, si.shape)
        sheet = dr.gather(mi.Bool, mi.Bool(self._sheets), shape, valid)
        back = valid & ~sheet & (dr.dot(si.n, ray.d) > 0)
        distance = dr.select(valid, si.t, dr.inf)
        dr.eval(valid, back, distance, shape)
        return tuple(np.array(x) for x in (valid, back, distance, shape))

    def occluded(self, origins: np.ndarray, targets: np.ndarray, slack: float) -> np.ndarray:
        """Test whether a surface lies between two points.

        Args:
            origins: [K, 3] positions, metres.
            targets: [K, 3] positions, metres.
            slack: Length before the target that is ignored, metres.

        Returns:
            [K] bool.
        """
        way = targets - origins
        length = np.linalg.norm(way, axis=1)
        ray = mi.Ray3f(mi.Point3f(_columns(origins)), _columns(way / length[:, None]))
        ray.maxt = upload_floats(np.maximum(length - slack, 0))
        return np.array(self._scene.ray_test(ray))

    def accepts(self, points: np.ndarray, clearance: float, rays: int = RAYS) -> np.ndarray:
        """Test whether points are free air and keep a distance from every surface.

        Args:
            points: [N, 3] positions, metres.
            clearance: Least distance, metres.
            rays: Rays per point.

        Returns:
            [N] bool.
        """
        points = np.asarray(points)
        free = self.distance(points) >= clearance
        if not free.any():
            return free
        views = self.views(points[free], rays)
        outside_solids = views.back <= BACK_FACES
        sees = views.hit >= SEEN
        if outside_solids.any() and np.mean(~sees[outside_solids]) > OPEN_SCENE:
            sees[:] = True
        free[free] = outside_solids & sees
        return free


FREE_AIR = Derived[FreeAir]("scenes.free_air")


def free_air(scene: Scene) -> FreeAir:
    """Return the ``FreeAir`` of a scene, made on first use and kept with it.

    Args:
        scene: Scene to test points in.

    Returns:
        Its tests.
    """
    return scene.cache.get(FREE_AIR, lambda: FreeAir(scene))


def even_directions(count: int) -> np.ndarray:
    """Place unit directions on a Fibonacci spiral, tilted so that none is parallel to an axis.

    Args:
        count: Number of directions, ≥ 1.

    Returns:
        [count, 3] unit vectors.
    """
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    c, s = np.cos(0.4), np.sin(0.4)
    tilt = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1) @ tilt.T


def triangle_distance(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Measure distances between points and triangles.

    Args:
        points: [..., 3] positions.
        corners: [..., 3, 3] corners of the triangles.

    Returns:
        [...] distances.
    """
    a, b, c = (corners[..., k, :] for k in range(3))
    edges = np.stack([_segment_distance(points, p, q) for p, q in ((a, b), (b, c), (c, a))]).min(axis=0)
    normal = np.cross(b - a, c - a)
    area = np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-30)
    normal = normal / area
    # The projection of the point lies inside when it is on the inner side of all three edges.
    sides = [_dot(np.cross(q - p, points - p), normal) for p, q in ((a, b), (b, c), (c, a))]
    inside = np.min(sides, axis=0) >= 0
    return np.where(inside, np.abs(_dot(points - a, normal)), edges)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...k,...k->...", a, b)


def _segment_distance(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    along = b - a
    t = np.clip(_dot(p - a, along) / np.maximum(_dot(along, along), 1e-30), 0, 1)
    return np.linalg.norm(p - a - t[..., None] * along, axis=-1)


def _columns(vectors: np.ndarray) -> mi.Vector3f:
    """Upload [K, 3] vectors, each column by itself, so that the kernels that read them are the same for every K."""
    return mi.Vector3f(*map(upload_floats, np.asarray(vectors).T))


def _surface_points(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place points [P, 3] on triangles [T, 3, 3]: uniform by area, and each centroid; also returns triangles [P]."""
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    number = np.arange(CLOUD) + 0.5
    owner = np.searchsorted(np.cumsum(areas), number / CLOUD * areas.sum()).clip(0, len(areas) - 1)
    u, v = (number[:, None] * step % 1 for step in R2)
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    a, b, c = (corners[owner, k] for k in range(3))
    chosen = np.arange(len(corners))
    if len(chosen) > CENTROIDS:
        chosen = np.random.default_rng(0).choice(len(corners), CENTROIDS, replace=False)
    points = np.concatenate([a + u * (b - a) + v * (c - a), corners[chosen].mean(axis=1)])
    return points, np.concatenate([owner, chosen])


def _by_shape_number(scene: Scene, values: list[bool]) -> np.ndarray:
    """Index ``values`` of the meshes by Dr.Jit's shape number; returns [ids] bool."""
    numbers = np.array(dr.reinterpret_array(mi.UInt32, scene.mi.shapes_dr()))
    table = np.zeros(numbers.max() + 1, dtype=bool)
    table[numbers[: len(values)]] = values
    return table


def _is_sheet(scene: Scene, mesh: Mesh) -> bool:
    """Test whether back faces of ``mesh`` may be visible from the air: two-sided, and open or as large as the scene."""
    if not scene.materials[mesh.material].double_sided:
        return False
    size = mesh.positions.max(axis=0) - mesh.positions.min(axis=0)
    large = np.all(size >= ENCLOSURE * (scene.bounds[1] - scene.bounds[0]))
    return bool(large) or not is_closed(mesh)


def is_closed(mesh: Mesh) -> bool:
    """Test whether every edge of a mesh is used equally often in both directions, after welding vertices by position.

    Args:
        mesh: Mesh to test.

    Returns:
        True for a closed mesh.
    """
    same = equal_rows(np.round(mesh.positions, 5))[1]
    triangles = same[mesh.indices].astype(np.int64)
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    edges, sign = np.minimum(start, end) * (same.max() + 1) + np.maximum(start, end), np.sign(end - start)
    _, groups = np.unique(edges, return_inverse=True)
    return not np.bincount(groups, weights=sign).any()
