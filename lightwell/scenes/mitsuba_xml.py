"""Mitsuba 3 XML files as a ``Scene``.

The scene's own BSDFs and emitters are kept; every shape becomes a triangle mesh (curved ones with smooth normals), so
that the Mitsuba scene and the records have the same triangles. Materials of the records are the most similar
metallic-roughness ones. Not supported, with a warning: curves, SDF grids, ellipsoids and media.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np

from lightwell.backend import mi
from lightwell.limits import Limits, LoadBudget
from lightwell.scenes.assemble import assemble
from lightwell.scenes.errors import SceneError
from lightwell.scenes.mitsuba_gate import gate
from lightwell.scenes.mitsuba_graph import MitsubaDocument, MitsubaElement
from lightwell.scenes.mitsuba_materials import Materials
from lightwell.scenes.mitsuba_shapes import ANALYTIC, Triangles, moved, of_analytic, of_mesh
from lightwell.scenes.scene import Camera, Light, LightKind, Material, Mesh, Scene
from lightwell.scenes.vectors import vector

# Emitters that may sit on a shape.
SURFACE_EMITTERS = ("area", "directionalarea")


def load_mitsuba(
    path: str | Path, limits: Limits | None = None, allow_paths: Sequence[str | PathLike[str]] = ()
) -> Scene:
    """Load a Mitsuba .xml file; a defect raises ``SceneError``, one line with the cure.

    Args:
        path: The file; Mitsuba reads nothing of it before ``mitsuba_gate`` has checked it.
        limits: Limits on sizes and counts; None: ``Limits()``.
        allow_paths: Further folders whose files it may name, besides its own.

    Returns:
        The scene.
    """
    path = Path(path)
    reader = _Reader(path, (limits or Limits()).budget(f"scene '{path.name}'", SceneError), allow_paths)
    reader.read()
    scene = assemble(
        path.name,
        reader.meshes,
        reader.materials,
        lights=reader.lights,
        cameras=reader.cameras,
        warnings=reader.warnings,
        source=str(path),
        digest=reader.graph.digest,
        environment=reader.environment,
        bsdfs=reader.bsdfs,
        area_lights=reader.area_lights,
        emitters=reader.emitters,
    )
    scene.whole = reader.graph.whole
    return scene


@dataclass
class _Surface:
    """A shape node and its triangles."""

    node: MitsubaElement
    triangles: Triangles


class _Reader:
    """Reads the elements of one file into records."""

    def __init__(self, path: Path, budget: LoadBudget, allow_paths: Sequence[str | PathLike[str]]):
        self.warnings: list[str] = []
        self._budget = budget
        self.graph = MitsubaDocument(path, gate(path, allow_paths, budget, self.warnings.append))
        self.meshes: list[Mesh] = []
        self.materials: list[Material] = []
        self.lights: list[Light] = []
        self.cameras: list[Camera] = []
        self.bsdfs: list[Any] = []
        self.area_lights: list[Any] = []
        self.emitters: list[Any] = []
        self.environment: Any = None
        self._records = Materials(self.graph, self.warnings.append)
        # Index into ``materials`` per (BSDF node, emission); a lamp and a wall may share a BSDF.
        self._material_of: dict[tuple[Any, ...], int] = {}
        self._names: dict[str, int] = {}

    def read(self) -> None:
        """Fill the lists."""
        for _, node in self.graph.children(self.graph.node(0)):
            if node.kind == mi.ObjectType.Shape:
                for surface in self._surfaces(node):
                    self._add_mesh(surface)
            elif node.kind == mi.ObjectType.Emitter:
                self._add_emitter(node)
            elif node.kind == mi.ObjectType.Sensor:
                self._add_camera(node)
        if not self.meshes:
            raise SceneError(
                f"scene '{self.graph.path.name}': has no surfaces; a scene needs at least one <shape>, add one"
            )

    def _surfaces(self, node: MitsubaElement) -> list[_Surface]:
        """Collect the triangles of a shape element: none for a group, those of the group for an instance."""
        if node.index in self.graph.missing or node.plugin == "shapegroup":
            return []
        children = [c for _, c in self.graph.children(node) if c.kind == mi.ObjectType.Shape]
        if node.plugin == "instance":
            return self._instance(node, children)
        if node.plugin == "merge":
            return [surface for child in children for surface in self._surfaces(child)]
        if self._has_medium(node):
            self.warnings.append(f"shape '{node.name}': the medium inside it is ignored")
        triangles = self._triangles(node)
        return [_Surface(node, triangles)] if triangles is not None else []

    def _instance(self, node: MitsubaElement, groups: list[MitsubaElement]) -> list[_Surface]:
        place = node.get("to_world")
        matrix = np.eye(4) if place is None else np.array(place.matrix, np.float64).reshape(4, 4)
        members = [c for g in groups for _, c in self.graph.children(g) if c.kind == mi.ObjectType.Shape]
        if not abs(np.linalg.det(matrix[:3, :3])) > 0:
            self.warnings.append(f"shape '{node.name}': an instance without size is left out")
            return []
        inner = [surface for child in members for surface in self._surfaces(child)]
        return [_Surface(s.node, moved(s.triangles, matrix, keep_facing=True)) for s in inner]

    def _triangles(self, node: MitsubaElement) -> Triangles | None:
        """Make the triangles of a single shape, without its BSDF and emitter, which are made separately."""
        props = mi.Properties(node.props)
        for key, _ in self.graph.children(node):
            del props[key]
        shape = self.graph.create(node, props)
        if isinstance(shape, mi.Mesh):
            return of_mesh(shape)
        if node.plugin in ANALYTIC:
            return of_analytic(shape, node.plugin, bool(node.get("flip_normals", False)))
        self.warnings.append(f"shape '{node.name}': a {node.plugin} cannot become triangles and is left out")
        return None

    def _add_mesh(self, surface: _Surface) -> None:
        node, t = surface.node, surface.triangles
        self._budget.charge("vertices", len(t.positions), f"shape '{node.name}'")
        self._budget.charge("indices", t.indices.size, f"shape '{node.name}'")
        self._budget.check_time(f"shape '{node.name}'")
        light = self.graph.child_of(node, mi.ObjectType.Emitter)
        if light is not None and light.plugin not in SURFACE_EMITTERS:
            self.warnings.append(f"shape '{node.name}': its {light.plugin} emitter is ignored")
            light = None
        bsdf = self.graph.child_of(node, mi.ObjectType.BSDF)
        material = self._material(bsdf, light)
        emission = (0.0, 0.0, 0.0) if light is None else self._records.mean_radiance(light)
        colors = t.colors if bsdf is not None and bsdf.index in self._records.colored else None
        name, medium = self._unique(node.name), self._has_medium(node)
        self.meshes.append(
            Mesh(name, t.positions, t.indices, material, t.normals, t.uv0, None, colors, emission, medium)
        )
        default = {"type": "diffuse"}
        self.bsdfs.append(self.graph.make(bsdf) if bsdf is not None else mi.load_dict(default))
        self.area_lights.append(self.graph.make(light) if light is not None else None)

    def _has_medium(self, node: MitsubaElement) -> bool:
        return any(c.kind == mi.ObjectType.Medium for _, c in self.graph.children(node))

    def _unique(self, name: str) -> str:
        self._names[name] = self._names.get(name, 0) + 1
        return name if self._names[name] == 1 else f"{name}.{self._names[name] - 1}"

    def _material(self, bsdf: MitsubaElement | None, light: MitsubaElement | None) -> int:
        emissive, texture = (0.0, 0.0, 0.0), None
        if light is not None:
            color, texture = self._records.color(light, "radiance", 1.0)
            emissive = tuple(color.tolist())
        key = (bsdf.index if bsdf else None, emissive, texture)
        if key not in self._material_of:
            self._material_of[key] = len(self.materials)
            material = self._records.read(bsdf)
            if light is not None:
                name = f"{material.name} (light)"
                material = replace(material, name=name, emissive=emissive, emissive_texture=texture, dark_back=True)
            if material.approximate:
                self.warnings.append(f"material '{material.name}': shown approximately: {material.approximate}")
            self.materials.append(material)
        return self._material_of[key]

    def _add_emitter(self, node: MitsubaElement) -> None:
        made = self.graph.make(node)
        if node.plugin in ("point", "spot", "directional") and (light := _punctual(node, made)) is not None:
            if not np.isfinite([*light.position, *light.direction, *light.color, light.intensity]).all():
                raise SceneError(
                    f"scene '{self.graph.path.name}': {node.plugin} emitter '{node.name}' has a place, direction or "
                    "power whose numbers overflow in single precision; make them smaller"
                )
            self.lights.append(light)
        elif mi.has_flag(made.flags(), mi.EmitterFlags.Infinite) and self.environment is None:
            self.environment = made
        else:
            self.emitters.append(made)

    def _add_camera(self, node: MitsubaElement) -> None:
        if node.plugin not in ("perspective", "thinlens"):
            self.warnings.append(f"sensor '{node.name}': a {node.plugin} is not loaded, only perspective cameras are")
            return
        if node.plugin == "thinlens":
            self.warnings.append(f"sensor '{node.name}': loaded as a pinhole camera")
        made = self.graph.make(node)
        params = mi.traverse(made)
        matrix = np.array(params["to_world"].matrix, np.float64).reshape(4, 4)
        width, height = (int(v) for v in made.film().size())
        half = np.tan(np.radians(float(np.array(params["x_fov"]).ravel()[0])) / 2)
        position, forward, up = matrix[:3, 3], _unit(matrix[:3, 2]), _unit(matrix[:3, 1])
        if np.linalg.det(matrix[:3, :3]) < 0:
            self.warnings.append(f"sensor '{node.name}': its picture is mirrored; the camera's is not")
        self.cameras.append(
            Camera(
                position=tuple(position.tolist()),
                target=tuple((position + forward).tolist()),
                up=tuple(up.tolist()),
                fov_y=float(np.degrees(2 * np.arctan(half * height / width))),
                name=node.name,
            )
        )


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(float(np.linalg.norm(vector)), 1e-30)


def _punctual(node: MitsubaElement, made: Any) -> Light | None:
    """Make the record of a punctual emitter; None when a record cannot represent it (a textured spot, a spectrum)."""
    params = mi.traverse(made)
    key = "irradiance.value" if node.plugin == "directional" else "intensity.value"
    if key not in params or any(k.startswith("texture.data") for k, _ in params):
        return None
    values = np.array(params[key], np.float64).ravel()
    power = np.repeat(values, 3) if values.size == 1 else values[:3]
    strength = float(power.max())
    color = vector(power / strength) if strength > 0 else (1.0, 1.0, 1.0)
    light = Light(cast(LightKind, node.plugin), node.name, color=color, intensity=strength)
    if node.plugin == "point":
        return replace(light, position=tuple(np.array(params["position"], np.float64).ravel()[:3].tolist()))
    matrix = np.array(params["to_world"].matrix, np.float64).reshape(4, 4)
    light = replace(light, direction=tuple(_unit(matrix[:3, 2]).tolist()))
    if node.plugin == "directional":
        return light
    cutoff = float(node.get("cutoff_angle", 20.0))
    beam = float(node.get("beam_width", cutoff * 3 / 4))
    inner, outer = float(np.radians(beam)), float(np.radians(cutoff))
    return replace(light, position=vector(matrix[:3, 3]), inner_cone=inner, outer_cone=outer)
