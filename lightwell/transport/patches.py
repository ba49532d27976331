"""Small flat patches of surface: nine points each, for judging how even learned light is.

Notation: P patches of POINTS points each, patch by patch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.transport.point_rejection import reject
from lightwell.transport.queries import frames
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.surface import draw_surface
from lightwell.transport.tables import tables

# Points of a patch.
POINTS = 9
# Radius of a patch: this share of the scene's diagonal, and this many metres at most.
RADIUS_SHARE, MOST_RADIUS = 0.015, 0.2
# Candidate centres per patch wanted; offsets tried per point.
CANDIDATES, TRIES = 6, 24


def patch_radius(scene: Scene) -> float:
    """Compute the radius of the patches of a scene.

    Args:
        scene: The scene.

    Returns:
        Metres.
    """
    low, high = scene.core
    return min(RADIUS_SHARE * float(np.linalg.norm(high - low)), MOST_RADIUS)


def draw_patches(scene: Scene, count: int, seed: int) -> SurfacePoints:
    """Draw flat patches, area-uniform, each on one triangle; all of their points see air.

    The points of a patch are viewed from one place, the scene's size away from their middle.

    Args:
        scene: The scene.
        count: Most patches.
        seed: Seed of the points.

    Returns:
        P * ``POINTS`` points, patch by patch.
    """
    centres = draw_surface(scene, CANDIDATES * count, seed, floor=0, core=True, shown=True).points
    wide = _triangle_area(scene, centres) > patch_radius(scene) ** 2
    centres = centres[np.flatnonzero(wide)]
    if not len(centres):
        return centres
    points, whole = _around(scene, centres, np.random.default_rng([seed, 7]))
    seen = reject(scene, points, seed=seed).reshape(-1, POINTS).all(axis=1)
    kept = np.flatnonzero(whole & seen)[:count]
    return points[(kept[:, None] * POINTS + np.arange(POINTS)).ravel()]


def _triangle_area(scene: Scene, points: SurfacePoints) -> np.ndarray:
    """[N] area of the triangle of each point, square metres."""
    t = tables(scene)
    return t.area[t.first[points.shape] + points.triangle]


def _around(scene: Scene, centres: SurfacePoints, random: np.random.Generator) -> tuple[SurfacePoints, np.ndarray]:
    """POINTS points per centre on its triangle, within the radius, and whether enough were found [P]."""
    edges = _edges(scene, centres)
    offset = _disc(edges, patch_radius(scene), random)
    # Barycentric coordinates of offsets in the plane of the triangle: least squares, exact there.
    step = np.einsum("pec,pkc->pke", np.linalg.pinv(edges).transpose(0, 2, 1), offset)
    place = centres.barycentric[:, None] + step
    inside = (place.min(axis=-1) >= 0) & (place.sum(axis=-1) <= 1)
    order = np.argsort(~inside, axis=1, kind="stable")[:, : POINTS - 1]
    chosen = np.take_along_axis(place, order[..., None], axis=1)
    whole = np.take_along_axis(inside, order, axis=1).all(axis=1)
    chosen = np.where(whole[:, None, None], chosen, centres.barycentric[:, None])
    barycentric = np.concatenate([centres.barycentric[:, None], chosen], axis=1).reshape(-1, 2).astype(np.float32)
    rows = np.repeat(np.arange(len(centres)), POINTS)
    points = replace(centres[rows], barycentric=barycentric)
    return _facing_one_eye(scene, centres, points, rows), whole


def _edges(scene: Scene, points: SurfacePoints) -> np.ndarray:
    """[N, 2, 3] edges from the first vertex of each point's triangle."""
    corners = np.stack(
        [scene.meshes[s].positions[scene.meshes[s].indices[t]] for s, t in zip(points.shape, points.triangle)]
    )
    return (corners[:, 1:] - corners[:, :1]).astype(np.float64)


def _disc(edges: np.ndarray, radius: float, random: np.random.Generator) -> np.ndarray:
    """[P, POINTS * TRIES, 3] offsets, uniform in a disc in the plane of each triangle."""
    first = edges[:, 0] / np.linalg.norm(edges[:, 0], axis=-1, keepdims=True)
    across = edges[:, 1] - (edges[:, 1] * first).sum(axis=-1, keepdims=True) * first
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-30)
    distance, angle = random.random((2, len(edges), POINTS * TRIES))
    distance, angle = radius * np.sqrt(distance), 2 * np.pi * angle
    return (distance * np.cos(angle))[..., None] * first[:, None] + (distance * np.sin(angle))[..., None] * across[
        :, None
    ]


def _facing_one_eye(scene: Scene, centres: SurfacePoints, points: SurfacePoints, rows: np.ndarray) -> SurfacePoints:
    """The points with views towards the eye of their patch's centre."""
    eye = frames(scene, centres)[0] + 0.25 * scene.core_extent * centres.view
    way = eye[rows] - frames(scene, points)[0]
    return replace(points, view=(way / np.linalg.norm(way, axis=1, keepdims=True)).astype(np.float32))
