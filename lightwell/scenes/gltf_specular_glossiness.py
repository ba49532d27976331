"""KHR_materials_pbrSpecularGlossiness as metallic-roughness.

Factors alone are one material, metal or not. Where a picture says specular colour and glossiness, each texel is
converted as Khronos' own converter does (KHR_materials_pbrSpecularGlossiness, examples/convert-between-workflows): the
metalness at which a metallic-roughness material reflects as much.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from PIL import Image as PillowImage

from lightwell.core.color import srgb_bytes
from lightwell.scenes.assemble_textures import LINEAR_OF_SRGB8
from lightwell.scenes.gltf_images import Textures
from lightwell.scenes.gltf_json import Place
from lightwell.scenes.scene import DIELECTRIC_F0, Image, Material, Texture

# Reflectance at normal incidence above which a material without a picture counts as metal.
METAL_F0 = 0.25
# Weights of red, green and blue in the perceived brightness of the converter.
BRIGHTNESS = (0.299, 0.587, 0.114)
# Metalness below which a texel counts as none, and rows that are converted at once.
LEAST_METAL, ROWS = 0.05, 256
TINY = 1e-6


def converted(glossy: Place, material: Material, textures: Textures) -> Material:
    """Convert the extension's properties.

    Args:
        glossy: The extension's object.
        material: Record whose base colour, metalness and roughness are replaced.
        textures: Textures of the file.

    Returns:
        The record.
    """
    diffuse = glossy.numbers("diffuseFactor", 4, (1.0, 1.0, 1.0, 1.0))
    specular = glossy.numbers("specularFactor", 3, (1.0, 1.0, 1.0))
    glossiness = _unit(glossy.number("glossinessFactor", 1.0))
    texture, shine = textures.read(glossy, "diffuseTexture"), textures.read(glossy, "specularGlossinessTexture")
    red, green, blue, alpha = map(_unit, diffuse)
    material = replace(
        material,
        base_color=(red, green, blue, alpha),
        base_color_texture=texture,
        metallic=0.0,
        roughness=1.0 - glossiness,
        metallic_roughness_texture=None,
    )
    if shine is not None:
        return _by_texel(material, shine, np.array(specular, np.float32).clip(0, 1), glossiness, textures)
    if "specularGlossinessTexture" not in glossy and max(specular) > METAL_F0 and max(specular) > max(diffuse[:3]):
        red, green, blue = map(_unit, specular)
        return replace(material, base_color=(red, green, blue, alpha), base_color_texture=None, metallic=1.0)
    return material


def _unit(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def _by_texel(
    material: Material, shine: Texture, specular: np.ndarray, glossiness: float, textures: Textures
) -> Material:
    """Convert a material whose specular colour and glossiness are a picture."""
    texture, factor = material.base_color_texture, np.array(material.base_color[:3], np.float32)
    same = texture is None or _layout(texture) == _layout(shine)
    pictures = id(texture.image) if texture is not None and same else 0, id(shine.image), same
    key = (*pictures, *factor.tolist(), *specular.tolist(), glossiness)

    def rough() -> np.ndarray:
        made = np.empty((*shine.image.pixels.shape[:2], 3), np.uint8)
        for rows, gloss, dark, bright in _blocks(material, shine, specular, made.shape[:2]):
            made[rows, :, 0] = 255
            made[rows, :, 1] = np.round(255 * (1 - glossiness * gloss))
            # Where the pictures do not lie on each other, nobody knows which diffuse colour belongs to a texel.
            made[rows, :, 2] = np.round(255 * _metalness(dark, bright)) if same else 0
        return made

    roughness = textures.made(("roughness", *key), shine.image.name, rough)
    material = replace(
        material, metallic=1.0, roughness=1.0, metallic_roughness_texture=replace(shine, image=roughness)
    )
    if roughness.pixels[..., 2].max() < 255 * LEAST_METAL:
        return material

    def color() -> np.ndarray:
        size = (texture or shine).image.pixels.shape[:2]
        made = np.full((*size, 4), 255, np.uint8)
        if texture is not None:
            made[..., 3] = texture.image.pixels[..., 3]
        for rows, _, dark, bright in _blocks(material, shine, specular, size):
            made[rows, :, :3] = srgb_bytes(_base_color(dark, bright))
        return made

    image = textures.made(("color", *key), (texture or shine).image.name, color)
    white = (1.0, 1.0, 1.0, material.base_color[3])
    return replace(material, base_color=white, base_color_texture=replace(texture or shine, image=image))


def _layout(texture: Texture) -> tuple[object, ...]:
    return texture.wrap, texture.uv_set, texture.transform


def _blocks(
    material: Material, shine: Texture, specular: np.ndarray, size: tuple[int, int]
) -> Iterator[tuple[slice, np.ndarray, np.ndarray, np.ndarray]]:
    """Iterate over blocks of rows of a picture of ``size``: rows, glossiness [R, W], linear diffuse and specular colour
    [R, W, 3]."""
    factor = np.array(material.base_color[:3], np.float32)
    gloss = _resized(shine.image, size)
    base = _resized(material.base_color_texture.image, size) if material.base_color_texture else None
    for first in range(0, size[0], ROWS):
        rows = slice(first, min(first + ROWS, size[0]))
        bright = LINEAR_OF_SRGB8[gloss[rows, :, :3]] * specular
        dark = np.broadcast_to(factor, bright.shape) if base is None else LINEAR_OF_SRGB8[base[rows, :, :3]] * factor
        yield rows, gloss[rows, :, 3].astype(np.float32) / 255, dark, bright


def _resized(image: Image, size: tuple[int, int]) -> np.ndarray:
    """[H, W, 4] pixels of an image at another size, each channel by itself: alpha is no coverage here."""
    if image.pixels.shape[:2] == size:
        return image.pixels
    bands = [PillowImage.fromarray(np.ascontiguousarray(image.pixels[..., k])) for k in range(4)]
    return np.stack([np.asarray(band.resize(size[::-1], PillowImage.Resampling.BILINEAR)) for band in bands], axis=-1)


def _brightness(color: np.ndarray) -> np.ndarray:
    return np.sqrt((color**2 * np.array(BRIGHTNESS, np.float32)).sum(axis=-1))


def _metalness(diffuse: np.ndarray, specular: np.ndarray) -> np.ndarray:
    """Metalness [...] of linear diffuse and specular colours [..., 3]: the root of the converter's equation."""
    light, shine = _brightness(diffuse), _brightness(specular)
    strength = 1 - specular.max(axis=-1)
    a = DIELECTRIC_F0
    b = light * strength / (1 - DIELECTRIC_F0) + shine - 2 * DIELECTRIC_F0
    c = DIELECTRIC_F0 - shine
    root = (-b + np.sqrt(np.maximum(b * b - 4 * a * c, 0))) / (2 * a)
    return np.where(shine < DIELECTRIC_F0, 0, root.clip(0, 1))


def _base_color(diffuse: np.ndarray, specular: np.ndarray) -> np.ndarray:
    """Base colour [..., 3] of linear diffuse and specular colours."""
    metal = _metalness(diffuse, specular)[..., None]
    strength = 1 - specular.max(axis=-1, keepdims=True)
    of_diffuse = diffuse * strength / (1 - DIELECTRIC_F0) / np.maximum(1 - metal, TINY)
    of_specular = (specular - DIELECTRIC_F0 * (1 - metal)) / np.maximum(metal, TINY)
    return (of_diffuse + (of_specular - of_diffuse) * metal**2).clip(0, 1)
