"""What a light map learns from: light that arrives at texels, and light that leaves surfaces towards eyes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.fields.atlas_images import denoised, dilated
from lightwell.scenes.atlas import Atlas, build, padding
from lightwell.scenes.placing import initial_light, sample_cameras
from lightwell.scenes.scene import Scene
from lightwell.scenes.still_light import under_sky, with_lamp
from lightwell.scenes.variables import declare
from lightwell.transport.air import _escape_share, reject
from lightwell.transport.irradiance import Irradiance, irradiance
from lightwell.transport.mapped import MappedQuery, mapped_query
from lightwell.transport.queries import frames
from lightwell.transport.radiance import static
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.surface import draw_surface
from lightwell.transport.tables import tables
from lightwell.transport.texels import Texels, texels
from lightwell.transport.visible import side_points, visible_sides

# More rays than this leave a scene that daylight can enter.
OPEN = 0.005
# A side counts as lit when its brightest point has this share of the mean light; paths that look for it.
DARK, DARK_PATHS = 1e-4, 16
# Texels darker than this share of the mean are asked whether anything can see them.
BLACK = 0.02
# Shares of view directions: towards places where an eye may stand, the rest as ``draw_surface`` distributes them.
TOWARDS_EYES = 0.5


@dataclass(frozen=True)
class Chart:
    """An atlas and the light that arrives on it."""

    atlas: Atlas
    texels: Texels
    light: Irradiance
    stored: np.ndarray
    """[K] bool: texels that something can see; the others take the light of their neighbours."""


def lit_scene(scene: Scene) -> tuple[Scene, str]:
    """A scene without light of its own gets a sky where daylight can enter, else a lamp; and what was done."""
    if scene.has_static_light:
        return scene, ""
    if _escape_share(scene) > OPEN:
        return under_sky(scene), "the scene has no light of its own: it stands under a white sky"
    variable = declare((), scene)
    place = initial_light(scene, variable, (scene.cameras or sample_cameras(scene, variable, 1, 0))[0])
    where = ", ".join(f"{c:.2f}" for c in place)
    return with_lamp(scene, place), f"the scene has no light of its own: a lamp hangs at ({where})"


def lit_sides(scene: Scene, seed: int) -> np.ndarray:
    """[2, T] bool: sides that something sees and light reaches."""
    seen = visible_sides(scene, seed)
    side, triangle = np.nonzero(seen)
    brightest = np.zeros(len(side))
    for place in ((1 / 3, 1 / 3), (0.1, 0.8)):
        points = side_points(scene, triangle, side, np.broadcast_to(np.float32(place), (len(side), 2)))
        brightest = np.maximum(brightest, irradiance(scene, points, DARK_PATHS, seed).mean.mean(axis=1))
    area = tables(scene).area[triangle]
    # Large triangles may be lit where nobody looked.
    lit = (brightest > DARK * np.average(brightest, weights=area)) | (area > 1e-3 * area.sum())
    dark_backs = lit.copy()
    dark_backs[side == 1] &= brightest[side == 1] > DARK * np.average(brightest, weights=area)
    found = np.zeros_like(seen)
    found[side[dark_backs], triangle[dark_backs]] = True
    return found


def chart(scene: Scene, size: int, mips: int, paths: int, seed: int, own: bool = True, lit=None) -> Chart:
    """Atlas, texels and their light."""
    atlas = build(scene, size, lit_sides(scene, seed) if lit is None else lit, mips, own=own)
    covered = texels(scene, atlas)
    light = irradiance(scene, covered.points, paths, seed + 1)
    return Chart(atlas, covered, light, stored_texels(scene, covered, light, seed))


def stored_texels(scene: Scene, covered: Texels, light: Irradiance, seed: int) -> np.ndarray:
    """[K] bool: finite light, not facing the insides of things and, where it is black, seen from somewhere.

    The floor under a box is black: read bilinearly it would darken the floor beside the box.
    """
    brightness = light.mean.mean(axis=1)
    stored = light.valid & np.isfinite(brightness)
    dark = np.flatnonzero(stored & (brightness < BLACK * brightness[stored].mean()))
    if len(dark):
        stored[dark] = reject(scene, covered.points[dark], seed=seed)
    return stored


def light_image(made: Chart, clean: bool = True) -> np.ndarray:
    """[n, n, 3] E' of an atlas: denoised, continued across chart borders and smooth between them."""
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


def direction_image(made: Chart) -> np.ndarray:
    """[n, n, 3] in [-1, 1]: mean direction of the light, as long as the light is directed."""
    n = made.atlas.size
    image = np.zeros((n * n, 3), np.float32)
    brightness = made.light.mean @ np.float32([0.2126, 0.7152, 0.0722])
    image[made.texels.index] = made.light.direction / np.maximum(brightness, 1e-6)[:, None]
    covered = np.zeros(n * n, bool)
    covered[made.texels.index] = made.stored & np.isfinite(image[made.texels.index]).all(axis=1)
    return np.clip(dilated(image.reshape(n, n, 3), covered.reshape(n, n), padding(made.atlas.mips)), -1, 1)


def reduced(image: np.ndarray, factor: int) -> np.ndarray:
    """[n / f, n / f, C] means of squares of texels."""
    n = image.shape[0] // factor
    return image.reshape(n, factor, n, factor, -1).mean(axis=(1, 3))


@dataclass(frozen=True)
class EyeSamples:
    """N surface points with views, and the radiance that leaves them."""

    query: MappedQuery
    half_a: np.ndarray
    half_b: np.ndarray
    weight: np.ndarray

    @property
    def radiance(self) -> np.ndarray:
        """[N, 3] both halves."""
        return 0.5 * (self.half_a + self.half_b)


def eye_samples(scene: Scene, atlas: Atlas, count: int, paths: int, seed: int) -> EyeSamples:
    """Surface points, half of them seen from places where an eye may stand, and their radiance."""
    draw = draw_surface(scene, count, seed, floor=64)
    points = _towards_eyes(scene, draw.points, seed)
    a, b = static(scene, points, paths, seed)
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    weight = np.where(good, draw.weight, 0).astype(np.float32)
    return EyeSamples(mapped_query(scene, atlas, points), np.nan_to_num(a), np.nan_to_num(b), weight)


def _towards_eyes(scene: Scene, points: SurfacePoints, seed: int) -> SurfacePoints:
    """Turn a share of the views towards free places that the surface faces; occlusion is not asked: what lies behind
    another surface is seen through a door, or never."""
    from lightwell.scenes.free_air import free_air

    rng = np.random.default_rng([seed, 0xE7E])
    low, high = scene.bounds
    air = free_air(scene)
    places = low + (high - low) * rng.random((4096, 3))
    distance = air.distance(places)
    places = places[distance > np.quantile(distance, 0.5)].astype(np.float32)
    position, _, flat = frames(scene, points)
    flat = np.where((flat * points.view).sum(axis=1, keepdims=True) < 0, -flat, flat)
    eye = places[rng.integers(len(places), size=len(points))] - position
    eye /= np.maximum(np.linalg.norm(eye, axis=1, keepdims=True), 1e-9)
    turned = (rng.random(len(points)) < TOWARDS_EYES) & ((eye * flat).sum(axis=1) > 0.05)
    view = np.where(turned[:, None], eye, points.view).astype(np.float32)
    return SurfacePoints(points.shape, points.triangle, points.barycentric, view)
