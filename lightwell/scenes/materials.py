"""Reflectance, roughness and metalness of surface points as a viewer shows them: read from the records, in NumPy.

N points. Textures are read as a GPU reads them: row 0 at v = 0, texel centres at (i + ½) / size, sRGB decoded before
filtering, no mipmaps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.scenes.assemble_textures import LINEAR_OF_SRGB8
from lightwell.scenes.scene import DIELECTRIC_F0, Material, Scene, Texture
from lightwell.scenes.scene_cache import Derived

# Smallest reflectance; the learned radiance is divided by it.
MINIMUM_REFLECTANCE = 1e-3


def surface_lookup(
    scene: Scene, shape: np.ndarray, triangle: np.ndarray, barycentric: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evaluate the materials of surface points.

    Args:
        scene: Scene of the points.
        shape: [N] indices into ``scene.meshes``.
        triangle: [N] indices into that mesh's triangles.
        barycentric: [N, 2] weights of the triangle's second and third vertex.

    Returns:
        Reflectance [N, 3] = max(base colour + 0.04 (1 - metallic), 1e-3), roughness [N, 1] and metallic [N, 1],
        float32.
    """
    vertices = _vertices(scene)
    shape = np.asarray(shape, np.int64)
    corners = vertices.corners[vertices.first_triangle[shape] + np.asarray(triangle, np.int64)]
    b = np.asarray(barycentric, np.float32)
    weights = np.stack([1 - b[:, 0] - b[:, 1], b[:, 0], b[:, 1]], axis=1)

    def mixed(values: np.ndarray) -> np.ndarray:
        return np.einsum("nk,nkc->nc", weights, values[corners])

    color = np.empty((len(shape), 3), np.float32)
    roughness, metallic = np.empty((len(shape), 1), np.float32), np.empty((len(shape), 1), np.float32)
    uvs, vertex_color, index = (
        (mixed(vertices.uv0), mixed(vertices.uv1)),
        mixed(vertices.colors),
        vertices.material[shape],
    )
    for i in np.unique(index):
        rows = np.flatnonzero(index == i)
        here = uvs[0][rows], uvs[1][rows]
        color[rows], roughness[rows], metallic[rows] = _material(scene.materials[i], here)
    color *= vertex_color
    reflectance = np.maximum(color + DIELECTRIC_F0 * (1 - metallic), MINIMUM_REFLECTANCE)
    return reflectance, roughness, metallic


def _material(
    material: Material, uvs: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray | np.float32, np.ndarray | np.float32]:
    """Evaluate base colour [N, 3], roughness [N, 1] and metallic [N, 1] without vertex colours."""
    color = np.array(material.base_color[:3], np.float32)
    roughness, metallic = np.float32(material.roughness), np.float32(material.metallic)
    if (texture := material.base_color_texture) is not None:
        color = color * sampled(texture, uvs, linear=False)[:, :3]
    if (texture := material.metallic_roughness_texture) is not None:
        texels = sampled(texture, uvs, linear=True)
        roughness, metallic = roughness * texels[:, 1:2], metallic * texels[:, 2:3]
    return color, roughness, metallic


def sampled(texture: Texture, uvs: tuple[np.ndarray, np.ndarray], *, linear: bool) -> np.ndarray:
    """Read a texture, filtered and decoded to linear values.

    Args:
        texture: Texture with its transform, wrap mode and filter.
        uvs: [N, 2] coordinates of each set.
        linear: The stored values are linear, not sRGB-encoded.

    Returns:
        [N, 3] float32 linear values.
    """
    pixels = texture.image.pixels
    decode = np.arange(256, dtype=np.float32) / np.float32(255) if linear else LINEAR_OF_SRGB8
    uv = uvs[min(texture.uv_set, 1)].astype(np.float64)
    if texture.transform is not None:
        matrix = np.asarray(texture.transform, np.float64)
        uv = uv @ matrix[:2, :2].T + matrix[:2, 2]
    height, width = pixels.shape[:2]
    place = uv * (width, height)
    if texture.nearest:
        column, row = (_wrapped(np.floor(place[:, k]), n, texture.wrap[k]) for k, n in enumerate((width, height)))
        return decode[pixels[row, column, :3]]
    low = np.floor(place - 0.5)
    t = (place - 0.5 - low).astype(np.float32)
    columns = [_wrapped(low[:, 0] + d, width, texture.wrap[0]) for d in (0, 1)]
    rows = [_wrapped(low[:, 1] + d, height, texture.wrap[1]) for d in (0, 1)]
    upper, lower = (
        _mix(decode[pixels[row, columns[0], :3]], decode[pixels[row, columns[1], :3]], t[:, :1]) for row in rows
    )
    return _mix(upper, lower, t[:, 1:])


def _mix(a: np.ndarray, b: np.ndarray, t: np.ndarray) -> np.ndarray:
    return a + (b - a) * t


def _wrapped(index: np.ndarray, size: int, wrap: str) -> np.ndarray:
    """Wrap whole numbers to texel indices 0 … size-1, int64."""
    index = np.clip(index, -(2.0**52), 2.0**52).astype(np.int64)
    if wrap == "clamp":
        return np.clip(index, 0, size - 1)
    if wrap == "mirror":
        index = index % (2 * size)
        return np.where(index < size, index, 2 * size - 1 - index)
    return index % size


@dataclass(frozen=True)
class _Vertices:
    """Concatenated meshes of a scene. V vertices, T triangles, M meshes."""

    corners: np.ndarray
    """[T, 3] int64, indices into the vertex arrays."""
    first_triangle: np.ndarray
    """[M] int64."""
    material: np.ndarray
    """[M] int64."""
    uv0: np.ndarray
    """[V, 2]; 0 where a mesh has none."""
    uv1: np.ndarray
    colors: np.ndarray
    """[V, 3]; 1 where a mesh has none."""


VERTICES = Derived[_Vertices]("scenes.vertices")


def _vertices(scene: Scene) -> _Vertices:
    """Return the concatenated meshes, kept in the scene's cache."""
    return scene.cache.get(VERTICES, lambda: _concatenated(scene))


def _concatenated(scene: Scene) -> _Vertices:
    meshes = scene.meshes
    first_vertex = np.cumsum([0] + [len(m.positions) for m in meshes[:-1]])

    def joined(name: str, width: int, default: float) -> np.ndarray:
        parts = (getattr(m, name) for m in meshes)
        missing = (np.full((len(m.positions), width), default, np.float32) for m in meshes)
        return np.concatenate([d if p is None else p[:, :width] for p, d in zip(parts, missing)])

    return _Vertices(
        corners=np.concatenate([m.indices.astype(np.int64) + first for m, first in zip(meshes, first_vertex)]),
        first_triangle=np.cumsum([0] + [len(m.indices) for m in meshes[:-1]]),
        material=np.array([m.material for m in meshes]),
        uv0=joined("uv0", 2, 0.0),
        uv1=joined("uv1", 2, 0.0),
        colors=joined("colors", 3, 1.0),
    )
