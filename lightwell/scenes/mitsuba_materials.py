"""Mitsuba BSDFs converted to the most similar metallic-roughness ``Material``.

The records determine only what is displayed before a bake; the path tracer uses the scene's own BSDFs.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from PIL import Image as PillowImage

from lightwell.backend import mi
from lightwell.core.color import srgb_bytes
from lightwell.scenes.gltf_materials import NEAR_DELTA_ROUGHNESS
from lightwell.scenes.mitsuba_graph import MitsubaDocument, MitsubaElement
from lightwell.scenes.mitsuba_textures import BitmapTextures, png
from lightwell.scenes.scene import Material, Texture

# The thickness of a solid dielectric depends on its mesh; a viewer that refracts needs a number, in metres.
NOMINAL_THICKNESS = 0.1
# glTF has no purely diffuse material; an index of refraction of 1 removes the specular lobe.
DIFFUSE_IOR = 1.0


class Materials:
    """Converts BSDF nodes to records."""

    def __init__(self, graph: MitsubaDocument, warn: Callable[[str], None]) -> None:
        """Prepare the conversion for one file.

        Args:
            graph: Nodes of the file.
            warn: Called with each texture that cannot be converted.
        """
        self._graph = graph
        self._pictures = BitmapTextures(graph, warn)
        # Properties that the current record cannot represent.
        self._lost: list[str] = []
        self.colored: set[int] = set()
        """BSDF nodes that read the mesh attribute ``vertex_color`` as a colour."""
        self._reading = -1
        self._readers = {
            "diffuse": self._diffuse,
            "plastic": self._plastic,
            "roughplastic": self._plastic,
            "conductor": self._conductor,
            "roughconductor": self._conductor,
            "dielectric": self._dielectric,
            "thindielectric": self._dielectric,
            "roughdielectric": self._dielectric,
            "principled": self._principled,
            "principledthin": self._principled,
            "twosided": self._twosided,
            "mask": self._mask,
            "normalmap": self._normalmap,
            "bumpmap": self._bumpmap,
            "blendbsdf": self._blend,
            "null": self._null,
        }

    def read(self, node: MitsubaElement | None) -> Material:
        """Convert a BSDF node.

        Args:
            node: BSDF node; None: Mitsuba's default, a diffuse grey.

        Returns:
            The record; ``approximate`` lists what it cannot represent.
        """
        self._lost = []
        self._reading = -1 if node is None else node.index
        if node is None:
            return Material("default", base_color=(0.5, 0.5, 0.5, 1.0), metallic=0.0, ior=DIFFUSE_IOR)
        material = self._any(node)
        return replace(material, name=node.name, approximate="; ".join(dict.fromkeys(self._lost)))

    def color(self, node: MitsubaElement, key: str, default: float) -> tuple[np.ndarray, Texture | None]:
        """Read a colour parameter.

        Args:
            node: BSDF node.
            key: Name of the parameter.
            default: Value when it is missing.

        Returns:
            Factor [3] and texture, or None without a texture.
        """
        child = self._graph.child(node, key)
        if child is not None and child.plugin == "mesh_attribute":
            return self._attribute(child, default), None
        if child is not None and (texture := self._pictures.read(child)) is not None:
            return np.ones(3), texture
        if child is not None:
            if child.plugin not in ("srgb", "uniform", "rawconstant", "d65"):
                self._lost.append(f"the {child.plugin} texture of '{key}' is replaced by its mean")
            return self._pictures.mean(child), None
        values = self._values(node)
        return _as_color(values.get(f"{key}.value"), default), None

    def mean_radiance(self, light: MitsubaElement) -> tuple[float, float, float]:
        """Compute the mean radiance of an area emitter.

        Args:
            light: Emitter node.

        Returns:
            Linear RGB.
        """
        return tuple(self._pictures.mean(light, "radiance").tolist())

    def _attribute(self, node: MitsubaElement, default: float) -> np.ndarray:
        if node.get("name") == "vertex_color":
            self.colored.add(self._reading)
            return np.ones(3)
        self._lost.append(f"the mesh attribute '{node.get('name')}' is not shown")
        return np.full(3, default)

    def _any(self, node: MitsubaElement) -> Material:
        reader = self._readers.get(node.plugin)
        if reader is not None:
            return reader(node)
        self._lost.append(f"'{node.plugin}' is shown as diffuse grey")
        return Material(node.name, base_color=(0.5, 0.5, 0.5, 1.0), metallic=0.0, ior=DIFFUSE_IOR)

    def _values(self, node: MitsubaElement) -> dict[str, Any]:
        """Read the numbers of the BSDF object, by Mitsuba's parameter names."""
        params = mi.traverse(self._graph.make(node))
        return {key: params[key] for key in params.keys()}

    def _number(self, node: MitsubaElement, key: str, default: float) -> float:
        """Read a number; the mean of a textured one."""
        child = self._graph.child(node, key)
        if child is not None:
            self._lost.append(f"the texture of '{key}' is replaced by its mean")
            return float(self._pictures.mean(child).mean())
        values = self._values(node)
        value = values.get(f"{key}.value", values.get(key))
        return default if value is None else float(np.array(value).mean())

    def _alpha(self, node: MitsubaElement) -> float:
        """Compute the glTF roughness: the root of the microfacet alpha; 0 for smooth plugins."""
        if not node.plugin.startswith("rough"):
            return 0.0
        if "alpha_u" in node.props or "alpha_v" in node.props:
            self._lost.append("anisotropic roughness is replaced by its mean")
            alpha = (self._number(node, "alpha_u", 0.1) + self._number(node, "alpha_v", 0.1)) / 2
        else:
            alpha = self._number(node, "alpha", 0.1)
        return float(np.sqrt(np.clip(alpha, 0, 1)))

    def _ior(self, node: MitsubaElement) -> float:
        values = self._values(node)
        if "eta" in values:
            return _refracting(float(np.array(values["eta"]).mean()))
        inside, outside = node.get("int_ior", 1.5), node.get("ext_ior", 1.0)
        if isinstance(inside, str) or isinstance(outside, str):
            return 1.5
        return _refracting(inside / outside)

    def _diffuse(self, node: MitsubaElement) -> Material:
        color, texture = self.color(node, "reflectance", 0.5)
        return Material(node.name, base_color=_rgba(color), base_color_texture=texture, metallic=0.0, ior=DIFFUSE_IOR)

    def _plastic(self, node: MitsubaElement) -> Material:
        color, texture = self.color(node, "diffuse_reflectance", 0.5)
        roughness = self._alpha(node)
        return Material(
            node.name,
            base_color=_rgba(color),
            base_color_texture=texture,
            metallic=0.0,
            roughness=roughness,
            ior=self._ior(node),
            delta=roughness < NEAR_DELTA_ROUGHNESS,
        )

    def _conductor(self, node: MitsubaElement) -> Material:
        values = self._values(node)
        if node.get("material") == "none" or "eta.value" not in values:
            f0 = np.ones(3)
        else:
            f0 = normal_reflectance(_as_color(values["eta.value"], 0), _as_color(values["k.value"], 1))
        color, texture = self.color(node, "specular_reflectance", 1.0)
        roughness = self._alpha(node)
        return Material(
            node.name,
            base_color=_rgba(f0 * color),
            base_color_texture=texture,
            metallic=1.0,
            roughness=roughness,
            delta=roughness < NEAR_DELTA_ROUGHNESS,
        )

    def _dielectric(self, node: MitsubaElement) -> Material:
        color, _ = self.color(node, "specular_transmittance", 1.0)
        roughness = self._alpha(node)
        return Material(
            node.name,
            base_color=_rgba(color),
            metallic=0.0,
            roughness=roughness,
            transmission=1.0,
            thickness=0.0 if node.plugin == "thindielectric" else NOMINAL_THICKNESS,
            ior=self._ior(node),
            double_sided=True,
            delta=roughness < NEAR_DELTA_ROUGHNESS,
        )

    def _principled(self, node: MitsubaElement) -> Material:
        color, texture = self.color(node, "base_color", 0.5)
        roughness, metallic = self._number(node, "roughness", 0.5), self._number(node, "metallic", 0.0)
        transmission = self._number(node, "spec_trans", 0.0)
        values = self._values(node)
        gloss = self._number(node, "clearcoat_gloss", 0.0)
        sharp = roughness < NEAR_DELTA_ROUGHNESS and (metallic > 0.5 or transmission > 0)
        return Material(
            node.name,
            base_color=_rgba(color),
            base_color_texture=texture,
            metallic=metallic,
            roughness=roughness,
            transmission=transmission,
            thickness=0.0 if node.plugin == "principledthin" else NOMINAL_THICKNESS * (transmission > 0),
            ior=_refracting(float(np.array(values.get("eta", 1.5)).mean())),
            clearcoat=self._number(node, "clearcoat", 0.0),
            clearcoat_roughness=float(np.sqrt(0.1 + gloss * (0.001 - 0.1))),
            sheen=self._number(node, "sheen", 0.0),
            specular_tint=self._number(node, "spec_tint", 0.0),
            delta=sharp,
        )

    def _nested(self, node: MitsubaElement) -> list[MitsubaElement]:
        return [child for _, child in self._graph.children(node) if child.kind == mi.ObjectType.BSDF]

    def _twosided(self, node: MitsubaElement) -> Material:
        nested = self._nested(node)
        if len(nested) > 1:
            self._lost.append("its back is shown like its front")
        return replace(self._any(nested[0]), double_sided=True)

    def _mask(self, node: MitsubaElement) -> Material:
        material = self._any(self._nested(node)[0])
        child = self._graph.child(node, "opacity")
        texture = self._pictures.read(child, raw=True) if child is not None else None
        if texture is None:
            opacity = self._number(node, "opacity", 0.5)
            return replace(material, base_color=(*material.base_color[:3], opacity), alpha_mode="BLEND")
        return replace(material, base_color_texture=_with_alpha(material, texture), alpha_mode="MASK")

    def _normalmap(self, node: MitsubaElement) -> Material:
        material = self._any(self._nested(node)[0])
        child = self._graph.child(node, "normalmap")
        texture = self._pictures.read(child, raw=True) if child is not None else None
        return replace(material, normal_texture=texture)

    def _bumpmap(self, node: MitsubaElement) -> Material:
        self._lost.append("its bump map is not shown")
        return self._any(self._nested(node)[0])

    def _blend(self, node: MitsubaElement) -> Material:
        first, second = (self._any(child) for child in self._nested(node)[:2])
        weight = self._number(node, "weight", 0.5)
        self._lost.append("two blended BSDFs are shown as one")
        nearer = first if weight < 0.5 else second
        mixed = partial(_mixed, first, second, weight)
        return replace(
            nearer,
            base_color=mixed("base_color") if nearer.base_color_texture is None else nearer.base_color,
            **{name: mixed(name) for name in ("metallic", "roughness", "transmission", "ior")},
            delta=first.delta or second.delta,
        )

    def _null(self, node: MitsubaElement) -> Material:
        return Material(node.name, base_color=(1.0, 1.0, 1.0, 0.0), metallic=0.0, alpha_mode="BLEND")


def normal_reflectance(eta: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Compute the Fresnel reflectance of a conductor at normal incidence.

    Args:
        eta: Index of refraction relative to air, any shape.
        k: Extinction coefficient relative to air, same shape.

    Returns:
        Reflectance in [0, 1], same shape.
    """
    return ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2)


def _as_color(value: Any, default: float) -> np.ndarray:
    """Return a parameter's numbers as RGB [3]; ``default`` where it has none."""
    if value is None:
        return np.full(3, default)
    values = np.array(value, np.float64).ravel()
    return np.repeat(values, 3) if values.size == 1 else values[:3]


def _mixed(first: Material, second: Material, weight: float, name: str) -> Any:
    """Interpolate a property of two materials; 0 gives the first."""
    a, b = np.array(getattr(first, name)), np.array(getattr(second, name))
    value = a + (b - a) * weight
    return tuple(value.tolist()) if value.ndim else float(value)


def _refracting(ior: float) -> float:
    """Return the index as a value above 1: the reflectance at normal incidence is the same from both sides."""
    return max(ior, 1 / ior) if ior > 0 else 1.5


def _rgba(color: np.ndarray) -> tuple[float, float, float, float]:
    r, g, b = np.clip(color, 0, 1).tolist()
    return r, g, b, 1.0


def _with_alpha(material: Material, opacity: Texture) -> Texture:
    """Combine the base colour's texture with the opacity's brightness as alpha, in the layout of the base colour."""
    alpha = opacity.image.pixels[..., 0]
    base = material.base_color_texture
    if base is None:
        white = np.full((*alpha.shape, 3), srgb_bytes(np.ones(3)), np.uint8)
        pixels = np.concatenate([white, alpha[..., None]], axis=2)
        return replace(opacity, image=png(f"{opacity.image.name} opacity", pixels))
    picture = PillowImage.open(io.BytesIO(base.image.data)).convert("RGB")
    picture.putalpha(PillowImage.fromarray(alpha).resize(picture.size, PillowImage.Resampling.BILINEAR))
    return replace(base, image=png(f"{base.image.name} with opacity", np.asarray(picture)))
