"""Which sides of triangles a light map stores: those that can be seen and receive light.

K sides, M meshes, T triangles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from lightwell.backend import dr, mi
from lightwell.fields.base import is_matte
from lightwell.fields.lightmap.density import seen_density
from lightwell.scenes.default_light import under_sky, with_lamp
from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.placing import initial_light, sample_cameras
from lightwell.scenes.scene import Mesh, Scene
from lightwell.scenes.triangle_groups import triangle_groups
from lightwell.scenes.variables import declare
from lightwell.scenes.welding import equal_rows
from lightwell.transport.interactions import upload
from lightwell.transport.irradiance import irradiance
from lightwell.transport.point_rejection import _escape_share, reject
from lightwell.transport.queries import frames
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.tables import shape_index, shape_lookup, tables
from lightwell.transport.visible import side_points, visible_sides

# A scene is open to daylight if more than this share of rays leaves it.
OPEN = 0.005
# A side counts as lit when its brightest point has this share of the mean light; paths per point of the search.
DARK, DARK_PATHS = 1e-4, (8, 64, 512)
# Paths of one round of this search at most, whatever the number of points: sides inside solids find none, ever.
ROUND_PATHS = 1 << 24
# Space of this share of the core's extent before a side may be a room; where the ray that tests it begins.
ROOMY, LIFTED = 0.02, 1e-4
# Least cosine between the normals of triangles of a flat part.
FLAT = 0.9
# Somebody may stand where nothing is nearer than this, metres; at least and at most these shares of the core's extent,
# for scenes in other units.
STANDING, LEAST_STANDING, MOST_STANDING = 0.3, 0.01, 0.05
# Places of each kind from which sides are looked for.
PLACES = 4096
# How far around a flat scene it is looked at from, in extents of its core.
FLAT_AROUND = 0.5
# Points of this search over the whole scene; each side gets two at least.
LOOKS = 1 << 16
# The same for sides that were not visible so far.
VISIBILITY_RAYS = 1 << 16
# Rays from free air that search for sides: in all directions, and towards each side that was not found yet.
VIEW_RAYS, AIMED = 1 << 20, 16
# Sides of more than this share of all area are faint if less than this share of so many points on them is visible.
LARGE, LITTLE, RAYS_PER_SIDE = 1e-3, 0.1, 64


@dataclass(frozen=True)
class TriangleSides:
    """The sides of triangles that a light map stores, [2, T] bool each, and the density of its texels."""

    lit: np.ndarray
    """Stored: visible and lit."""
    dark: np.ndarray
    """Visible, but black in the light map: no light reaches them, or they are clear glass."""
    faint: np.ndarray
    """Stored, but large and mostly hidden behind other geometry."""
    density: np.ndarray
    """[M] texels per metre of each mesh, relative to the others."""


def lit_scene(scene: Scene) -> tuple[Scene, str]:
    """Add a light to a scene that has none: a sky where daylight can enter, else a lamp.

    Args:
        scene: The scene.

    Returns:
        The lit scene, and one line about the light; empty where the scene is unchanged.
    """
    if scene.has_static_light:
        return scene, ""
    if _escape_share(scene) > OPEN:
        return under_sky(scene), "the scene has no light of its own: it stands under a white sky"
    variable = declare((), scene)
    place = initial_light(scene, variable, (scene.cameras or sample_cameras(scene, variable, 1, 0))[0])
    where = ", ".join(f"{c:.2f}" for c in place)
    return with_lamp(scene, place), f"the scene has no light of its own: a lamp hangs at ({where})"


def lit_sides(scene: Scene, seed: int, seconds: float | None = None) -> TriangleSides:
    """Find the sides of triangles that can be seen and receive light, and those that can be seen and are dark.

    Args:
        scene: T triangles.
        seed: Seed of the sampler.
        seconds: Time for the search for light on dark sides, about; None: fixed numbers of paths.

    Returns:
        The sides.
    """
    seen, groups = sides_in_sight(scene, seed), triangle_groups(scene)
    glass = tables(scene).clear[tables(scene).mesh_of]
    lit, least = _bright(scene, seen & ~glass & groups.tested, DARK_PATHS, 0.0, seed, seconds)
    # Sides that nobody sees and no light reaches are dark too: the inside of a closed room must not read its outside.
    hidden = ~seen & ~culled_sides(scene) & ~glass & groups.tested & (tables(scene).area > 0)
    hidden = _before_rooms(scene, hidden)
    reached, _ = _bright(scene, hidden, DARK_PATHS[:2], least, seed + len(DARK_PATHS), seconds)
    lit = flat_neighbours(scene, groups.spread(lit)) & seen & ~glass
    dark = (seen & ~lit) | groups.spread(hidden & ~flat_neighbours(scene, groups.spread(reached)))
    return TriangleSides(lit, dark, faint_sides(scene, lit, seed), seen_density(scene, lit, seed))


def _before_rooms(scene: Scene, sides: np.ndarray) -> np.ndarray:
    """Those of the sides [2, T] of which the middle faces space as wide as a room."""
    side, triangle = np.nonzero(sides)
    found = np.zeros_like(sides)
    middle = np.full((len(side), 2), 1 / 3, np.float32)
    found[side, triangle] = before_rooms(scene, side_points(scene, triangle, side, middle))
    return found


def before_rooms(scene: Scene, points: SurfacePoints) -> np.ndarray:
    """Test whether points face space as wide as a room; the insides of walls and boxes do not.

    Args:
        scene: The scene.
        points: N surface points.

    Returns:
        [N] bool.
    """
    if not len(points):
        return np.zeros(0, bool)
    position, _, flat = frames(scene, points)
    outwards = np.where((flat * points.view).sum(axis=1, keepdims=True) < 0, -flat, flat)
    start = position + LIFTED * scene.core_extent * outwards
    ray = mi.Ray3f(upload(mi.Point3f, start), upload(mi.Vector3f, outwards))
    ray.maxt = mi.Float(ROOMY * scene.core_extent)
    return ~np.array(scene.mi.ray_test(ray), bool)


def _bright(
    scene: Scene, sides: np.ndarray, rounds: Sequence[int], least: float, seed: int, seconds: float | None
) -> tuple[np.ndarray, float]:
    """Find those of the sides [2, T] that receive light, and the light above which a side counts as lit."""
    rate = np.inf  # Paths per second of the round before; the first one also compiles
    side, triangle = np.nonzero(sides)
    area = tables(scene).area[triangle]
    brightest, floor = np.zeros(len(side)), least
    for k, paths in enumerate(rounds):
        # A few paths find the light of most sides; the others are traced again with more paths.
        rows = np.flatnonzero(brightest <= floor)
        if not len(rows):
            break
        points, row = spread(scene, side[rows], triangle[rows], LOOKS if k == 0 else len(rows), seed + k)
        arrays = {"side": side[rows].astype(np.uint8), "triangle": triangle[rows].astype(np.uint32)}
        recipe = Recipe("sides", {"count": LOOKS if k == 0 else len(rows), "seed": seed + k}, arrays)
        most = ROUND_PATHS if seconds is None else min(ROUND_PATHS, rate * seconds / (len(rounds) - 1))
        paths = max(min(paths, int(most / len(points)) // 2 * 2), DARK_PATHS[0])
        start = perf_counter()
        found = irradiance(scene, points, paths, seed + k, recipe).mean.mean(axis=1)
        rate = len(points) * paths / max(perf_counter() - start, 1e-6)
        np.maximum.at(brightest, rows[row], np.nan_to_num(found))
        floor = least or DARK * np.average(brightest, weights=area)
    lit = np.zeros_like(sides)
    lit[side, triangle] = brightest > floor
    return lit, floor


def flat_neighbours(scene: Scene, lit: np.ndarray) -> np.ndarray:
    """Add the sides that continue a lit one with nearly the same direction: few paths miss the light of dim places.

    Args:
        scene: T triangles.
        lit: [2, T] bool.

    Returns:
        [2, T] bool: all sides of the flat parts of meshes of which one is lit; meshes with groups of triangles, which
        are flat themselves, stay as they are.
    """
    found, start, alone = lit.copy(), 0, triangle_groups(scene).alone
    for mesh in scene.meshes:
        count = len(mesh.indices)
        if not alone[start : start + count].all():
            start += count
            continue
        part = flat_parts(mesh)
        for side in found[:, start : start + count]:
            side |= np.isin(part, part[side])
        start += count
    return found


def flat_parts(mesh: Mesh) -> np.ndarray:
    """Number the parts of a mesh that bend by less than ``FLAT`` from triangle to triangle.

    Args:
        mesh: Mesh of K triangles.

    Returns:
        [K] part of each triangle.
    """
    corners = equal_rows(mesh.positions)[1][mesh.indices.astype(np.int64)]
    a, b, c = (mesh.positions[mesh.indices[:, k]].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(len(corners)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    p, q = owner[order[:-1]], owner[order[1:]]
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1) & ((normal[p] * normal[q]).sum(axis=1) > FLAT)
    links = coo_matrix((np.ones(int(same.sum()), np.int8), (p[same], q[same])), (len(corners), len(corners)))
    return connected_components(links, directed=False)[1]


def seen_sides(scene: Scene, seed: int) -> TriangleSides:
    """Find all sides that can be seen; those of clear glass are not stored.

    Args:
        scene: T triangles.
        seed: Seed of the sampler.

    Returns:
        The sides.
    """
    seen = sides_in_sight(scene, seed)
    glass = tables(scene).clear[tables(scene).mesh_of]
    return TriangleSides(seen & ~glass, seen & glass, np.zeros_like(seen), seen_density(scene, seen & ~glass, seed))


def faint_sides(scene: Scene, lit: np.ndarray, seed: int) -> np.ndarray:
    """Find the large sides of which only a small part is visible.

    Args:
        scene: T triangles.
        lit: [2, T] bool sides that are stored.
        seed: Seed of the sampler.

    Returns:
        [2, T] bool.
    """
    area = tables(scene).area
    side, triangle = np.nonzero(lit & (area > LARGE * (lit * area).sum()))
    faint = np.zeros_like(lit)
    if len(side):
        row = np.repeat(np.arange(len(side)), RAYS_PER_SIDE)
        u, v = np.random.default_rng([seed, 0xFA17]).random((2, len(row)))
        place = np.stack([np.sqrt(u) * (1 - v), np.sqrt(u) * v], axis=1).astype(np.float32)
        seen = reject(scene, side_points(scene, triangle[row], side[row], place), seed=seed, buried=False)
        few = np.bincount(row, weights=seen, minlength=len(side)) < LITTLE * RAYS_PER_SIDE
        faint[side[few], triangle[few]] = True
    return faint


def sides_in_sight(scene: Scene, seed: int) -> np.ndarray:
    """Find the sides of which some point can be seen, even a narrow strip behind other geometry.

    The backs of one-sided materials are never drawn, and not among them unless nothing else is.

    Args:
        scene: T triangles.
        seed: Seed of the sampler.

    Returns:
        [2, T] bool.
    """
    groups = triangle_groups(scene)
    tested = groups.tested & (tables(scene).area > 0)
    seen = groups.spread(visible_sides(scene, seed, within=tested) | met_sides(scene, seed))
    side, triangle = np.nonzero(~seen & tested)
    if len(side):
        seen = groups.spread(seen | met_sides(scene, seed + 1, side, triangle))
        side, triangle = np.nonzero(~seen & tested)
    if len(side):
        points, row = spread(scene, side, triangle, VISIBILITY_RAYS, seed)
        found = row[reject(scene, points, seed=seed, buried=False)]
        seen[side[found], triangle[found]] = True
    seen = groups.spread(seen)
    drawn = seen & ~culled_sides(scene)
    return drawn if drawn.any() else seen


def culled_sides(scene: Scene) -> np.ndarray:
    """Find the backs of one-sided materials, which rasterisers do not draw.

    Args:
        scene: T triangles.

    Returns:
        [2, T] bool.
    """
    culled = tables(scene).culled[tables(scene).mesh_of]
    return np.stack([np.zeros_like(culled), culled])


def met_sides(
    scene: Scene, seed: int, side: np.ndarray | None = None, triangle: np.ndarray | None = None
) -> np.ndarray:
    """Find the sides that rays from free air hit, in all directions or towards given sides.

    Of two coincident faces, the one that rays hit counts.

    Args:
        scene: T triangles.
        seed: Seed of the sampler.
        side: [K] side, 0 or 1, of each target; None: all directions.
        triangle: [K] triangle of each target; None: all directions.

    Returns:
        [2, T] bool.
    """
    rng = np.random.default_rng([seed, 0x6A2E])
    places = free_places(scene, rng)
    if len(scene.cameras):
        places = np.concatenate([places, np.float32([c.position for c in scene.cameras])])
    if side is None:
        origin, d = places[rng.integers(len(places), size=VIEW_RAYS)], rng.normal(size=(VIEW_RAYS, 3))
    else:
        rows = rng.permutation(np.repeat(np.arange(len(side)), AIMED))[:VIEW_RAYS]
        root, v = np.sqrt(rng.random(len(rows))), rng.random(len(rows))
        place = np.stack([root * (1 - v), root * v], axis=1).astype(np.float32)
        position, _, flat = frames(scene, points := side_points(scene, triangle[rows], side[rows], place))
        eye = places[rng.integers(len(places), size=len(points))]
        facing = ((eye - position) * flat).sum(axis=1) * np.where(side[rows] == 0, 1, -1) > 0
        origin, d = eye[facing], (position - eye)[facing]
    return _met(scene, origin, d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-12))


def _met(scene: Scene, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """[2, T] bool: sides that rays [N, 3] hit."""
    t = tables(scene)
    found = np.zeros((2, len(t.area)), bool)
    if not len(origin):
        return found
    ray = mi.Ray3f(upload(mi.Point3f, origin), upload(mi.Vector3f, direction))
    pi = scene.mi.ray_intersect_preliminary(ray)
    si = pi.compute_surface_interaction(ray, mi.RayFlags.Minimal)
    hit, back = pi.is_valid(), dr.dot(si.n, ray.d) > 0
    mesh, triangle = shape_index(shape_lookup(scene), pi.shape), pi.prim_index
    dr.eval(hit, back, mesh, triangle)
    hit, mesh = np.array(hit, bool), np.array(mesh)
    found[np.array(back, bool)[hit].astype(int), t.first[mesh[hit]] + np.array(triangle)[hit]] = True
    return found


def free_places(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Sample points in the free air: in the half of it that is farther from surfaces, as many in the part of the scene
    that is looked at as in all of it, of which a room under a sky dome is nothing; and wherever somebody may stand, of
    which rooms below large ground are a small part. Those of a flat scene, which has no air of its own, are around it.

    Args:
        scene: The scene.
        rng: Random generator.

    Returns:
        [K, 3] float32 positions, metres.
    """
    from lightwell.scenes.free_air import free_air

    air, found = free_air(scene), []
    for low, high in (scene.bounds, scene.core):
        places = low + (high - low) * rng.random((PLACES, 3))
        distance = air.distance(places)
        found.append(places[distance > np.quantile(distance, 0.5)].astype(np.float32))
    low, high = scene.core
    places = low + (high - low) * rng.random((2 * PLACES, 3))
    space = float(np.clip(STANDING, LEAST_STANDING * scene.core_extent, MOST_STANDING * scene.core_extent))
    if len(places := places[air.accepts(places, space)]):
        found.append(rng.choice(places, PLACES // 2).astype(np.float32))
    if not any(map(len, found)):
        around = FLAT_AROUND * scene.core_extent
        places = low - around + (high - low + 2 * around) * rng.random((PLACES, 3))
        found.append(places.astype(np.float32))
    return np.concatenate(found)


def spread(
    scene: Scene, side: np.ndarray, triangle: np.ndarray, count: int, seed: int
) -> tuple[SurfacePoints, np.ndarray]:
    """Sample random points on sides of triangles, at least two on each and more on larger ones.

    Args:
        scene: T triangles.
        side: [K] side, 0 or 1.
        triangle: [K] triangle.
        count: Number of points over all sides, about.
        seed: Seed of the sampler.

    Returns:
        P surface points, and [P] int row of each in ``side``.
    """
    area = tables(scene).area[triangle]
    looks = np.clip(count * area / max(area.sum(), 1e-30), 2, count).astype(np.int64)
    row = np.repeat(np.arange(len(side)), looks)
    u, v = np.random.default_rng([seed, 0x51DE]).random((2, len(row)))
    root = np.sqrt(u)
    place = np.stack([root * (1 - v), root * v], axis=1).astype(np.float32)
    return side_points(scene, triangle[row], side[row], place), row


def side_inputs(scene: Scene, settings: Mapping[str, Any], arrays: Arrays) -> Inputs:
    """Sample points on sides of triangles; see ``row_recipes.RecipeFunction``.

    Args:
        scene: T triangles.
        settings: ``count`` and ``seed`` of ``spread``.
        arrays: ``side`` and ``triangle`` [K].

    Returns:
        Columns of ``SurfacePoints``.
    """
    side, triangle = (arrays[name].astype(np.int64) for name in ("side", "triangle"))
    return Inputs(columns_of(spread(scene, side, triangle, settings["count"], settings["seed"])[0]))


def matte(scene: Scene) -> np.ndarray:
    """Find the meshes whose radiance is view-independent.

    Args:
        scene: M meshes.

    Returns:
        [M] bool.
    """
    return np.array([is_matte(scene.materials[mesh.material]) for mesh in scene.meshes], bool)
