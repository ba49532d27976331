"""The triangles of points: what their corners carry, and what lies between the corners, in NumPy.

N points. Arrays are [C, N], a row for each component: sums over the components of a vector are then sums of whole rows,
which is several times as fast as over the last axis of [N, C].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived


@dataclass(frozen=True)
class Vertices:
    """Concatenated meshes of a scene. V vertices, T triangles, M meshes."""

    corners: np.ndarray
    """[T, 3] int64, indices into the vertex arrays."""
    first_triangle: np.ndarray
    """[M] int64."""
    material: np.ndarray
    """[M] int64."""
    positions: np.ndarray
    """[V, 3] float32, metres."""
    normals: np.ndarray
    """[V, 3] float32; 0 where a mesh has none."""
    uv0: np.ndarray
    """[V, 2]; 0 where a mesh has none."""
    uv1: np.ndarray
    colors: np.ndarray
    """[V, 3]; 1 where a mesh has none."""


VERTICES = Derived[Vertices]("scenes.vertices")


def vertices_of(scene: Scene) -> Vertices:
    """Concatenate the meshes of a scene; the result is kept in its cache.

    Args:
        scene: Scene with M meshes.

    Returns:
        Their vertices.
    """
    return scene.cache.get(VERTICES, lambda: _concatenated(scene))


def _concatenated(scene: Scene) -> Vertices:
    meshes = scene.meshes
    first_vertex = np.cumsum([0] + [len(m.positions) for m in meshes[:-1]])

    def joined(name: str, width: int, default: float) -> np.ndarray:
        parts = (getattr(m, name) for m in meshes)
        missing = (np.full((len(m.positions), width), default, np.float32) for m in meshes)
        return np.concatenate([d if p is None else p[:, :width] for p, d in zip(parts, missing)])

    return Vertices(
        corners=np.concatenate([m.indices.astype(np.int64) + first for m, first in zip(meshes, first_vertex)]),
        first_triangle=np.cumsum([0] + [len(m.indices) for m in meshes[:-1]]),
        material=np.array([m.material for m in meshes]),
        positions=joined("positions", 3, 0.0),
        normals=joined("normals", 3, 0.0),
        uv0=joined("uv0", 2, 0.0),
        uv1=joined("uv1", 2, 0.0),
        colors=joined("colors", 3, 1.0),
    )


@dataclass(frozen=True)
class Corners:
    """The corners of the triangles of N points."""

    index: tuple[np.ndarray, np.ndarray, np.ndarray]
    """Vertices, [N] each."""
    weights: tuple[np.ndarray, np.ndarray, np.ndarray]
    """Barycentric weights, [N] float64 each."""

    @staticmethod
    def of(vertices: Vertices, shape: np.ndarray, triangle: np.ndarray, barycentric: np.ndarray) -> Corners:
        """Find the corners of points.

        Args:
            vertices: Those of the scene.
            shape: [N] indices of meshes.
            triangle: [N] indices of triangles of that mesh.
            barycentric: [N, 2] weights of the triangle's second and third vertex.

        Returns:
            The corners.
        """
        found = np.take(vertices.corners, vertices.first_triangle[shape] + np.asarray(triangle, np.int64), axis=0)
        a, b, c = np.ascontiguousarray(found.T)
        b1, b2 = np.ascontiguousarray(np.asarray(barycentric).T, np.float64)
        return Corners((a, b, c), (1 - b1 - b2, b1, b2))

    def __getitem__(self, rows: np.ndarray) -> Corners:
        (a, b, c), (u, v, w) = self.index, self.weights
        return Corners((a[rows], b[rows], c[rows]), (u[rows], v[rows], w[rows]))

    def values(self, table: np.ndarray) -> list[np.ndarray]:
        """Read what the vertices carry.

        Args:
            table: [V, C] numbers of each vertex.

        Returns:
            Those of the first, second and third corner, [C, N] float64 each.
        """
        return [np.take(table, i, axis=0).T.astype(np.float64, order="C") for i in self.index]

    def between(self, values: list[np.ndarray]) -> np.ndarray:
        """Interpolate linearly between the corners.

        Args:
            values: [C, N] numbers of each corner.

        Returns:
            [C, N] float64 numbers at the points.
        """
        (a, b, c), (u, v, w) = values, self.weights
        return a * u + b * v + c * w


def dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compute dot products of columns.

    Args:
        a: [3, N] vectors.
        b: [3, N] vectors.

    Returns:
        [N] products.
    """
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def crosses(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compute cross products of columns.

    Args:
        a: [3, N] vectors.
        b: [3, N] vectors.

    Returns:
        [3, N] products.
    """
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def lengths(v: np.ndarray) -> np.ndarray:
    """Compute the lengths of columns.

    Args:
        v: [3, N] vectors.

    Returns:
        [N] lengths.
    """
    return np.sqrt(dots(v, v))
