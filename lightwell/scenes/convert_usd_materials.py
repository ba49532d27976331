"""UsdPreviewSurface materials as glTF materials."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lightwell.scenes.convert_files import Folder
from lightwell.scenes.glb_writer import GlbWriter

# Inputs of UsdPreviewSurface that are read.
READ = {"diffuseColor", "metallic", "roughness", "emissiveColor", "opacity", "ior", "normal"}
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
        self._emission(said, entry, path, names)
        self._lost |= {f"material '{path}': '{name}' is ignored" for name in said.keys() - READ}
        return entry

    def _emission(self, said: dict[str, Any], entry: dict[str, Any], path: str, names: list[str]) -> None:
        light, picture = self._value(said, "emissiveColor", [0.0] * 3, path, names)
        light = np.maximum(light, 0)
        if light.max() > 0:
            strength = max(1.0, float(light.max()))
            entry["emissiveFactor"] = (light / strength).tolist()
            entry["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
            if picture is not None:
                entry["emissiveTexture"] = picture

    def _value(
        self, said: dict[str, Any], name: str, default: list[float], path: str, names: list[str]
    ) -> tuple[np.ndarray, dict[str, int] | None]:
        """Numbers of an input, white and a texture where a picture is connected."""
        if name not in said:
            return np.asarray(default, float), None
        sources = said[name].GetConnectedSources()[0]
        if not sources:
            value = said[name].Get()
            found = np.atleast_1d(np.asarray(default if value is None else value, float))
            good = len(found) == len(default) and np.isfinite(found).all()
            return (found if good else np.asarray(default, float)), None
        texture = self._texture(sources[0].source, f"material '{path}': '{name}'")
        if texture is None or len(default) == 1:
            if texture is not None:
                self._lost.add(f"material '{path}': the picture of '{name}' is ignored")
            return np.asarray(default, float), None
        names += self._coordinates(sources[0].source, f"material '{path}': '{name}'")
        return np.ones(len(default)), texture

    def _coordinates(self, source: Any, what: str) -> list[str]:
        """Name of the primvar that a picture is read at; none where nothing says so."""
        from pxr import UsdShade

        place = UsdShade.Shader(source.GetPrim()).GetInput("st")
        for _ in range(MOST_STEPS):
            sources = place.GetConnectedSources()[0] if place else []
            if not sources:
                return []
            shader = UsdShade.Shader(sources[0].source.GetPrim())
            kind = shader.GetIdAttr().Get() if shader else None
            if kind == "UsdTransform2d":
                self._lost.add(f"{what}: the transform of its picture is ignored")
                place = shader.GetInput("in")
            elif kind == "UsdPrimvarReader_float2":
                values = UsdShade.Utils.GetValueProducingAttributes(shader.GetInput("varname"))
                name = values[0].Get() if values else None
                return [str(name)] if name else []
            else:
                return []
        return []

    def _texture(self, source: Any, what: str) -> dict[str, int] | None:
        from pxr import UsdShade

        shader = UsdShade.Shader(source.GetPrim())
        file = shader.GetInput("file").Get() if shader and shader.GetInput("file") else None
        picture = self._folder.picture(file.path) if file is not None else None
        if picture is None:
            self._lost.add(f"{what}: its picture is missing, outside of the scene's folder, or neither PNG nor JPEG")
            return None
        return self._writer.texture(*picture)
