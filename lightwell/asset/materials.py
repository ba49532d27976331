"""Converts the material records of a scene to glTF materials, textures, samplers and images."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, Any

from lightwell.asset.container import Binary

if TYPE_CHECKING:
    from lightwell.scenes.scene import Image, Material, Texture

# glTF sampler constants (section 5.26).
WRAPS = {"repeat": 10497, "mirror": 33648, "clamp": 33071}
NEAREST, LINEAR, LINEAR_MIPMAP_LINEAR = 9728, 9729, 9987
# Index of refraction that glTF assumes when KHR_materials_ior is absent.
DEFAULT_IOR = 1.5
# Scene records have no sheen roughness; the middle of its range gives a wide lobe, like Mitsuba's sheen.
SHEEN_ROUGHNESS = 0.5
# A texture transform further than this from scale, then rotation, then offset cannot be written exactly.
TRANSFORM_TOLERANCE = 1e-5


class MaterialTable:
    """The glTF tables ``materials``, ``textures``, ``samplers`` and ``images``; equal entries are written once."""

    def __init__(self, binary: Binary) -> None:
        """Create empty tables.

        Args:
            binary: Receives the bytes of the images.
        """
        self.materials: list[dict[str, Any]] = []
        self.textures: list[dict[str, Any]] = []
        self.samplers: list[dict[str, Any]] = []
        self.images: list[dict[str, Any]] = []
        self.extensions: set[str] = set()
        self._binary = binary
        self._image_of: dict[tuple[str, bytes], int] = {}

    def add(self, material: Material) -> int:
        """Append a material with its textures.

        Args:
            material: Material of the scene.

        Returns:
            Index of the glTF material.
        """
        entry: dict[str, Any] = {"name": material.name, "pbrMetallicRoughness": self._metallic_roughness(material)}
        if material.normal_texture is not None:
            entry["normalTexture"] = self._texture_info(material.normal_texture)
            if material.normal_scale != 1:
                entry["normalTexture"]["scale"] = material.normal_scale
        # What is unlit in the scene's file was lit by the path tracer: viewers must light it too.
        extensions = _lobes(material)
        strength = self._add_emission(entry, material)
        if strength > 1:
            extensions["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
        _add_coverage(entry, material)
        if extensions:
            entry["extensions"] = extensions
            self.extensions.update(extensions)
        self.materials.append(entry)
        return len(self.materials) - 1

    def _metallic_roughness(self, material: Material) -> dict[str, Any]:
        entry: dict[str, Any] = {
            "baseColorFactor": [_unit(c) for c in material.base_color],
            "metallicFactor": _unit(material.metallic),
            "roughnessFactor": _unit(material.roughness),
        }
        if material.base_color_texture is not None:
            entry["baseColorTexture"] = self._texture_info(material.base_color_texture)
        if material.metallic_roughness_texture is not None:
            entry["metallicRoughnessTexture"] = self._texture_info(material.metallic_roughness_texture)
        return entry

    def _add_emission(self, entry: dict[str, Any], material: Material) -> float:
        """Write the emission with its factor in [0, 1]; return the strength to multiply it with."""
        strength = max(1.0, *material.emissive)
        if max(material.emissive) > 0 and not material.unlit:
            entry["emissiveFactor"] = [_unit(c / strength) for c in material.emissive]
            if material.emissive_texture is not None:
                entry["emissiveTexture"] = self._texture_info(material.emissive_texture)
            return strength
        return 1.0

    def _texture_info(self, texture: Texture) -> dict[str, Any]:
        source = {"sampler": self._sampler(texture), "source": self._image(texture.image)}
        info: dict[str, Any] = {"index": _index_of(self.textures, source)}
        if texture.uv_set:
            info["texCoord"] = texture.uv_set
        if texture.transform is not None:
            info["extensions"] = {"KHR_texture_transform": texture_transform(texture.transform)}
            self.extensions.add("KHR_texture_transform")
        return info

    def _sampler(self, texture: Texture) -> int:
        sampler = {
            "magFilter": NEAREST if texture.nearest else LINEAR,
            "minFilter": NEAREST if texture.nearest else LINEAR_MIPMAP_LINEAR,
            "wrapS": WRAPS[texture.wrap[0]],
            "wrapT": WRAPS[texture.wrap[1]],
        }
        return _index_of(self.samplers, sampler)

    def _image(self, image: Image) -> int:
        key = (image.mime, image.data)
        if key not in self._image_of:
            entry = {"bufferView": self._binary.add_view(image.data), "mimeType": image.mime}
            self.images.append({**entry, "name": image.name} if image.name else entry)
            self._image_of[key] = len(self.images) - 1
        return self._image_of[key]


def uv_sets(material: Material) -> set[int]:
    """Return the texture coordinate sets that a material reads.

    Args:
        material: Material of the scene.

    Returns:
        Indices of the sets: 0 for TEXCOORD_0, 1 for TEXCOORD_1.
    """
    textures = (
        material.base_color_texture,
        material.metallic_roughness_texture,
        material.normal_texture,
        material.emissive_texture,
    )
    return {t.uv_set for t in textures if t is not None}


def texture_transform(matrix: tuple[tuple[float, ...], ...]) -> dict[str, Any]:
    """Convert a texture matrix to KHR_texture_transform.

    The extension's matrix is [[cx, sy, ou], [-sx, cy, ov], [0, 0, 1]] with cx = cos r · scale_u, and so on. A sheared
    matrix has no such form: the nearest one is returned, with a warning.

    Args:
        matrix: 3x3 matrix that acts on (u, v, 1), row by row.

    Returns:
        The extension's ``offset``, ``scale`` and ``rotation`` (radians, left out when it is 0).
    """
    (a, b, offset_u), (c, d, offset_v) = (row[:3] for row in matrix[:2])
    rotation = math.atan2(-c, a) if a or c else math.atan2(b, d)
    cosine, sine = math.cos(rotation), math.sin(rotation)
    scale_u, scale_v = a * cosine - c * sine, b * sine + d * cosine
    shear = max(abs(b - sine * scale_v), abs(d - cosine * scale_v))
    if shear > TRANSFORM_TOLERANCE * max(1.0, abs(scale_v)):
        warnings.warn(
            f"asset: a texture transform is sheared by {shear:.3g}; glTF keeps its nearest form", stacklevel=2
        )
    transform: dict[str, Any] = {"offset": [offset_u, offset_v], "scale": [scale_u, scale_v]}
    return {**transform, "rotation": rotation} if rotation else transform


def _lobes(material: Material) -> dict[str, Any]:
    """The material extensions that are not at their defaults."""
    extensions: dict[str, Any] = {}
    if material.transmission > 0:
        extensions["KHR_materials_transmission"] = {"transmissionFactor": _unit(material.transmission)}
    if material.transmission > 0 and material.thickness > 0:
        extensions["KHR_materials_volume"] = {"thicknessFactor": float(material.thickness)}
    if material.ior != DEFAULT_IOR and material.ior >= 1:
        extensions["KHR_materials_ior"] = {"ior": material.ior}
    if material.clearcoat > 0:
        extensions["KHR_materials_clearcoat"] = {
            "clearcoatFactor": _unit(material.clearcoat),
            "clearcoatRoughnessFactor": _unit(material.clearcoat_roughness),
        }
    if material.sheen > 0:
        extensions["KHR_materials_sheen"] = {
            "sheenColorFactor": [_unit(material.sheen)] * 3,
            "sheenRoughnessFactor": SHEEN_ROUGHNESS,
        }
    return extensions


def _add_coverage(entry: dict[str, Any], material: Material) -> None:
    if material.alpha_mode != "OPAQUE":
        entry["alphaMode"] = material.alpha_mode
    if material.alpha_mode == "MASK":
        entry["alphaCutoff"] = material.alpha_cutoff
    if material.double_sided:
        entry["doubleSided"] = True


def _index_of(table: list[dict[str, Any]], entry: dict[str, Any]) -> int:
    """Index of ``entry`` in ``table``, appended when new."""
    if entry not in table:
        table.append(entry)
    return table.index(entry)


def _unit(value: float) -> float:
    return min(max(float(value), 0.0), 1.0)
