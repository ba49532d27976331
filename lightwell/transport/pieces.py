"""The part of the surface that is drawn from: all triangles, or what of them lies in the core of a scene.

A dome of sky or ground of kilometres has nearly all of a scene's area and is hardly looked at.

Notation: P pieces, T triangles, M meshes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.transport.tables import tables

# Pieces on the border of the core are divided until their longest edge is this share of the core's.
FINEST = 1 / 64
# A triangle's own corners, as weights of its second and third vertex.
WHOLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
# The four parts of a triangle that is divided at the middles of its edges, as weights of its corners.
_HALVES = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])
_PARTS = _HALVES[[[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]]


@dataclass(frozen=True)
class Pieces:
    """Triangles that cover a surface, each a part of a triangle of the scene."""

    triangle: np.ndarray
    """[P] number over all meshes."""
    corners: np.ndarray
    """[P, 3, 2] corners, as weights of the triangle's second and third vertex."""
    area: np.ndarray
    """[P] float64, square metres."""
    mesh_area: np.ndarray
    """[M] float64, square metres of the pieces of each mesh."""


PIECES = Derived[Pieces]("transport.pieces")


def whole(scene: Scene) -> Pieces:
    """Return all triangles as pieces.

    Args:
        scene: The scene.

    Returns:
        One piece per triangle.
    """
    t = tables(scene)
    corners = np.broadcast_to(WHOLE, (len(t.area), 3, 2))
    return Pieces(np.arange(len(t.area)), corners, t.area, t.mesh_area)


def of_core(scene: Scene) -> Pieces:
    """Return the pieces in the scene's core; built on first use and kept with the scene.

    Args:
        scene: The scene.

    Returns:
        All triangles where the core is the whole scene.
    """
    return scene.cache.get(PIECES, lambda: _of_core(scene))


def _of_core(scene: Scene) -> Pieces:
    every = whole(scene)
    if np.array_equal(scene.core, scene.bounds):
        return every
    triangle, corners = _inside(_vertices(scene), scene.core, FINEST * scene.core_extent)
    if not len(triangle):
        return every
    share = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    area = every.area[triangle] * share
    mesh_area = np.bincount(tables(scene).mesh_of[triangle], area, len(every.mesh_area))
    return Pieces(triangle, corners, area, mesh_area)


def _vertices(scene: Scene) -> np.ndarray:
    """[T, 3, 3] places of the vertices of all triangles."""
    return np.concatenate([m.positions[m.indices].astype(np.float64) for m in scene.meshes])


def _inside(vertices: np.ndarray, box: np.ndarray, finest: float) -> tuple[np.ndarray, np.ndarray]:
    """Triangles and parts of triangles that lie in a box: number [P] and corners [P, 3, 2]."""
    triangle, corners = np.arange(len(vertices)), np.tile(WHOLE, (len(vertices), 1, 1))
    kept = []
    while len(triangle):
        v = vertices[triangle]
        place = v[:, None, 0] + np.einsum("pcw,pwx->pcx", corners, v[:, 1:] - v[:, :1])
        low, high = place.min(axis=1), place.max(axis=1)
        meets = ((low <= box[1]) & (high >= box[0])).all(axis=1)
        within = ((low >= box[0]) & (high <= box[1])).all(axis=1)
        middle = place.mean(axis=1)
        small = (high - low).max(axis=1) <= finest
        central = small & ((middle >= box[0]) & (middle <= box[1])).all(axis=1)
        take = within | central
        kept.append((triangle[take], corners[take]))
        divide = meets & ~within & ~small
        triangle = np.repeat(triangle[divide], 4)
        corners = np.einsum("qkc,pcw->pqkw", _PARTS, corners[divide]).reshape(-1, 3, 2)
    return np.concatenate([t for t, _ in kept]), np.concatenate([c for _, c in kept])
