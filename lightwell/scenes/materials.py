"""Reflectance, roughness and metalness of surface points as a viewer shows them: read from the records, in NumPy.

N points. Textures are read as a GPU reads them: row 0 at v = 0, texel centres at (i + ½) / size, sRGB decoded before
filtering, no mipmaps.
"""

from __future__ import annotations

import numpy as np

from lightwell.scenes.assemble_textures import LINEAR_OF_SRGB8
from lightwell.scenes.corners import Corners, Vertices
from lightwell.scenes.scene import DIELECTRIC_F0, Material, Scene, Texture

# Smallest reflectance by which a learned value is multiplied (format/FORMAT.md).
MINIMUM_REFLECTANCE = 1e-3


def surface_lookup(
    scene: Scene, vertices: Vertices, shape: np.ndarray, corners: Corners
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evaluate the materials of surface points.

    Args:
        scene: Scene of the points.
        vertices: Its vertices.
        shape: [N] indices into ``scene.meshes``.
        corners: Corners of the points.

    Returns:
        Reflectance [3, N] = max(base colour + 0.04 (1 - metallic), 1e-3), roughness [N] and metallic [N], float32.
    """
    color = np.empty((3, len(shape)), np.float32)
    roughness, metallic = np.empty((2, len(shape)), np.float32)
    index = vertices.material[shape]
    for i in np.unique(index):
        rows = np.flatnonzero(index == i)
        color[:, rows], roughness[rows], metallic[rows] = _material(scene.materials[i], vertices, corners[rows])
    color *= corners.between(corners.values(vertices.colors)).astype(np.float32)
    reflectance = np.maximum(color + DIELECTRIC_F0 * (1 - metallic), MINIMUM_REFLECTANCE)
    return reflectance, roughness, metallic


def _material(
    material: Material, vertices: Vertices, corners: Corners
) -> tuple[np.ndarray, np.ndarray | np.float32, np.ndarray | np.float32]:
    """Evaluate base colour [3, N], roughness [N] and metallic [N] without vertex colours."""
    color = np.array(material.base_color[:3], np.float32)[:, None]
    roughness, metallic = np.float32(material.roughness), np.float32(material.metallic)
    if (texture := material.base_color_texture) is not None:
        color = color * sampled(texture, _coordinates(texture, vertices, corners), linear=False)
    if (texture := material.metallic_roughness_texture) is not None:
        texels = sampled(texture, _coordinates(texture, vertices, corners), linear=True)
        roughness, metallic = roughness * texels[1], metallic * texels[2]
    return color, roughness, metallic


def _coordinates(texture: Texture, vertices: Vertices, corners: Corners) -> np.ndarray:
    """Texture coordinates [2, N] of points."""
    return corners.between(corners.values(vertices.uv1 if texture.uv_set else vertices.uv0))


def sampled(texture: Texture, uv: np.ndarray, *, linear: bool) -> np.ndarray:
    """Read a texture, filtered and decoded to linear values.

    Args:
        texture: Texture with its transform, wrap mode and filter.
        uv: [2, N] coordinates of its set.
        linear: The stored values are linear, not sRGB-encoded.

    Returns:
        [3, N] float32 linear values.
    """
    pixels = texture.image.pixels
    decode = np.arange(256, dtype=np.float32) / np.float32(255) if linear else LINEAR_OF_SRGB8
    height, width = pixels.shape[:2]
    # The four bytes of a texel are read as one number.
    texels = np.ascontiguousarray(pixels).view(np.uint32).ravel()

    def read(row: np.ndarray, column: np.ndarray) -> list[np.ndarray]:
        found = np.take(texels, row * width + column, mode="clip").view(np.uint8).reshape(-1, 4)
        return [np.take(decode, found[:, channel]) for channel in range(3)]

    u, v = np.asarray(uv, np.float64)
    if texture.transform is not None:
        (a, b, c), (d, e, f) = np.asarray(texture.transform, np.float64)[:2]
        u, v = a * u + b * v + c, d * u + e * v + f
    x, y = u * width, v * height
    if texture.nearest:
        place = _wrapped(np.floor(y), height, texture.wrap[1]), _wrapped(np.floor(x), width, texture.wrap[0])
        return np.stack(read(*place))
    left, top = np.floor(x - 0.5), np.floor(y - 0.5)
    s, t = (x - 0.5 - left).astype(np.float32), (y - 0.5 - top).astype(np.float32)
    columns = [_wrapped(left + d, width, texture.wrap[0]) for d in (0, 1)]
    rows = [_wrapped(top + d, height, texture.wrap[1]) for d in (0, 1)]
    upper, lower = ([_mix(a, b, s) for a, b in zip(*(read(row, column) for column in columns))] for row in rows)
    return np.stack([_mix(a, b, t) for a, b in zip(upper, lower)])


def _mix(a: np.ndarray, b: np.ndarray, t: np.ndarray) -> np.ndarray:
    return a + (b - a) * t


def _wrapped(index: np.ndarray, size: int, wrap: str) -> np.ndarray:
    """Wrap whole numbers to texel indices 0 … size-1, int64.

    They are wrapped as float64, which is several times as fast as by integers, and exact up to 2^52.
    """
    index = np.clip(index, -(2.0**52), 2.0**52)
    if wrap == "clamp":
        index = np.clip(index, 0, size - 1)
    elif wrap == "mirror":
        index = index - 2 * size * np.floor(index / (2 * size))
        index = np.where(index < size, index, 2 * size - 1 - index)
    else:
        index = index - size * np.floor(index / size)
    return index.astype(np.int64)
