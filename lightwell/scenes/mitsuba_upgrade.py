"""Conversion of scenes of Mitsuba 0.x and 2.x to the element and parameter names of Mitsuba 3.

It covers what Mitsuba's own upgrade does (camelCase names, ``diffuseReflectance`` of a diffuse BSDF, offsets and scales
of a texture), and also the renamed elements, types and values that Mitsuba leaves to the author.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from lightwell.core.color import linear
from lightwell.scenes.mitsuba_document import Element, Version

_CAMEL = re.compile(r"([a-z])([A-Z]+)")
_TAGS = {"lookAt": "lookat", "camera": "sensor", "luminaire": "emitter", "srgb": "rgb"}
# (element, type) of Mitsuba 0.x → type.
_TYPES = {
    ("texture", "ldrtexture"): "bitmap",
    ("texture", "exrtexture"): "bitmap",
    ("shape", "hair"): "linearcurve",
    ("medium", "heterogeneous_volume"): "heterogeneous",
}
# Values of bitmap textures that Mitsuba 3 does not have.
_FILTERS = {"trilinear": "bilinear", "ewa": "bilinear"}
_WRAPS = {"zero": "clamp", "one": "clamp", "black": "clamp", "white": "clamp"}
_DISTRIBUTIONS = ("beckmann", "ggx")
_PLACING = {
    "uoffset": ("translate", "x"),
    "voffset": ("translate", "y"),
    "uscale": ("scale", "x"),
    "vscale": ("scale", "y"),
}


class Upgrade:
    """Converts an element whose children are already converted; returns its replacement."""

    def __init__(self, warn: Callable[[str], None]) -> None:
        """Prepare the conversion.

        Args:
            warn: Called with each element that is dropped or replaced.
        """
        self._warn = warn

    def __call__(self, element: Element, version: Version) -> list[Element]:
        if version < (3,):
            element.tag = _TAGS.get(element.tag, element.tag)
            if element.tag == "rgb":
                _hexadecimal(element)
        if version < (2,):
            self._from_first(element)
            if element.tag == "subsurface":
                self._warn(f"line {element.line}: a <subsurface> of Mitsuba 0.x is ignored")
                return []
        if element.type == "bitmap":
            self._bitmap(element)
        return [element]

    def _from_first(self, element: Element) -> None:
        """Mitsuba 0.x."""
        if "name" in element.attributes:
            element.attributes["name"] = snake_case(element.attributes["name"])
        if "type" in element.attributes:
            element.attributes["type"] = _TYPES.get((element.tag, element.type), element.type)
        if element.tag == "spectrum" and _three_numbers(element.attributes.get("value", "")):
            element.tag = "rgb"
        if element.type == "diffuse":
            _rename(element, "diffuse_reflectance", "reflectance")
        if element.tag == "texture":
            _place(element)
        if element.type == "vertexcolors":
            element.attributes["type"] = "mesh_attribute"
            element.children = [_property(element, "string", "name", "vertex_color")]
        if element.tag == "bsdf":
            self._distribution(element)
        if element.tag == "medium":
            _medium(element)

    def _bitmap(self, element: Element) -> None:
        for name, values in (("filter_type", _FILTERS), ("wrap_mode", _WRAPS)):
            for child in element.children:
                if child.attributes.get("name") == name and (new := values.get(child.attributes.get("value", ""))):
                    if name == "wrap_mode":
                        old = child.attributes["value"]
                        self._warn(f"line {child.line}: the wrap mode '{old}' of a texture is read as '{new}'")
                    child.attributes["value"] = new

    def _distribution(self, element: Element) -> None:
        for child in element.children:
            value = child.attributes.get("value", "")
            if child.attributes.get("name") == "distribution" and value not in _DISTRIBUTIONS:
                self._warn(f"line {child.line}: the distribution '{value}' of a BSDF is read as 'beckmann'")
                child.attributes["value"] = "beckmann"


def snake_case(name: str) -> str:
    """Convert a camelCase name, as Mitsuba's upgrade does: ``toWorld`` → ``to_world``, ``intIOR`` → ``int_ior``.

    Args:
        name: Name to convert.

    Returns:
        The name in snake_case.
    """
    return _CAMEL.sub(lambda found: f"{found[1]}_{found[2].lower()}", name)


def _rename(element: Element, old: str, new: str) -> None:
    for child in element.children:
        if child.attributes.get("name") == old:
            child.attributes["name"] = new


def _property(element: Element, tag: str, name: str, value: str) -> Element:
    return Element(tag, {"name": name, "value": value}, element.file, element.line)


def _place(texture: Element) -> None:
    """Convert offsets and scales to a transform: first the offset, then the scale, as Mitsuba composes them."""
    found = {c.attributes["name"]: c for c in texture.children if c.attributes.get("name") in _PLACING}
    if not found:
        return
    steps = []
    for tag, default in (("translate", "0"), ("scale", "1")):
        axes = {"x": default, "y": default, "z": default}
        axes |= {_PLACING[n][1]: c.attributes.get("value", default) for n, c in found.items() if _PLACING[n][0] == tag}
        steps.append(Element(tag, axes, texture.file, texture.line))
    kept = [child for child in texture.children if child.attributes.get("name") not in _PLACING]
    texture.children = [*kept, Element("transform", {"name": "to_uv"}, texture.file, texture.line, steps)]


def _medium(medium: Element) -> None:
    """Convert absorption and scattering to extinction and albedo, where both are plain colours."""
    colors = {n: _numbers(medium.value(n) or "") for n in ("sigma_a", "sigma_s")}
    if any(len(v) not in (1, 3) for v in colors.values()):
        return
    absorbed, scattered = (v * 3 if len(v) == 1 else v for v in colors.values())
    total = [a + s for a, s in zip(absorbed, scattered, strict=True)]
    albedo = [s / t if t else 0.0 for s, t in zip(scattered, total, strict=True)]
    kept = [child for child in medium.children if child.attributes.get("name") not in colors]
    made = [
        _property(medium, "rgb", name, " ".join(f"{v:.9g}" for v in values))
        for name, values in (("sigma_t", total), ("albedo", albedo))
    ]
    medium.children = kept + made


def _hexadecimal(element: Element) -> None:
    """Decode ``#rrggbb`` from sRGB to linear numbers."""
    value = element.attributes.get("value", "").strip()
    if re.fullmatch(r"#[0-9a-fA-F]{6}", value):
        codes = np.array([int(value[k : k + 2], 16) / 255 for k in (1, 3, 5)])
        element.attributes["value"] = " ".join(f"{v:.9g}" for v in linear(codes))


def _three_numbers(text: str) -> bool:
    return len(_numbers(text)) == 3


def _numbers(text: str) -> list[float]:
    """Parse a list of numbers; empty where it holds anything else."""
    try:
        return [float(part) for part in re.split(r"[\s,;]+", text.strip())] if text.strip() else []
    except ValueError:
        return []
