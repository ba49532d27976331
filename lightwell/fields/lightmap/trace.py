"""Samples of a light map: irradiance at texels, and radiance that leaves surfaces towards views.

n texels along the edge of the atlas, K covered texels, M meshes, T triangles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import distance_transform_edt

from lightwell.backend import dr, mi
from lightwell.fields.base import is_matte
from lightwell.fields.lightmap.atlas_images import SMALL, denoised, dilated
from lightwell.fields.lightmap.media import media_meshes, volumetric
from lightwell.fields.lightmap.nodes import DIELECTRIC
from lightwell.scenes.atlas import NOWHERE, Atlas, build, padding
from lightwell.scenes.default_light import under_sky, with_lamp
from lightwell.scenes.normal_maps import relief
from lightwell.scenes.placing import initial_light, sample_cameras
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import declare
from lightwell.transport.gather import KnownIrradiance, gathered
from lightwell.transport.interactions import upload
from lightwell.transport.irradiance import Irradiance, irradiance
from lightwell.transport.lightmap_query import LightmapQuery, query_of_lightmap
from lightwell.transport.point_rejection import _escape_share, reject
from lightwell.transport.queries import frames, make_query
from lightwell.transport.radiance import static
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.surface import SurfaceDraw, draw_surface
from lightwell.transport.tables import shape_index, shape_lookup, tables
from lightwell.transport.texels import Texels, texels
from lightwell.transport.visible import side_points, visible_sides

# A scene is open to daylight if more than this share of rays leaves it.
OPEN = 0.005
# A side counts as lit when its brightest point has this share of the mean light; paths per point of the search.
DARK, DARK_PATHS = 1e-4, (8, 64, 512)
# Points of this search over the whole scene; each side gets two at least.
LOOKS = 1 << 16
# The same for sides that were not visible so far.
VISIBILITY_RAYS = 1 << 16
# Rays from free air that search for sides: in all directions, and towards each side that was not found yet.
VIEW_RAYS, AIMED = 1 << 20, 16
# Sides of more than this share of all area are faint if less than this share of so many points on them is visible.
LARGE, LITTLE, RAYS_PER_SIDE = 1e-3, 0.1, 64
# Texels of charts too narrow to be denoised get at most so many times the paths, and all of them so many of all paths.
NARROW_PATHS, NARROW_SHARE = 8, 0.75
# Texels darker than this share of the mean are stored only if they are visible.
BLACK = 0.02
# Points of a scene without glossy surfaces.
FEW_EYES = 1 << 12
# Paths through media are noisier: so many times more of them.
MEDIA_PATHS = 4
# Surfaces darker than this keep the light of the surface tracer.
LEAST_ALBEDO = 0.02
# Shares of view directions: towards likely camera positions, the rest as ``draw_surface`` distributes them.
TOWARDS_EYES = 0.5


@dataclass(frozen=True)
class AtlasIrradiance:
    """An atlas and the irradiance at its texels."""

    atlas: Atlas
    texels: Texels
    light: Irradiance
    stored: np.ndarray
    """[K] bool: visible texels; the others take the light of their neighbours."""
    glossy: np.ndarray
    """[K] bool: the texel belongs to a glossy surface, whose radiance is view-dependent."""

    @cached_property
    def image(self) -> np.ndarray:
        """Return irradiance / π over the atlas, see ``light_image``.

        Returns:
            [n, n, 3] float32.
        """
        return light_image(self)


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


@dataclass(frozen=True)
class TriangleSides:
    """[2, T] bool each: the sides of triangles that a light map stores."""

    lit: np.ndarray
    """Stored: visible and lit."""
    dark: np.ndarray
    """Visible, but black in the light map: no light reaches them, or they are clear glass."""
    faint: np.ndarray
    """Stored, but large and mostly hidden behind other geometry."""


def lit_sides(scene: Scene, seed: int) -> TriangleSides:
    """Find the sides of triangles that can be seen and receive light, and those that can be seen and are dark.

    Args:
        scene: T triangles.
        seed: Seed of the sampler.

    Returns:
        The sides.
    """
    seen = sides_in_sight(scene, seed)
    glass = clear_glass(scene)[tables(scene).mesh_of]
    side, triangle = np.nonzero(seen & ~glass)
    area = tables(scene).area[triangle]
    brightest, least = np.zeros(len(side)), 0.0
    for k, paths in enumerate(DARK_PATHS):
        # A few paths find the light of most sides; the others are traced again with more paths.
        rows = np.flatnonzero(brightest <= least)
        if not len(rows):
            break
        points, row = spread(scene, side[rows], triangle[rows], LOOKS if k == 0 else len(rows), seed + k)
        found = irradiance(scene, points, paths, seed + k).mean.mean(axis=1)
        np.maximum.at(brightest, rows[row], np.nan_to_num(found))
        least = DARK * np.average(brightest, weights=area)
    bright = brightest > least
    lit = np.zeros_like(seen)
    lit[side[bright], triangle[bright]] = True
    return TriangleSides(lit, seen & ~lit, faint_sides(scene, lit, seed))


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
        seen = reject(scene, side_points(scene, triangle[row], side[row], place), seed=seed)
        few = np.bincount(row, weights=seen, minlength=len(side)) < LITTLE * RAYS_PER_SIDE
        faint[side[few], triangle[few]] = True
    return faint


def sides_in_sight(scene: Scene, seed: int) -> np.ndarray:
    """Find the sides of which some point can be seen, even a narrow strip behind other geometry.

    Args:
        scene: T triangles.
        seed: Seed of the sampler.

    Returns:
        [2, T] bool.
    """
    seen = visible_sides(scene, seed) | met_sides(scene, seed)
    side, triangle = np.nonzero(~seen & (tables(scene).area > 0))
    if len(side):
        seen |= met_sides(scene, seed + 1, side, triangle)
        side, triangle = np.nonzero(~seen & (tables(scene).area > 0))
    if len(side):
        points, row = spread(scene, side, triangle, VISIBILITY_RAYS, seed)
        found = row[reject(scene, points, seed=seed)]
        seen[side[found], triangle[found]] = True
    return seen


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
    """Sample points in the free air, in the half of it that is farther from surfaces.

    Args:
        scene: The scene.
        rng: Random generator.

    Returns:
        [K, 3] float32 positions, metres.
    """
    from lightwell.scenes.free_air import free_air

    low, high = scene.bounds
    places = low + (high - low) * rng.random((4096, 3))
    distance = free_air(scene).distance(places)
    return places[distance > np.quantile(distance, 0.5)].astype(np.float32)


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


def seen_sides(scene: Scene, seed: int) -> TriangleSides:
    """Find all sides that can be seen; those of clear glass are not stored.

    Args:
        scene: T triangles.
        seed: Seed of the sampler.

    Returns:
        The sides.
    """
    seen = sides_in_sight(scene, seed)
    glass = clear_glass(scene)[tables(scene).mesh_of]
    return TriangleSides(seen & ~glass, seen & glass, np.zeros_like(seen))


def _everywhere(scene: Scene, covered: Texels, paths: int, seed: int) -> Irradiance:
    """Irradiance / π at all texels; narrow charts, which the filter cannot denoise, get more paths."""
    light = _arriving(scene, covered.points, paths, seed)
    rows = np.flatnonzero(narrow(covered))
    more = int(min(NARROW_PATHS, NARROW_SHARE * len(covered.index) / max(len(rows), 1)))
    if more < 2:
        return light
    better = _arriving(scene, covered.points[rows], paths * more, seed + 0x7A1)
    columns = {name: getattr(light, name).copy() for name in ("half_a", "half_b", "direction", "wrong")}
    for name, column in columns.items():
        column[rows] = getattr(better, name)
    return replace(light, **columns)


def narrow(covered: Texels) -> np.ndarray:
    """Find the texels of charts, or of parts of them, that are too narrow for the denoiser.

    Args:
        covered: K covered texels.

    Returns:
        [K] bool.
    """
    half = SMALL / 2
    # Charts are apart, so the distance to the nearest uncovered texel is the distance to the border.
    wide = distance_transform_edt(covered.chart >= 0) >= half
    if not wide.any():
        return np.ones(len(covered.index), bool)
    return (distance_transform_edt(~wide) >= 1.5 * half).reshape(-1)[covered.index]


def _arriving(scene: Scene, points: SurfacePoints, paths: int, seed: int) -> Irradiance:
    """E' at texels; where something is full of a medium, the light that left it counts too: what a surface shows along
    its normal, over its albedo."""
    light, media = irradiance(scene, points, paths, seed), media_meshes(scene)
    if not media.any():
        return light
    rows = np.flatnonzero(~media[points.shape])
    color = _albedo(make_query(scene, points[rows], np.zeros(3, np.float32)))
    shown = (color > LEAST_ALBEDO).all(axis=1)
    rows, color = rows[shown], color[shown]
    a, b = light.half_a.copy(), light.half_b.copy()
    a[rows], b[rows] = (half / color for half in volumetric(scene, points[rows], paths, seed))
    return replace(light, half_a=a, half_b=b)


def _albedo(query) -> np.ndarray:
    """[N, 3] diffuse albedo a, as the graph computes it."""
    color = query.reflectance - DIELECTRIC * (1 - query.metallic)
    return np.clip(color * (1 - query.metallic), 0, 1)


def matte(scene: Scene) -> np.ndarray:
    """Find the meshes whose radiance is view-independent.

    Args:
        scene: M meshes.

    Returns:
        [M] bool.
    """
    return np.array([is_matte(scene.materials[mesh.material]) for mesh in scene.meshes], bool)


def clear_glass(scene: Scene) -> np.ndarray:
    """Find the transmissive meshes with a lobe too narrow for a light map; the rasteriser draws them.

    Args:
        scene: M meshes.

    Returns:
        [M] bool.
    """
    materials = [scene.materials[mesh.material] for mesh in scene.meshes]
    return np.array([m.delta and m.transmission > 0.5 for m in materials], bool)


def chart(
    scene: Scene,
    size: int,
    mips: int,
    paths: int,
    seed: int,
    own: bool = True,
    sides: TriangleSides | None = None,
    keep: Callable[[Callable[[], Irradiance]], Irradiance] | None = None,
    atlas: Atlas | None = None,
) -> AtlasIrradiance:
    """Make an atlas and trace the irradiance at its texels.

    Args:
        scene: The scene.
        size: Texels along the edge.
        mips: Levels of the mip chain.
        paths: Paths per texel, even, ≥ 2.
        seed: Seed of the sampler.
        own: Whether second texture coordinates of the scene's file may serve as the atlas.
        sides: Sides to store; None: the lit ones.
        keep: Reads the irradiance of an interrupted bake, or makes and writes it; None: it is made.
        atlas: Atlas of an earlier call; None: it is made.

    Returns:
        Atlas and irradiance.
    """
    if atlas is None:
        sides = lit_sides(scene, seed) if sides is None else sides
        atlas = build(scene, size, sides.lit, mips, own=own, dark=sides.dark, faint=sides.faint)
    covered = texels(scene, atlas)
    light = (keep or (lambda make: make()))(lambda: _everywhere(scene, covered, paths, seed + 1))
    glossy = ~matte(scene)[covered.points.shape]
    return AtlasIrradiance(atlas, covered, light, stored_texels(scene, covered, light, seed), glossy)


def stored_texels(scene: Scene, covered: Texels, light: Irradiance, seed: int) -> np.ndarray:
    """Find the texels to store: finite light, not inside closed objects and, where they are black, visible from
    somewhere.

    The floor under a box is black: read bilinearly it would darken the floor beside the box.

    Args:
        scene: The scene.
        covered: K covered texels.
        light: Irradiance at the texels.
        seed: Seed of the sampler.

    Returns:
        [K] bool.
    """
    brightness = light.mean.mean(axis=1)
    stored = light.valid & np.isfinite(brightness)
    dark = np.flatnonzero(stored & (brightness < BLACK * brightness[stored].mean()))
    if len(dark):
        stored[dark] = reject(scene, covered.points[dark], seed=seed)
    return stored


def light_image(made: AtlasIrradiance, clean: bool = True) -> np.ndarray:
    """Make the image of irradiance / π: denoised, continued across chart borders and smooth between charts.

    Args:
        made: Atlas and irradiance.
        clean: Whether to denoise.

    Returns:
        [n, n, 3] float32.
    """
    n = made.atlas.size
    image = np.zeros((n * n, 3), np.float32)
    image[made.texels.index] = made.light.mean
    valid = np.zeros(n * n, bool)
    valid[made.texels.index] = made.stored
    image, valid = image.reshape(n, n, 3), valid.reshape(n, n)
    chart_of = np.where(valid, made.texels.chart, -1)
    # Invalid texels take the light of the nearest valid one, of the same chart where it has any.
    image = dilated(image, valid, padding(made.atlas.mips))
    if clean:
        image = denoised(image, chart_of, padding(made.atlas.mips))
        image = dilated(image, valid, padding(made.atlas.mips))
    return image


def mask_image(made: AtlasIrradiance) -> np.ndarray:
    """Make the mask of a light map: red where the surface is glossy, green where a texel is covered.

    Args:
        made: Atlas and irradiance.

    Returns:
        [n, n, 3] uint8.
    """
    n = made.atlas.size
    image = np.zeros((n * n, 3), np.float32)
    image[made.texels.index, 0] = 255 * made.glossy
    image[made.texels.index, 1] = 255
    covered = made.texels.chart >= 0
    reach = padding(made.atlas.mips)
    near = distance_transform_edt(~covered) <= reach
    return np.where(near[..., None], dilated(image.reshape(n, n, 3), covered, reach), 0).astype(np.uint8)


def direction_image(made: AtlasIrradiance) -> np.ndarray:
    """Make the image of the mean direction of the light; its length is the degree to which the light is directed.

    Args:
        made: Atlas and irradiance.

    Returns:
        [n, n, 3] float32 in [−1, 1].
    """
    n = made.atlas.size
    image = np.zeros((n * n, 3), np.float32)
    brightness = made.light.mean @ np.float32([0.2126, 0.7152, 0.0722])
    image[made.texels.index] = made.light.direction / np.maximum(brightness, 1e-6)[:, None]
    covered = np.zeros(n * n, bool)
    covered[made.texels.index] = made.stored & np.isfinite(image[made.texels.index]).all(axis=1)
    return np.clip(dilated(image.reshape(n, n, 3), covered.reshape(n, n), padding(made.atlas.mips)), -1, 1)


def reduced(image: np.ndarray, factor: int) -> np.ndarray:
    """Average squares of texels.

    Args:
        image: [n, n, C] image.
        factor: f, texels along the edge of a square; divides n.

    Returns:
        [n / f, n / f, C] means.
    """
    n = image.shape[0] // factor
    return image.reshape(n, factor, n, factor, -1).mean(axis=(1, 3))


@dataclass(frozen=True)
class ViewSamples:
    """N surface points with views, and the radiance that leaves them."""

    query: LightmapQuery
    half_a: np.ndarray
    half_b: np.ndarray
    weight: np.ndarray

    @property
    def radiance(self) -> np.ndarray:
        """[N, 3] mean of both halves."""
        return 0.5 * (self.half_a + self.half_b)

    def __getitem__(self, rows: np.ndarray) -> ViewSamples:
        """Select rows."""
        query = LightmapQuery(**{n: getattr(self.query, n)[rows] for n in LightmapQuery.__dataclass_fields__})
        return ViewSamples(query, self.half_a[rows], self.half_b[rows], self.weight[rows])

    def __add__(self, other: ViewSamples) -> ViewSamples:
        """Concatenate; the weights of the second are relative to the mean of the first."""
        names = LightmapQuery.__dataclass_fields__
        query = LightmapQuery(**{n: np.concatenate([getattr(s.query, n) for s in (self, other)]) for n in names})
        halves = (np.concatenate([getattr(s, n) for s in (self, other)]) for n in ("half_a", "half_b"))
        return ViewSamples(query, *halves, np.concatenate([self.weight, other.weight * self.weight.mean()]))


def eye_samples(
    scene: Scene, made: AtlasIrradiance, count: int, paths: int, seed: int, known: np.ndarray | None
) -> ViewSamples:
    """Sample points on glossy surfaces, half of them visible from likely camera positions, and trace their radiance.

    A Lambertian surface needs none, because its radiance follows from the irradiance. Where all surfaces are
    Lambertian, a few points of all surfaces are sampled.

    Args:
        scene: The scene.
        made: Atlas and irradiance.
        count: Number of points.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the sampler.
        known: [n, n, 3] irradiance / π of the atlas, at which paths end; None: paths are traced to their ends.

    Returns:
        The samples.
    """
    wanted = ~matte(scene) & ~clear_glass(scene)
    draw = _drawn(scene, wanted, count, seed)
    points = _towards_eyes(scene, draw.points, seed)
    if media_meshes(scene).any():
        a, b = volumetric(scene, points, paths * MEDIA_PATHS, seed)
    elif known is None:
        a, b = static(scene, points, paths, seed)
    else:
        a, b = corrected(scene, made.atlas, points, known, paths, seed)
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    query = query_of_lightmap(scene, made.atlas, points)
    good &= ~clear_glass(scene)[points.shape] & (query.uv1 != NOWHERE).any(axis=1)
    weight = np.where(good, draw.weight, 0).astype(np.float32)
    return ViewSamples(query, np.nan_to_num(a), np.nan_to_num(b), weight)


def _drawn(scene: Scene, wanted: np.ndarray, count: int, seed: int) -> SurfaceDraw:
    """``count`` points on the meshes [M] that are wanted; a few on all meshes where none of them is visible."""
    if wanted.any():
        try:
            return draw_surface(scene, count, seed, floor=64, only=wanted)
        except ValueError:
            pass
    return draw_surface(scene, FEW_EYES, seed, floor=64)


def corrected(
    scene: Scene, atlas: Atlas, points: SurfacePoints, known: np.ndarray, paths: int, seed: int
) -> np.ndarray:
    """Trace radiance by final gather, with its diffuse part replaced by the light map's.

    Args:
        scene: The scene.
        atlas: Its atlas.
        points: N surface points.
        known: [n, n, 3] irradiance / π of the atlas.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the sampler.

    Returns:
        [2, N, 3] radiance, two independent half means.
    """
    light, seen = gathered(scene, points, KnownIrradiance.of(scene, atlas, known, matte(scene)), paths, seed)
    query = query_of_lightmap(scene, atlas, points)
    color = _albedo(query)
    # E' is that of normals without relief, and directions below a bent horizon are never drawn.
    stored = (query.uv1 != NOWHERE).any(axis=1, keepdims=True) & ~relief(scene)[points.shape, None]
    return light + np.where(stored, color * (bilinear(known, query.uv1) - seen), 0)


def bilinear(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Read an image bilinearly, as the graph's op ``texture`` does.

    Args:
        image: [n, n, C] image.
        uv: [N, 2] texture coordinates in [0, 1].

    Returns:
        [N, C] values.
    """
    n = image.shape[0]
    at = np.clip(uv * np.float32(n) - np.float32(0.5), 0, n - 1)
    low = at.astype(np.int64)
    high, t = np.minimum(low + 1, n - 1), (at - low)[..., None].astype(np.float32)
    upper = image[low[:, 1], low[:, 0]] * (1 - t[:, 0]) + image[low[:, 1], high[:, 0]] * t[:, 0]
    lower = image[high[:, 1], low[:, 0]] * (1 - t[:, 0]) + image[high[:, 1], high[:, 0]] * t[:, 0]
    return upper * (1 - t[:, 1]) + lower * t[:, 1]


def _towards_eyes(scene: Scene, points: SurfacePoints, seed: int) -> SurfacePoints:
    """Turn a share of the views towards free places that the surface faces; occlusion is not asked: what lies behind
    another surface is seen through a door, or never."""
    rng = np.random.default_rng([seed, 0xE7E])
    places = free_places(scene, rng)
    position, _, flat = frames(scene, points)
    flat = np.where((flat * points.view).sum(axis=1, keepdims=True) < 0, -flat, flat)
    eye = places[rng.integers(len(places), size=len(points))] - position
    eye /= np.maximum(np.linalg.norm(eye, axis=1, keepdims=True), 1e-9)
    turned = (rng.random(len(points)) < TOWARDS_EYES) & ((eye * flat).sum(axis=1) > 0.05)
    view = np.where(turned[:, None], eye, points.view).astype(np.float32)
    return SurfacePoints(points.shape, points.triangle, points.barycentric, view)
