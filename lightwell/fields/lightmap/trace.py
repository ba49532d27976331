"""Irradiance at the texels of an atlas, and the images that are made of it.

n texels along the edge of the atlas, K covered texels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.ndimage import distance_transform_edt, maximum_filter, minimum_filter

from lightwell.fields.lightmap.atlas_images import SMALL, denoised, dilated, partly_denoised
from lightwell.fields.lightmap.behind_walls import behind_walls, in_rooms, under_bodies
from lightwell.fields.lightmap.media import media_meshes, volumetric
from lightwell.fields.lightmap.nodes import DIELECTRIC
from lightwell.fields.lightmap.sides import TriangleSides, lit_sides, matte
from lightwell.fields.lightmap.square import atlas_of
from lightwell.scenes.atlas import Atlas, padding
from lightwell.scenes.executor import Arrays, Recipe
from lightwell.scenes.scene import Scene
from lightwell.transport.gather import gathered_irradiance, known_arrays
from lightwell.transport.irradiance import Irradiance, irradiance
from lightwell.transport.point_rejection import reject
from lightwell.transport.queries import make_query
from lightwell.transport.samples import Query, SurfacePoints
from lightwell.transport.texels import Texels, texel_points, texels

# Texels of charts too narrow to be denoised get at most so many times the paths, and all of them so many of all paths.
NARROW_PATHS, NARROW_SHARE = 8, 0.75
# Paths do not end where E' of a texel or its neighbours is so many times the mean, and so many times that of another
# neighbour.
PEAK, UNEVEN = 5.0, 1.5
# Share of the full paths that make the light at which gathered paths end; largest relative difference of their mean and
# that of gathered paths, above which the other full paths are traced.
FIRST_SHARE, MOST_BIAS = 0.25, 0.05
# Texels darker than this share of the mean are stored only if they are visible.
BLACK = 0.02
# Surfaces darker than this keep the light of the surface tracer.
LEAST_ALBEDO = 0.02


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
    gathers: int = 0,
) -> AtlasIrradiance:
    """Make an atlas and trace the irradiance at its texels.

    Args:
        scene: The scene.
        size: Texels along the edge.
        mips: Levels of the mip chain.
        paths: Full paths per texel, even, ≥ 2.
        seed: Seed of the sampler.
        own: Whether second texture coordinates of the scene's file may serve as the atlas.
        sides: Sides to store; None: the lit ones.
        keep: Reads the irradiance of an interrupted bake, or makes and writes it; None: it is made.
        atlas: Atlas of an earlier call; None: it is made.
        gathers: Paths per texel, even, that end where the light of a quarter of the full paths is known, and take the
            place of the others; 0: none.

    Returns:
        Atlas and irradiance.
    """
    if atlas is None:
        sides = lit_sides(scene, seed) if sides is None else sides
        atlas = atlas_of(scene, size, mips, sides, own)
    covered = texels(scene, atlas)
    light = (keep or (lambda make: make()))(lambda: _everywhere(scene, atlas, covered, paths, gathers, seed + 1))
    glossy = ~matte(scene)[covered.points.shape]
    return AtlasIrradiance(atlas, covered, light, stored_texels(scene, atlas, covered, light, seed), glossy)


def _everywhere(scene: Scene, atlas: Atlas, covered: Texels, paths: int, gathers: int, seed: int) -> Irradiance:
    """Irradiance / π at all texels: by full paths, then by paths that end where the light of these is known."""
    trace = partial(_arriving, scene)
    if not gathers or media_meshes(scene).any():
        return _with_narrow(trace, atlas, covered, paths, seed)
    first_paths = max(int(FIRST_SHARE * paths) // 2 * 2, 2)
    light = _with_narrow(trace, atlas, covered, first_paths, seed)
    glossy = ~matte(scene)[covered.points.shape]
    first = AtlasIrradiance(atlas, covered, light, stored_texels(scene, atlas, covered, light, seed), glossy)
    known = known_arrays(scene, atlas, first.image, matte(scene), uneven_peaks(first), scattered=True)
    better = _with_narrow(partial(_gathered, scene, known), atlas, covered, gathers, seed + 0x6A7)
    better = replace(better, wrong=light.wrong)
    # Where nearly all light comes from places that texels do not resolve, full paths go on.
    counted = first.stored & np.isfinite(better.mean).all(axis=1)
    share = better.mean[counted].mean() / max(float(light.mean[counted].mean()), 1e-30) if counted.any() else 1.0
    if abs(share - 1) <= MOST_BIAS:
        return better
    rest = max(paths - first_paths, 2)
    return _joined(light, _with_narrow(trace, atlas, covered, rest, seed + 0x3F1), rest / first_paths)


def _with_narrow(
    trace: Callable[[SurfacePoints, int, int, Recipe], Irradiance], atlas: Atlas, covered: Texels, paths: int, seed: int
) -> Irradiance:
    """Irradiance / π at all texels; narrow charts, which the filter cannot denoise, get more paths."""
    light = trace(covered.points, paths, seed, texel_points(atlas, len(covered.index)))
    rows = np.flatnonzero(narrow(covered))
    more = _narrow_factor(len(covered.index), len(rows))
    if more < 2:
        return light
    recipe = texel_points(atlas, len(covered.index), rows)
    better = trace(covered.points[rows], paths * more, seed + 0x7A1, recipe)
    columns = {name: getattr(light, name).copy() for name in ("half_a", "half_b", "direction", "wrong")}
    for name, column in columns.items():
        column[rows] = getattr(better, name)
    return replace(light, **columns)


def _gathered(scene: Scene, known: Arrays, points: SurfacePoints, paths: int, seed: int, recipe: Recipe) -> Irradiance:
    """Irradiance / π at points by paths that end where it is known; the points are sent to workers with the light."""
    (a, b), direction = gathered_irradiance(scene, points, known, paths, seed)
    return Irradiance(a, b, direction, np.zeros(len(points), np.float32))


def _joined(one: Irradiance, other: Irradiance, times: float) -> Irradiance:
    """The mean of two estimates, the second of so many times the paths."""
    part = 1 / (1 + times)
    names = ("half_a", "half_b", "direction", "wrong")
    return Irradiance(*(part * getattr(one, n) + (1 - part) * getattr(other, n) for n in names))


def uneven_peaks(made: AtlasIrradiance) -> np.ndarray:
    """Find bright texels whose light changes much from one to the next: close to a lamp, texels do not resolve it.

    Args:
        made: Atlas and irradiance.

    Returns:
        [n, n] bool.
    """
    image = made.image.mean(axis=2)
    covered = made.texels.chart >= 0
    high = maximum_filter(np.where(covered, image, 0), 3)
    low = minimum_filter(np.where(covered, image, np.inf), 3)
    bright = high > PEAK * image.reshape(-1)[made.texels.index][made.stored].mean()
    return maximum_filter(covered & bright & (high > UNEVEN * low), 3)


def _narrow_factor(texels: int, narrow: int) -> int:
    """How many times the paths narrow texels get in addition; below 2: none."""
    return int(min(NARROW_PATHS, NARROW_SHARE * texels / max(narrow, 1)))


def narrow_cost(covered: Texels) -> int:
    """Count the texels that the paths of narrow charts would be enough for, in addition to all texels.

    Args:
        covered: K covered texels.

    Returns:
        A count, up to ``NARROW_SHARE`` of K.
    """
    rows = int(narrow(covered).sum())
    more = _narrow_factor(len(covered.index), rows)
    return rows * more if more >= 2 else 0


def traced_again(
    scene: Scene, atlas: Atlas, covered: Texels, before: Irradiance, rows: np.ndarray, paths: int, seed: int
) -> Irradiance:
    """Trace some texels again; the others keep their bytes.

    Args:
        scene: The scene.
        atlas: The atlas.
        covered: K covered texels.
        before: Irradiance at all of them.
        rows: [R] increasing numbers of the texels to trace.
        paths: Paths per texel, even, ≥ 2.
        seed: Seed of the sampler.

    Returns:
        Irradiance at all of them.
    """
    made = _arriving(scene, covered.points[rows], paths, seed, texel_points(atlas, len(covered.index), rows))
    columns = {name: getattr(before, name).copy() for name in ("half_a", "half_b", "direction", "wrong")}
    for name, column in columns.items():
        column[rows] = getattr(made, name)
    return replace(before, **columns)


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


def _arriving(scene: Scene, points: SurfacePoints, paths: int, seed: int, recipe: Recipe) -> Irradiance:
    """E' at texels; where something is full of a medium, the light that left it counts too: what a surface shows along
    its normal, over its albedo."""
    light, media = irradiance(scene, points, paths, seed, recipe), media_meshes(scene)
    if not media.any():
        return light
    rows = np.flatnonzero(~media[points.shape])
    color = diffuse_albedo(make_query(scene, points[rows], np.zeros(3, np.float32)))
    shown = (color > LEAST_ALBEDO).all(axis=1)
    rows, color = rows[shown], color[shown]
    a, b = light.half_a.copy(), light.half_b.copy()
    a[rows], b[rows] = (half / color for half in volumetric(scene, points[rows], paths, seed))
    return replace(light, half_a=a, half_b=b)


def diffuse_albedo(query: Query) -> np.ndarray:
    """Compute the diffuse albedo, as the graph does.

    Args:
        query: N queries.

    Returns:
        [N, 3] albedo in [0, 1].
    """
    color = query.reflectance - DIELECTRIC * (1 - query.metallic)
    return np.clip(color * (1 - query.metallic), 0, 1)


def stored_texels(scene: Scene, atlas: Atlas, covered: Texels, light: Irradiance, seed: int) -> np.ndarray:
    """Find the texels to store: finite light, not inside closed objects and, where they are black, visible from
    somewhere.

    The floor under a box is black: read bilinearly it would darken the floor beside the box. The floor of a closed dark
    room is black too, and a camera may stand there: it must not take the light of the floor outside.

    Args:
        scene: The scene.
        atlas: The atlas.
        covered: K covered texels.
        light: Irradiance at the texels.
        seed: Seed of the sampler.

    Returns:
        [K] bool.
    """
    brightness = light.mean.mean(axis=1)
    stored = light.valid & np.isfinite(brightness)
    black = BLACK * brightness[stored].mean()
    dark = np.flatnonzero(stored & (brightness < black))
    if len(dark):
        stored[dark] = reject(scene, covered.points[dark], seed=seed, buried=False)
        hidden = dark[~stored[dark]]
        hidden = hidden[in_rooms(scene, covered.points[hidden])]
        stored[hidden] = reject(scene, covered.points[hidden], seed=seed, walks=False, buried=False)
        stored &= ~behind_walls(scene, atlas, covered, np.nan_to_num(brightness), stored, black, seed)
    return stored & ~under_bodies(scene, covered, np.nan_to_num(brightness), stored, seed)


def light_image(made: AtlasIrradiance, clean: bool = True, values: np.ndarray | None = None) -> np.ndarray:
    """Make the image of irradiance / π: denoised, continued across chart borders and smooth between charts.

    Args:
        made: Atlas and irradiance.
        clean: Whether to denoise.
        values: [K, 3] other light at the texels; None: that of ``made``.

    Returns:
        [n, n, 3] float32.
    """
    n = made.atlas.size
    image = np.zeros((n * n, 3), np.float32)
    image[made.texels.index] = made.light.mean if values is None else values
    valid = np.zeros(n * n, bool)
    valid[made.texels.index] = made.stored
    image, valid = image.reshape(n, n, 3), valid.reshape(n, n)
    chart_of = np.where(valid, made.texels.chart, -1)
    # Invalid texels take the light of the nearest valid one, of the same chart where it has any.
    image = dilated(image, valid, padding(made.atlas.mips))
    if clean:
        image = denoised(image, chart_of, padding(made.atlas.mips))
        if values is None:
            halves = np.zeros((2, n * n, 3), np.float32)
            halves[:, made.texels.index] = made.light.half_a, made.light.half_b
            image = partly_denoised(*halves.reshape(2, n, n, 3), image, valid)
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
