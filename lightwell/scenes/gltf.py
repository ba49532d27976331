"""glTF 2.0 and GLB files as a ``Scene``.

Supported: the node tree, triangles (also strips and fans), sparse accessors, normalized integers and
KHR_mesh_quantization, Draco and meshopt compression, metallic-roughness materials with the extensions listed in
``gltf_materials``, KHR_texture_transform, EXT_texture_webp, KHR_lights_punctual, perspective cameras and skins at rest.
Morph targets have their weights at rest. Ignored, with a warning: animations of nodes, points and lines, orthographic
cameras. A file that requires another extension is refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from lightwell.limits import Limits
from lightwell.scenes.assemble import assemble
from lightwell.scenes.gltf_accessors import Accessors
from lightwell.scenes.gltf_clips import read_clip
from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_geometry import DRACO, Geometry, morph_weights
from lightwell.scenes.gltf_images import Textures
from lightwell.scenes.gltf_json import Place, texts
from lightwell.scenes.gltf_light_clips import POINTER, changes_nodes, clip_name, read_light_clips
from lightwell.scenes.gltf_materials import READ, WITHOUT_MATERIAL, read_material
from lightwell.scenes.gltf_nodes import VISIBILITY, PlacedNode, placed_nodes
from lightwell.scenes.gltf_placements import INSTANCING, Placement, placed_copies, placements
from lightwell.scenes.gltf_rest import poses_for_flat_nodes
from lightwell.scenes.gltf_skins import joint_matrices, skinned
from lightwell.scenes.light_clips import LightClips
from lightwell.scenes.scene import Camera, Light, LightKind, Material, Mesh, Scene, SceneNode

KNOWN_EXTENSIONS = READ | {
    DRACO,
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_lights_punctual",
    "EXT_texture_webp",
    "KHR_texture_basisu",
    INSTANCING,
    POINTER,
    VISIBILITY,
}
# Intensity of one colour above which a light counts as a mistake, cd or lx: a lighthouse has 1e7 cd, the sun 1.3e5 lx.
MOST_INTENSITY = 1e10
# Longest edges, metres, outside of which a warning says that a scene is large or small.
LARGE, SMALL = 300.0, 0.1
# Sine of the angle between a camera's axes below which they say no direction.
LEAST_SINE = 1e-6
# Extensions that do not affect light and are ignored without a warning.
HARMLESS_EXTENSIONS = {"KHR_materials_variants", "KHR_xmp", "KHR_xmp_json_ld"}


def load_gltf(path: str | Path, limits: Limits | None = None, unit: float = 1.0) -> Scene:
    """Load a .gltf or .glb file; a defect raises ``SceneError``, one line with the cure.

    Args:
        path: The file.
        limits: Limits on sizes and counts; None: ``Limits()``.
        unit: Metres per unit of the file, > 0.

    Returns:
        The scene.
    """
    path, limits = Path(path), limits or Limits()
    reader = _Reader(Document(path, limits), unit)
    reader.read()
    return assemble(
        path.name,
        reader.meshes,
        reader.materials,
        lights=reader.lights,
        cameras=reader.cameras,
        warnings=reader.warnings,
        source=str(path),
        # A scene of another unit is another scene.
        digest=reader.document.digest if unit == 1 else f"{reader.document.digest}-{unit:.17g}",
        nodes=reader.tree,
        clips=reader.clips,
        read_clip=partial(read_clip, path, limits, unit, reader.document.digests),
        light_clips=reader.light_clips,
    )


class _Reader:
    """Reads the nodes of one document into records."""

    def __init__(self, document: Document, unit: float):
        self.document, self._unit = document, unit
        self.meshes: list[Mesh] = []
        self.materials: list[Material] = []
        self.lights: list[Light] = []
        self.cameras: list[Camera] = []
        self.warnings: list[str] = []
        accessors = self._accessors = Accessors(document)
        self._geometry = Geometry(document, accessors, self.warnings.append)
        self._textures = Textures(document, accessors, self.warnings.append)
        # Index into ``materials`` of each of the file's materials that is used; None is the default material.
        self._material_of: dict[int | None, int] = {}
        # Those of another thickness, by index and thickness.
        self._thick: dict[tuple[int, float], int] = {}
        self.tree: list[SceneNode] = []
        self.clips: list[str] = []
        self.light_clips = LightClips()
        # Meshes, lights and cameras of every node, by index.
        self._meshes_of: dict[int, list[int]] = {}
        self._lights_of: dict[int, int] = {}
        # Indices into ``lights`` of each of the file's lights.
        self._placed_lights: dict[int, list[int]] = {}
        self._cameras_of: dict[int, str] = {}
        # World matrix of every node in the scene, by index.
        self._worlds: dict[int, np.ndarray] = {}

    def read(self) -> None:
        """Fill the lists."""
        self._check_extensions()
        poses = poses_for_flat_nodes(self.document, self._accessors, self.warnings.append)
        # Numbers that overflow are refused; the setting costs more than a node, so that it is made once.
        with np.errstate(all="ignore"):
            nodes = list(placed_nodes(self.document, self._unit, poses))
        self._worlds = {node.index: node.matrix for node in nodes}
        self._textures.charge()
        placed = placements(self.document, self._accessors, nodes)
        for placement in placed:
            self._add_meshes(placement)
        for node in nodes:
            self._add_camera(node)
            self._add_light(node)
        if not self.meshes:
            self.document.fail("has no triangles in its default scene", "export its meshes too")
        # Joined placements belong to no node.
        if not any(placement.joined for placement in placed):
            self.tree = self._tree(nodes)
        self._read_clips()
        if ignored := sorted(name[:40] for name in self._geometry.ignored):
            self.warnings.append(f"vertex attributes are ignored: {', '.join(ignored[:10])}")
        self._warn_of_size()

    def _read_clips(self) -> None:
        """Name the animations, and read those that change lights."""
        animations = [self.document.item("animations", i) for i in range(self.document.count("animations"))]
        self.clips = [clip_name(animation, i) for i, animation in enumerate(animations)]
        self.light_clips = read_light_clips(self.document, self._accessors, self._placed_lights, self._material_of)
        if moving := [name for name, animation in zip(self.clips, animations) if changes_nodes(animation)]:
            self.warnings.append(
                "animations are ignored, and the scene is loaded at rest; one that moves parts can be a variable: "
                f'--vary "animation:{moving[0][:40]}=0..1"'
            )

    def _tree(self, nodes: Sequence[PlacedNode]) -> list[SceneNode]:
        """Nodes, parents first, with what hangs on each; skinned meshes hang on their joints, not on their node."""
        index_of = {node.index: k for k, node in enumerate(nodes)}
        return [
            SceneNode(
                node.name,
                index_of.get(node.parent, -1),
                node.matrix,
                tuple(self._meshes_of.get(node.index, ())),
                (self._lights_of[node.index],) if node.index in self._lights_of else (),
                (self._cameras_of[node.index],) if node.index in self._cameras_of else (),
            )
            for node in nodes
        ]

    def _warn_of_size(self) -> None:
        """Warn when the scene is so large or small that its unit is probably not the metre."""
        corners = [c for m in self.meshes for c in (m.positions.min(axis=0), m.positions.max(axis=0))]
        extent = float(np.ptp(corners, axis=0).max()) if corners else 0.0
        if self._unit == 1 and (extent > LARGE or 0 < extent < SMALL):
            guess = "cm or mm" if extent > LARGE else "a larger unit"
            self.warnings.append(
                f"the scene is {extent:.4g} m long; if its file is not in metres, say so with --scene-unit ({guess})"
            )

    def _check_extensions(self) -> None:
        root = self.document.root
        for name in texts(root, "extensionsRequired"):
            if name not in KNOWN_EXTENSIONS:
                root.fail(f"requires the extension '{name[:60]}', which lightwell does not read", "export without it")
        for name in texts(root, "extensionsUsed"):
            known = name in KNOWN_EXTENSIONS | HARMLESS_EXTENSIONS
            if not known and not name.startswith(("KHR_materials_", "EXT_materials_")):
                self.warnings.append(f"the extension '{name[:60]}' is ignored")

    def _add_meshes(self, placement: Placement) -> None:
        node, copies = placement.node, len(placement.matrices)
        primitives, joints = self._geometry.mesh(placement.mesh, morph_weights(node.place)), self._joints(node)
        for i, primitive in enumerate(primitives):
            self.document.budget.check_time(node.place.what)
            name = placement.name if len(primitives) == 1 else f"{placement.name}.{i}"
            with np.errstate(all="ignore"):
                if joints is not None and primitive.joints is not None and primitive.weights is not None:
                    arrays, copies = skinned(self.document, primitive, joints), 1
                else:
                    arrays = placed_copies(primitive, placement.matrices)
            if not np.isfinite(arrays["positions"]).all():
                node.place.fail("moves its mesh so far that its vertices are not finite")
            material = self._material(primitive.material, name, placement.scale)
            if _is_outline(self.materials[material]):
                self.warnings.append(
                    f"material '{self.materials[material].name}': a drawn outline, which only culling makes; "
                    "its meshes are left out because they would enclose the scene"
                )
                continue
            same: dict[str, Any] = {"uv0": primitive.uv0, "uv1": primitive.uv1, "colors": primitive.colors}
            if joints is None:
                self._meshes_of.setdefault(node.index, []).append(len(self.meshes))
            repeated = {k: v if v is None or copies == 1 else np.tile(v, (copies, 1)) for k, v in same.items()}
            self.meshes.append(Mesh(name, material=material, **(arrays | repeated)))

    def _joints(self, node: PlacedNode) -> np.ndarray | None:
        """[J, 4, 4] matrices of the joints that hold a node's mesh, or None when it has no skin."""
        skin = node.place.index("skin", self.document.count("skins"), "skin")
        if skin is None:
            return None
        joints = joint_matrices(self.document, self._accessors, skin, self._worlds)
        if joints is None:
            self.warnings.append(f"node '{node.name}': a joint of its skin is not in the scene; the skin is ignored")
        return joints

    def _material(self, number: int | None, mesh: str, scale: float) -> int:
        """Index of a material at a scale: a thickness is a length of the mesh's own space."""
        if number not in self._material_of:
            self._material_of[number] = len(self.materials)
            if number is None:
                self.warnings.append(f"mesh '{mesh}': has no material; it is shown as a white wall (albedo 0.8)")
                self.materials.append(WITHOUT_MATERIAL)
            else:
                place = self.document.item("materials", number)
                self.materials.append(read_material(place, self._textures, self.warnings.append))
        first = self._material_of[number]
        thickness = self.materials[first].thickness * scale
        if thickness == self.materials[first].thickness:
            return first
        if (first, thickness) not in self._thick:
            self._thick[first, thickness] = len(self.materials)
            self.materials.append(replace(self.materials[first], thickness=thickness))
        return self._thick[first, thickness]

    def _add_camera(self, node: PlacedNode) -> None:
        number = node.place.index("camera", self.document.count("cameras"), "camera")
        if number is None:
            return
        place = self.document.item("cameras", number)
        lens = place.place("perspective")
        if lens is None:
            self.warnings.append(f"camera '{node.name}': only perspective cameras are loaded")
            return
        matrix = node.matrix
        if np.linalg.norm(np.cross(_unit(matrix[:3, 1]), _unit(matrix[:3, 2]))) < LEAST_SINE:
            self.warnings.append(f"camera '{node.name}': a scale of 0 leaves it no direction; it is left out")
            return
        self._cameras_of[node.index] = node.name
        position, forward, up = matrix[:3, 3], -_direction(matrix[:3, 2]), _direction(matrix[:3, 1])
        self.cameras.append(
            Camera(
                position=tuple(position.tolist()),
                target=tuple((position + forward).tolist()),
                up=tuple(up.tolist()),
                fov_y=min(max(math.degrees(lens.number("yfov", low=0)), 1e-3), 179.0),
                name=node.name,
            )
        )

    def _add_light(self, node: PlacedNode) -> None:
        extension = node.place.extension("KHR_lights_punctual")
        if extension is None:
            return
        shared = self.document.root.extension("KHR_lights_punctual")
        lights = shared.items("lights") if shared else []
        self.document.budget.charge("lights", 1, node.place.what)
        number = extension.index("light", len(lights), "light")
        if number is None:
            extension.fail("has no light")
        self._lights_of[node.index] = len(self.lights)
        self._placed_lights.setdefault(number, []).append(len(self.lights))
        light = self._possible(_light(Place(self.document.scene, f"light {number}", lights[number])), node.name)
        self.lights.append(
            replace(
                light,
                name=light.name or node.name,
                position=tuple(node.matrix[:3, 3].tolist()),
                direction=tuple((-_direction(node.matrix[:3, 2])).tolist()),
            )
        )

    def _possible(self, light: Light, node: str) -> Light:
        """Cut an intensity that no light has, because sums of it would overflow, with a warning."""
        brightest = max(light.color)
        if light.intensity * brightest <= MOST_INTENSITY:
            return light
        self.warnings.append(
            f"light '{light.name or node}': an intensity of {light.intensity:g} times a colour of {brightest:g} is "
            f"more than any light has; it is cut to {MOST_INTENSITY:g}"
        )
        red, green, blue = (c / brightest for c in light.color)
        return replace(light, color=(red, green, blue), intensity=MOST_INTENSITY)


def _is_outline(material: Material) -> bool:
    """Test for the material of an inverted hull, the shell around a model whose back faces are never drawn."""
    return "outline" in material.name.lower() and not material.double_sided


def _unit(vector: np.ndarray) -> np.ndarray:
    """[3] unit; 0 when ``vector`` has no length."""
    length = float(np.linalg.norm(vector))
    return vector / length if 0 < length < math.inf else np.zeros(3)


def _direction(vector: np.ndarray) -> np.ndarray:
    """[3] unit; +Z when ``vector`` has no length."""
    length = float(np.linalg.norm(vector))
    return vector / length if 0 < length < math.inf else np.array([0.0, 0.0, 1.0])


def _light(place: Place) -> Light:
    kind = place.text("type")
    if kind not in ("point", "spot", "directional"):
        place.fail(f"has type '{kind[:20]}', expected point, spot or directional")
    spot = place.need("spot") if kind == "spot" else Place(place.scene, place.what, {})
    outer = spot.number("outerConeAngle", math.pi / 4, low=0)
    red, green, blue = (max(c, 0.0) for c in place.numbers("color", 3, (1.0, 1.0, 1.0)))
    return Light(
        kind=cast(LightKind, kind),
        name=place.text("name", ""),
        color=(red, green, blue),
        intensity=place.number("intensity", 1.0, low=0),
        range=place.number("range", low=0) if "range" in place else None,
        inner_cone=min(spot.number("innerConeAngle", 0.0, low=0), outer),
        outer_cone=min(max(outer, 1e-3), math.pi / 2),
    )
