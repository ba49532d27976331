"""Materials of a glTF file as ``Material`` records."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import cast

from lightwell.scenes.gltf_images import Textures
from lightwell.scenes.gltf_json import Place
from lightwell.scenes.gltf_specular_glossiness import converted
from lightwell.scenes.scene import AlphaMode, Material
from lightwell.scenes.vectors import vector

# A microfacet lobe below this roughness is so narrow that BSDF sampling rarely finds lights through it.
NEAR_DELTA_ROUGHNESS = 0.1
# Primitives without a material: a white wall. (glTF's own default, a white metal, would hardly reflect diffusely.)
WITHOUT_MATERIAL = Material("without material", base_color=(0.8, 0.8, 0.8, 1.0), metallic=0.0, roughness=1.0)
# Radiance above which a material's emission counts as an error: the sun's disc has 1.6e9 cd/m².
MOST_RADIANCE = 1e10
# Mean of a transmission texture below which a surface is opaque: noise of a black JPEG, or a few windows in the picture
# of a whole house, whose walls would let light through.
LEAST_TRANSMISSION = 0.05

# Material extensions that are read, completely or in part.
READ = {
    f"KHR_materials_{name}"
    for name in (
        "emissive_strength transmission ior clearcoat sheen specular unlit volume pbrSpecularGlossiness".split()
    )
}


def read_material(place: Place, textures: Textures, warn: Callable[[str], None]) -> Material:
    """Read one material.

    Args:
        place: Material object.
        textures: Textures of the file.
        warn: Called with each property that the record cannot represent.

    Returns:
        The record.
    """
    name = place.text("name", "") or place.what
    lost: list[str] = []
    material = _metallic_roughness(place, name, textures)
    if (glossy := place.extension("KHR_materials_pbrSpecularGlossiness")) is not None:
        material = converted(glossy, material, textures)
        lost.append("specular-glossiness is converted to metallic-roughness approximately")
    material = _surface(place, material, textures, lost)
    material = _extensions(place, material, textures, lost)
    if material.unlit and max(material.emissive) > 0:
        lost.append("it is unlit, so that its emission is what it looks like and no light")
        material = replace(material, emissive=(0.0, 0.0, 0.0), emissive_texture=None)
    ignored = sorted(n for n in _material_extensions(place) if n not in READ)
    lost += [f"{n} is ignored" for n in ignored]
    for what in lost:
        warn(f"material '{name}': {what}")
    near = material.roughness < NEAR_DELTA_ROUGHNESS and (material.metallic > 0.5 or material.transmission > 0)
    return replace(material, delta=near, approximate="; ".join(lost))


def _material_extensions(place: Place) -> list[str]:
    extensions = place.place("extensions")
    return [n for n in extensions.value if n.startswith(("KHR_materials_", "EXT_materials_"))] if extensions else []


def _unit(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def _color(values: Sequence[float]) -> tuple[float, float, float, float]:
    """Limit four numbers to [0, 1]."""
    red, green, blue, alpha = map(_unit, values)
    return red, green, blue, alpha


def _metallic_roughness(place: Place, name: str, textures: Textures) -> Material:
    pbr = place.place("pbrMetallicRoughness")
    if pbr is None:
        return Material(name)
    return Material(
        name,
        base_color=_color(pbr.numbers("baseColorFactor", 4, (1.0, 1.0, 1.0, 1.0))),
        base_color_texture=textures.read(pbr, "baseColorTexture"),
        metallic=_unit(pbr.number("metallicFactor", 1.0)),
        roughness=_unit(pbr.number("roughnessFactor", 1.0)),
        metallic_roughness_texture=textures.read(pbr, "metallicRoughnessTexture"),
    )


def _surface(place: Place, material: Material, textures: Textures, lost: list[str]) -> Material:
    strength = place.extension("KHR_materials_emissive_strength")
    factor = strength.number("emissiveStrength", 1.0, low=0) if strength else 1.0
    emissive = vector(max(c, 0.0) * factor for c in place.numbers("emissiveFactor", 3, (0.0, 0.0, 0.0)))
    if max(emissive) > MOST_RADIANCE:
        lost.append(f"its emission of {max(emissive):g} is more than any light has; it is cut to {MOST_RADIANCE:g}")
        emissive = vector(min(c, MOST_RADIANCE) for c in emissive)
    mode = place.text("alphaMode", "OPAQUE")
    if mode not in ("OPAQUE", "MASK", "BLEND"):
        place.fail(f"has alphaMode '{mode[:20]}', expected OPAQUE, MASK or BLEND")
    normal = place.place("normalTexture")
    return replace(
        material,
        normal_texture=textures.read(place, "normalTexture"),
        normal_scale=normal.number("scale", 1.0) if normal else 1.0,
        emissive=emissive,
        emissive_texture=textures.read(place, "emissiveTexture") if max(emissive) > 0 else None,
        alpha_mode=cast(AlphaMode, mode),
        alpha_cutoff=place.number("alphaCutoff", 0.5),
        double_sided=place.flag("doubleSided"),
    )


def _extensions(place: Place, material: Material, textures: Textures, lost: list[str]) -> Material:
    def of(name: str) -> Place:
        return place.extension(f"KHR_materials_{name}") or Place(place.scene, place.what, {})

    for name in ("clearcoat", "sheen", "specular", "volume"):
        lost.extend(f"the {key} is ignored" for key in of(name).value if key.endswith("Texture"))
    volume, clearcoat = of("volume"), of("clearcoat")
    sheen = of("sheen").numbers("sheenColorFactor", 3, (0.0, 0.0, 0.0))
    if max(sheen) > min(sheen):
        lost.append("the colour of its sheen is ignored")
    if "attenuationColor" in volume and min(volume.numbers("attenuationColor", 3)) < 1:
        lost.append("the absorption in its volume is ignored")
    return replace(
        material,
        transmission=_transmission(of("transmission"), material, textures, lost),
        thickness=volume.number("thicknessFactor", 0.0, low=0),
        ior=_ior(of("ior"), of("specular"), material, lost),
        clearcoat=_unit(clearcoat.number("clearcoatFactor", 0.0)),
        clearcoat_roughness=_unit(clearcoat.number("clearcoatRoughnessFactor", 0.0)),
        sheen=_unit(max(sheen)),
        unlit=place.extension("KHR_materials_unlit") is not None,
    )


def _transmission(place: Place, material: Material, textures: Textures, lost: list[str]) -> float:
    """Read the share of light that passes through a surface: one number, so that a texture is averaged."""
    factor = _unit(place.number("transmissionFactor", 0.0))
    if factor > 0 and material.metallic == 1 and material.metallic_roughness_texture is None:
        lost.append("it is a metal (metallicFactor is 1 or left out), so that its transmission is ignored")
        return 0.0
    texture = textures.read(place, "transmissionTexture") if factor > 0 else None
    if texture is None:
        return factor
    mean = float(texture.image.pixels[..., 0].mean()) / 255
    if mean < LEAST_TRANSMISSION:
        lost.append(f"its transmissionTexture has a mean of {mean:.2g}; the whole surface is opaque")
        return 0.0
    if mean < 1:
        lost.append(f"its transmissionTexture is averaged: {mean:.2g} everywhere")
    return factor * mean


def _ior(place: Place, specular: Place, material: Material, lost: list[str]) -> float:
    """Compute the index of refraction whose normal reflectance is that of ``ior`` times the specular factor."""
    ior = place.number("ior", 1.5)
    ior = max(ior, 1.0) if ior > 0 else 1.5
    factor = _unit(specular.number("specularFactor", 1.0))
    if any(value != 1 for value in specular.numbers("specularColorFactor", 3, (1.0, 1.0, 1.0))):
        lost.append("the colour of its specular reflection is ignored")
    if factor == 1:
        return ior
    root = math.sqrt(factor) * (ior - 1) / (ior + 1)
    return (1 + root) / (1 - root)
