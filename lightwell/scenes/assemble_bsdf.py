"""Materials of the records as Mitsuba BSDFs.

* Opaque materials become ``twosided`` ``principled``: both sides reflect, whether or not the material is
  ``double_sided``. Back-face culling is a rasteriser's optimisation; a wall that transmits light through its back would
  leak.
* Transmission becomes ``principledthin`` (glTF without a volume is infinitely thin) or, with a thickness, a solid
  ``principled`` with ``spec_trans``; neither is two-sided.
* ``principled`` squares its roughness as glTF does, so roughness is passed unchanged.
* MASK and BLEND become ``mask``; MASK compares texel by texel, without filtering between them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.scenes.assemble_textures import bitmap, linear_pixels, raw_pixels
from lightwell.scenes.scene import Material, Texture

# Range of the clearcoat's microfacet alpha in Mitsuba's principled BSDF: gloss 0 is the first, gloss 1 the second.
CLEARCOAT_ALPHA = (0.1, 0.001)
# Mitsuba's principled BSDF refuses an index of refraction of 1.
MINIMUM_IOR = 1.001


def uv_set(material: Material) -> int:
    """Select the texture coordinate set that the path tracer uses for a material; Mitsuba has one per mesh.

    Args:
        material: Material to inspect.

    Returns:
        Number of the set, 0 or 1.
    """
    used = [t.uv_set for t in textures(material)]
    return used[0] if used else 0


def textures(material: Material) -> list[Texture]:
    """List the textures of a material, base colour first.

    Args:
        material: Material to inspect.

    Returns:
        Its textures.
    """
    every = (
        material.base_color_texture,
        material.emissive_texture,
        material.metallic_roughness_texture,
        material.normal_texture,
    )
    return [t for t in every if t is not None]


class Bsdfs:
    """Builds each BSDF once and shares it between the meshes that use it."""

    def __init__(self, materials: list[Material], warn: Callable[[str], None]) -> None:
        """Prepare the BSDFs of a scene.

        Args:
            materials: Materials by index.
            warn: Called with each property that Mitsuba cannot represent.
        """
        self._materials = materials
        self._warn = warn
        self._built: dict[tuple[Any, ...], Any] = {}
        # One Mitsuba texture per (image, layout, use).
        self._textures: dict[tuple[Any, ...], Any] = {}

    def __call__(self, index: int, *, colors: bool, alpha: bool, relief: bool, mirrored: bool) -> Any:
        """Return the BSDF of material ``index`` for a mesh.

        ``colors``, ``alpha``: the mesh has the attributes ``vertex_color``, ``vertex_alpha``; ``relief``: it has
        texture coordinates, without which a normal map has no directions; ``mirrored``: its texture is mirrored.
        """
        material = self._materials[index]
        if not relief:
            material = replace(material, normal_texture=None)
        relief = material.normal_texture is not None
        key = (index, colors, alpha, relief, mirrored and relief)
        if key not in self._built:
            if not any(built[0] == index for built in self._built):
                self._warn_of(material)
            self._built[key] = self._build(material, colors, alpha, mirrored)
        return self._built[key]

    def _warn_of(self, material: Material) -> None:
        name, used = material.name, textures(material)
        if any(t.wrap[0] != t.wrap[1] for t in used):
            self._warn(f"material '{name}': different wrap modes in u and v; the path tracer uses that of u for both")
        if len({t.uv_set for t in used}) > 1:
            self._warn(
                f"material '{name}': textures use several UV sets; the path tracer uses set {uv_set(material)} for all"
            )
        if material.unlit:
            self._warn(f"material '{name}': unlit; the path tracer treats it as an ordinary lit surface")

    def _build(self, material: Material, colors: bool, alpha: bool, mirrored: bool) -> Any:
        transmissive = material.transmission > 0
        thin = transmissive and material.thickness == 0
        bsdf = mi.load_dict(self._thin(material, colors) if thin else self._solid(material, colors))
        if material.normal_texture is not None:
            relief = self._normal(material.normal_texture, material.normal_scale, mirrored)
            bsdf = mi.load_dict({"type": "normalmap", "normalmap": relief, "nested": bsdf})
        if not transmissive:
            bsdf = mi.load_dict({"type": "twosided", "nested": bsdf})
        if (opacity := self._opacity(material, alpha)) is not None:
            bsdf = mi.load_dict({"type": "mask", "opacity": opacity, "nested": bsdf})
        return bsdf

    def _solid(self, material: Material, colors: bool) -> dict[str, Any]:
        roughness, metallic = self._roughness_metallic(material)
        first, last = CLEARCOAT_ALPHA
        gloss = (first - material.clearcoat_roughness**2) / (first - last)
        description = {
            "type": "principled",
            "base_color": self._base_color(material, colors),
            "roughness": roughness,
            "metallic": metallic,
            "eta": max(material.ior, MINIMUM_IOR),
            "spec_tint": material.specular_tint,
            "sheen": min(material.sheen, 1.0),
            "clearcoat": min(material.clearcoat, 1.0),
            "clearcoat_gloss": float(np.clip(gloss, 0.0, 1.0)),
        }
        if material.transmission > 0:
            description["spec_trans"] = min(material.transmission, 1.0)
        return description

    def _thin(self, material: Material, colors: bool) -> dict[str, Any]:
        roughness, _ = self._roughness_metallic(material)
        return {
            "type": "principledthin",
            "base_color": self._base_color(material, colors),
            "roughness": roughness,
            "eta": max(material.ior, MINIMUM_IOR),
            "spec_trans": min(material.transmission, 1.0),
            "spec_tint": material.specular_tint,
            "sheen": min(material.sheen, 1.0),
        }

    def _base_color(self, material: Material, colors: bool) -> Any:
        factor = np.clip(np.array(material.base_color[:3], np.float32), 0, 1)
        texture = material.base_color_texture
        if texture is None and not colors:
            return {"type": "rgb", "value": factor.tolist()}
        if texture is None:
            return {"type": "mesh_attribute", "name": "vertex_color"}
        picture = self._shared(texture, ("color", *factor.tolist()), lambda: linear_pixels(texture.image, factor))
        if not colors:
            return picture
        vertex = {"type": "mesh_attribute", "name": "vertex_color"}
        return {"type": "lightwell_product", "a": picture, "b": vertex}

    def _roughness_metallic(self, material: Material) -> tuple[Any, Any]:
        texture = material.metallic_roughness_texture
        if texture is None:
            return material.roughness, material.metallic

        def one(name: str, channel: slice) -> Any:
            factor = getattr(material, name)
            return self._shared(texture, (name, factor), lambda: raw_pixels(texture.image, channel, factor))

        return one("roughness", slice(1, 2)), one("metallic", slice(2, 3))

    def _normal(self, texture: Texture, scale: float, mirrored: bool) -> Any:
        # Mitsuba's shading frame is right-handed, so the second axis is reversed where the texture is mirrored.
        across = np.array([scale, -scale if mirrored else scale, 1], np.float32)

        def pixels() -> np.ndarray:
            vectors = (raw_pixels(texture.image).astype(np.float32) * 2 - 1) * across
            length = np.linalg.norm(vectors, axis=-1, keepdims=True)
            vectors = np.where(length > 1e-6, vectors / np.maximum(length, 1e-6), np.array([0, 0, 1], np.float32))
            return vectors * 0.5 + 0.5

        return self._shared(texture, ("normal", scale, mirrored), pixels)

    def _opacity(self, material: Material, alpha: bool) -> Any:
        """Opacity of a material, times that of the vertices where they have one; None where all is opaque."""
        if material.alpha_mode == "OPAQUE":
            return None
        if material.alpha_mode == "MASK" and alpha:
            # The cutoff is that of the product.
            product = _with_vertices(self._alpha(material, masked=False))
            return {"type": "lightwell_cutoff", "a": product, "cutoff": material.alpha_cutoff}
        opacity = self._alpha(material, masked=material.alpha_mode == "MASK")
        return _with_vertices(opacity) if alpha else opacity

    def _alpha(self, material: Material, masked: bool) -> Any:
        """Alpha of the material, 0 or 1 where it is masked; None where all is opaque."""
        texture, factor = material.base_color_texture, material.base_color[3]

        def opacity(alpha: np.ndarray) -> np.ndarray:
            alpha = alpha * factor
            return (alpha >= material.alpha_cutoff).astype(np.float32) if masked else np.clip(alpha, 0, 1)

        if texture is None:
            value = float(opacity(np.float32(1)))
            return None if value == 1 else value
        use = ("opacity", factor, material.alpha_cutoff if masked else None)
        if self._key(texture, use) not in self._textures:
            pixels = opacity(raw_pixels(texture.image, slice(3, 4)).astype(np.float32))
            made = None if pixels.min() == 1 else bitmap(pixels, texture, nearest=masked or texture.nearest)
            self._textures[self._key(texture, use)] = made
        return self._textures[self._key(texture, use)]

    def _shared(self, texture: Texture, use: tuple[Any, ...], pixels: Callable[[], np.ndarray]) -> Any:
        key = self._key(texture, use)
        if key not in self._textures:
            self._textures[key] = bitmap(pixels(), texture)
        return self._textures[key]

    @staticmethod
    def _key(texture: Texture, use: tuple[Any, ...]) -> tuple[Any, ...]:
        return id(texture.image), texture.wrap, texture.nearest, texture.transform, use


def _with_vertices(opacity: Any) -> Any:
    """Opacity of a material, None where all is opaque, times that of the vertices."""
    vertices = {"type": "mesh_attribute", "name": "vertex_alpha"}
    if opacity is None:
        return vertices
    factor = {"type": "uniform", "value": opacity} if isinstance(opacity, float) else opacity
    return {"type": "lightwell_product", "a": factor, "b": vertices}
