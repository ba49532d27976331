"""UsdPreviewSurface materials as glTF materials."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lightwell.scenes.convert_files import Folder
from lightwell.scenes.glb_writer import CLAMP, MIRROR, REPEAT, GlbWriter

# Inputs of UsdPreviewSurface that are read.
READ = {"diffuseColor", "metallic", "roughness", "emissiveColor", "opacity", "ior", "normal"}
# Index of refraction of UsdPreviewSurface and glTF where none is said.
DEFAULT_IOR = 1.5
# Wrap modes other than repetition.
WRAPS = {"clamp": CLAMP, "mirror": MIRROR}
# Most shaders between a picture and its texture coordinates.
MOST_STEPS = 8


class Materials:
    """The materials of a stage; each is written once."""

    def __init__(self, writer: GlbWriter, folder: Folder, lost: set[str]) -> None:
        """Start without materials.

        Args:
            writer: Takes the materials.
            folder: Holds the pictures.
            lost: Takes what is left out.
        """
        self._writer, self._folder, self._lost = writer, folder, lost
        self._made: dict[str, int] = {}
        self.coordinates: dict[int | None, str] = {}
        """Index of a material → name of the texture coordinates that its pictures are read at."""
        self.painted: set[int | None] = set()
        """Indices of materials that show the display colours of their meshes, which are not the same everywhere."""

    def parts(self, prim: Any, count: int) -> Iterator[tuple[int | None, np.ndarray]]:
        """Divide the faces of a mesh by material.

        Args:
            prim: The mesh.
            count: Number of its faces.

        Yields:
            Index of a material or None, and the faces that have it.
        """
        from pxr import UsdGeom, UsdShade

        rest = np.ones(count, bool)
        for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            faces = np.asarray(UsdGeom.Subset(subset).GetIndicesAttr().Get() or [], np.int64)
            faces = faces[(faces >= 0) & (faces < count)]
            rest[faces] = False
            yield self._bound(subset.GetPrim()), faces
        if rest.any():
            yield self._bound(prim), np.flatnonzero(rest)

    def _bound(self, prim: Any) -> int | None:
        from pxr import UsdGeom, UsdShade

        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        if material:
            path = str(material.GetPath())
            if path not in self._made:
                names: list[str] = []
                self._made[path] = self._writer.material(self._material(material, path, names))
                if names:
                    self.coordinates[self._made[path]] = names[0]
                if len(set(names)) > 1:
                    self._lost.add(f"material '{path}': of several sets of texture coordinates '{names[0]}' is used")
            return self._made[path]
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
        colors = primvar.Get() if primvar and primvar.HasValue() else None
        if not colors:
            return None
        if len(colors) > 1 and str(primvar.GetInterpolation()) != "constant":
            if "displayColor" not in self._made:
                pbr = {"baseColorFactor": [1, 1, 1, 1], "metallicFactor": 0}
                white = {"name": "displayColor", "pbrMetallicRoughness": pbr}
                self._made["displayColor"] = self._writer.material(white)
                self.painted.add(self._made["displayColor"])
            return self._made["displayColor"]
        key = f"displayColor {tuple(colors[0])}"
        if key not in self._made:
            pbr = {"baseColorFactor": [*np.clip(colors[0], 0, 1).tolist(), 1.0], "metallicFactor": 0}
            self._made[key] = self._writer.material({"name": prim.GetName(), "pbrMetallicRoughness": pbr})
        return self._made[key]

    def _material(self, material: Any, path: str, names: list[str]) -> dict[str, Any]:
        """The glTF material; ``names`` takes the names of the texture coordinates that it reads."""
        shader = material.ComputeSurfaceSource()[0]
        entry: dict[str, Any] = {"name": material.GetPrim().GetName(), "doubleSided": True}
        if not shader or shader.GetIdAttr().Get() != "UsdPreviewSurface":
            self._lost.add(f"material '{path}' is no UsdPreviewSurface: it is white and matt")
            return entry | {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1], "metallicFactor": 0}}
        said = {name.GetBaseName(): name for name in shader.GetInputs()}
        color, picture = self._value(said, "diffuseColor", [0.18] * 3, path, names)
        opacity = float(self._value(said, "opacity", [1.0], path, names)[0][0])
        pbr: dict[str, Any] = {
            "baseColorFactor": [*np.clip(color, 0, 1).tolist(), min(max(opacity, 0.0), 1.0)],
            "metallicFactor": float(np.clip(self._value(said, "metallic", [0.0], path, names)[0][0], 0, 1)),
            "roughnessFactor": float(np.clip(self._value(said, "roughness", [0.5], path, names)[0][0], 0, 1)),
        }
        if picture is not None:
            pbr["baseColorTexture"] = picture
        entry["pbrMetallicRoughness"] = pbr
        if opacity < 1:
            entry["alphaMode"] = "BLEND"
        _, bumps = self._value(said, "normal", [0.0] * 3, path, names)
        if bumps is not None:
            entry["normalTexture"] = bumps
        ior = float(self._value(said, "ior", [DEFAULT_IOR], path, names)[0][0])
        if ior != DEFAULT_IOR:
            entry["extensions"] = {"KHR_materials_ior": {"ior": max(ior, 1.0)}}
        self._emission(said, entry, path, names)
        self._lost |= {f"material '{path}': '{name}' is ignored" for name in said.keys() - READ}
        return entry

    def _emission(self, said: dict[str, Any], entry: dict[str, Any], path: str, names: list[str]) -> None:
        light, picture = self._value(said, "emissiveColor", [0.0] * 3, path, names)
        light = np.maximum(light, 0)
        if light.max() > 0:
            strength = max(1.0, float(light.max()))
            entry["emissiveFactor"] = (light / strength).tolist()
            entry.setdefault("extensions", {})["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
            if picture is not None:
                entry["emissiveTexture"] = picture

    def _value(
        self, said: dict[str, Any], name: str, default: list[float], path: str, names: list[str]
    ) -> tuple[np.ndarray, dict[str, Any] | None]:
        """Numbers of an input, and a texture that they are the factor of where a picture is connected."""
        if name not in said:
            return np.asarray(default, float), None
        what, source = f"material '{path}': '{name}'", _source(said[name])
        if source is None:
            return _numbers(said[name], default), None
        texture = self._texture(source, what, names if len(default) > 1 else [])
        if texture is None or len(default) == 1:
            if texture is not None:
                self._lost.add(f"material '{path}': the picture of '{name}' is ignored")
            return np.asarray(default, float), None
        # Scale and bias of a normal map are those of any: from [0, 1] to [-1, 1].
        if name != "normal" and _numbers(source.GetInput("bias"), [0.0] * 4)[:3].any():
            self._lost.add(f"{what}: the bias of its picture is ignored")
        return _numbers(source.GetInput("scale"), [1.0] * 4)[:3], texture

    def _coordinates(self, shader: Any, what: str) -> tuple[list[str], dict[str, Any] | None]:
        """Name of the primvar that a picture is read at, none where nothing says so, and its KHR_texture_transform."""
        place, transform = shader.GetInput("st"), None
        for _ in range(MOST_STEPS):
            source = _source(place)
            kind = source.GetIdAttr().Get() if source else None
            if kind == "UsdTransform2d":
                if transform is not None:
                    self._lost.add(f"{what}: of several transforms of its picture the last is used")
                transform = transform or _transform(source)
                place = source.GetInput("in")
            elif kind == "UsdPrimvarReader_float2":
                name = _said(source.GetInput("varname"))
                return [str(name)] if name else [], transform
            else:
                break
        return [], transform

    def _texture(self, shader: Any, what: str, names: list[str]) -> dict[str, Any] | None:
        """A picture at its coordinates, whose name is added to ``names``; None where it cannot be read."""
        file = _said(shader.GetInput("file"))
        # The path is relative to the layer that says it, which may lie in another folder than the stage.
        picture = self._folder.picture(file.resolvedPath or file.path) if file is not None else None
        if picture is None:
            self._lost.add(f"{what}: its picture is missing, outside of the scene's folder, or neither PNG nor JPEG")
            return None
        found, transform = self._coordinates(shader, what)
        names += found
        u, v = (WRAPS.get(str(_said(shader.GetInput(key))), REPEAT) for key in ("wrapS", "wrapT"))
        return self._writer.texture(*picture, (u, v), transform)


def _source(place: Any) -> Any:
    """The shader that an input gets its value from, also through the interface of its material; None without one."""
    from pxr import UsdShade

    attributes = UsdShade.Utils.GetValueProducingAttributes(place) if place else []
    found = [a for a in attributes if UsdShade.Output.IsOutput(a)]
    return UsdShade.Shader(found[0].GetPrim()) if found else None


def _said(place: Any) -> Any:
    """The value of an input, also where the interface of its material holds it; None without one."""
    from pxr import Usd, UsdShade

    if not place:
        return None
    attributes = UsdShade.Utils.GetValueProducingAttributes(place)
    first = Usd.TimeCode.EarliestTime()
    return attributes[0].Get(first) if attributes else place.Get(first)


def _numbers(place: Any, default: list[float]) -> np.ndarray:
    """Numbers of an input; the default where it has others."""
    value = _said(place)
    found = np.atleast_1d(np.asarray(default if value is None else value, float))
    return found if len(found) == len(default) and np.isfinite(found).all() else np.asarray(default, float)


def _transform(shader: Any) -> dict[str, Any] | None:
    """A UsdTransform2d, whose v counts upwards, as KHR_texture_transform; None where it moves nothing."""
    su, sv = _numbers(shader.GetInput("scale"), [1.0] * 2)
    u, v = _numbers(shader.GetInput("translation"), [0.0] * 2)
    angle = float(np.radians(_numbers(shader.GetInput("rotation"), [0.0])[0]))
    if (su, sv, u, v, angle) == (1, 1, 0, 0, 0):
        return None
    offset = [float(u - np.sin(angle) * sv), float(1 - v - np.cos(angle) * sv)]
    return {"offset": offset, "rotation": angle, "scale": [float(su), float(sv)]}
