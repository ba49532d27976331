"""Texels of a light map behind walls or under other bodies: a bilinear read beside them would mix them in.

A floor that is one triangle may go on under a wall, into the wall or into a closed dark room. Little or no light
arrives there, and the texel beside the wall would darken a strip in front of it that is as wide as a texel.

Notation: n texels along each edge of the atlas, K covered texels.
"""

from __future__ import annotations

import numpy as np

from lightwell.backend import mi
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.scene import Scene
from lightwell.transport.interactions import upload
from lightwell.transport.irradiance import irradiance
from lightwell.transport.point_rejection import covered as touched
from lightwell.transport.queries import frames
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.texels import Texels, texel_points

# A neighbour that gets so many times the light may be on the other side of a wall.
BRIGHTER = 10.0
# Texels with less of the light of a neighbour may be under another body.
DIMMER = 0.5
# Rays between texels run this share of the core's extent above the surface: 3 mm in a house.
ABOVE = 1e-4
# Least cosine between the normals of texels that continue one another.
FLAT = 0.9
# Somebody may stand where there is so much space before a surface, and so much across at half of that, metres.
STANDING, ACROSS = 1.5, 0.6
# Directions in which the space across is measured.
DIRECTIONS = 6
# Paths per texel that decide whether one behind a wall is black: few paths find no light in dim rooms either.
CERTAIN_PATHS = 256
# Steps to half of the eight neighbours; the other half are their opposites.
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))


def behind_walls(
    scene: Scene, atlas: Atlas, covered: Texels, brightness: np.ndarray, stored: np.ndarray, black: float, seed: int
) -> np.ndarray:
    """Find black texels beside a lit one of the same chart, with a wall between the two, and the next black ones.

    The next ones are found too, so that the nearest texel with light of its own is the lit one. Texels of dark rooms
    stay: there, the light of the other side of the wall would be a glow.

    Args:
        scene: The scene.
        atlas: The atlas.
        covered: K covered texels.
        brightness: [K] irradiance / π, mean over the channels.
        stored: [K] bool: texels whose light counts.
        black: Irradiance / π below which a texel is black.
        seed: Seed of the sampler.

    Returns:
        [K] bool.
    """
    pairs = _neighbours(covered)
    dark, lit = np.concatenate([pairs, pairs[:, ::-1]]).T
    chosen = stored[dark] & stored[lit] & (brightness[dark] < black) & (brightness[lit] > black)
    chosen &= brightness[lit] > BRIGHTER * brightness[dark]
    chosen[chosen] = _apart(scene, covered, dark[chosen], lit[chosen])
    chosen[chosen] = ~in_rooms(scene, covered.points[dark[chosen]])
    found = np.zeros(len(stored), bool)
    rows = np.unique(dark[chosen])
    if not len(rows):
        return found
    # Where few paths found no light by chance, more do.
    recipe = texel_points(atlas, len(covered.index), rows)
    certain = irradiance(scene, covered.points[rows], CERTAIN_PATHS, seed, recipe).mean.mean(axis=1) < black
    found[rows[certain]] = True
    found[dark[found[lit] & (brightness[dark] < black)]] = True
    return found & stored


def under_bodies(scene: Scene, covered: Texels, brightness: np.ndarray, stored: np.ndarray, seed: int) -> np.ndarray:
    """Find texels that another body touches, darker than a neighbour: light enters the narrow gap between the two.

    The next dark ones are found too, see ``behind_walls``.

    Args:
        scene: The scene.
        covered: K covered texels.
        brightness: [K] irradiance / π, mean over the channels.
        stored: [K] bool: texels whose light counts.
        seed: Seed of the sampler.

    Returns:
        [K] bool.
    """
    pairs = _neighbours(covered)
    dim, lit = np.concatenate([pairs, pairs[:, ::-1]]).T
    chosen = stored[dim] & stored[lit] & (brightness[dim] < DIMMER * brightness[lit])
    rows = np.unique(dim[chosen])
    found = np.zeros(len(stored), bool)
    found[rows] = touched(scene, covered.points[rows], seed)
    beside = np.zeros(len(stored))
    np.maximum.at(beside, dim[chosen], brightness[lit[chosen]])
    # From here on, ``lit`` is the texel that was found and ``dim`` the next one.
    found[dim[found[lit] & (brightness[dim] < DIMMER * beside[lit])]] = True
    return found & stored


def _neighbours(covered: Texels) -> np.ndarray:
    """Pairs [P, 2] of texels of one chart that touch, each pair once."""
    n = len(covered.chart)
    number = np.full(n * n, -1, np.int64)
    number[covered.index] = np.arange(len(covered.index))
    number, pairs = number.reshape(n, n), []
    for down, right in STEPS:
        rows = slice(0, n - down), slice(down, n)
        columns = (slice(0, n - right), slice(right, n)) if right >= 0 else (slice(-right, n), slice(0, n + right))
        here, there = (number[r, c] for r, c in zip(rows, columns))
        same = covered.chart[rows[0], columns[0]] == covered.chart[rows[1], columns[1]]
        same &= (here >= 0) & (there >= 0)
        pairs.append(np.stack([here[same], there[same]], axis=1))
    return np.concatenate(pairs)


def _apart(scene: Scene, covered: Texels, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Test [P] whether something stands between two texels of a flat part of a surface."""
    if not len(one):
        return np.zeros(0, bool)
    (start, up), (end, turned) = (_lifted(scene, covered.points[rows]) for rows in (one, other))
    way = end - start
    ray = mi.Ray3f(upload(mi.Point3f, start), upload(mi.Vector3f, way))
    ray.maxt = mi.Float(1.0)
    return np.array(scene.mi.ray_test(ray), bool).reshape(-1) & ((up * turned).sum(axis=1) > FLAT)


def _lifted(scene: Scene, points: SurfacePoints) -> tuple[np.ndarray, np.ndarray]:
    """Places [P, 3] a little above points on the side of their views, and the normals there."""
    position, _, flat = frames(scene, points)
    up = np.where((flat * points.view).sum(axis=1, keepdims=True) < 0, -flat, flat)
    return position + ABOVE * scene.core_extent * up, up


def in_rooms(scene: Scene, points: SurfacePoints) -> np.ndarray:
    """Test whether somebody may stand before points; the insides of walls, roofs and columns are too narrow.

    Args:
        scene: The scene.
        points: N surface points.

    Returns:
        [N] bool.
    """
    if not len(points):
        return np.zeros(0, bool)
    start, up = _lifted(scene, points)
    found = _free(scene, start, up) >= STANDING
    middle = start + 0.5 * STANDING * up
    aside = np.cross(up, np.eye(3)[np.abs(up).argmin(axis=1)])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    for angle in np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        way = np.cos(angle) * aside + np.sin(angle) * np.cross(up, aside)
        found &= _free(scene, middle, way) + _free(scene, middle, -way) >= ACROSS
    return found


def _free(scene: Scene, start: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Distance [P] to the next surface, metres; infinite where there is none."""
    ray = mi.Ray3f(upload(mi.Point3f, start), upload(mi.Vector3f, way))
    pi = scene.mi.ray_intersect_preliminary(ray)
    return np.where(np.array(pi.is_valid(), bool), np.array(pi.t), np.inf).reshape(-1)
