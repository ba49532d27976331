"""Writes the baked asset: an ordinary glTF 2.0 binary with its learned light in an extension."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import lightwell
from lightwell.asset import geometry
from lightwell.asset.animations import add_lamp_clips
from lightwell.asset.container import Binary, pack
from lightwell.asset.materials import MaterialTable, uv_sets
from lightwell.asset.moving import add_movers, moving_nodes
from lightwell.asset.pictures import add_fallback, add_texture, check_picture
from lightwell.asset.records import (
    EXTENSION,
    NEWER,
    VERSION,
    VERSION_WITH_LAMPS_OR_SKY,
    EnvironmentEntry,
    Fallback,
    FieldEntry,
    LampEntry,
)
from lightwell.asset.schema import validate
from lightwell.files import write_atomically

if TYPE_CHECKING:
    from lightwell.scenes.lamp_clips import LampClip
    from lightwell.scenes.scene import Material, Mesh, Scene

GENERATOR = f"lightwell {lightwell.__version__}"


def write_glb(
    path: str | Path,
    scene: Scene,
    fields: Sequence[FieldEntry],
    variables: Sequence[dict[str, Any]],
    generator: str = GENERATOR,
    fallback: Fallback | None = None,
    lamps: Sequence[LampEntry] = (),
    exposure: float | None = None,
    pose: Sequence[float] | None = None,
    probes: Sequence[FieldEntry] = (),
    clips: Sequence[LampClip] = (),
    environment: EnvironmentEntry | None = None,
) -> int:
    """Write a scene and its learned light to a GLB file.

    Any glTF viewer shows the result with its ordinary materials. The file is replaced as a whole: an error (``OSError``
    for a full disk or an unwritable folder) leaves no partial file.

    Args:
        path: File to write.
        scene: Scene with at least one triangle.
        fields: Baked fields; may be empty.
        variables: JSON objects of the variables that the fields depend on (format/FORMAT.md).
        generator: Program that made the file, for ``asset.generator``.
        fallback: Light map for viewers that do not know the extension, or None.
        lamps: Groups of the scene's own lights, in the order of the graphs' input ``lamps``.
        exposure: Factor on radiance before tone mapping that suits the scene, > 0; None: the file has none.
        pose: First slider, 0 to 1, of each of the scene's movers, which become variables; None: nothing moves.
        probes: The same light in the air, for what is added to the scene or moves; may be empty.
        clips: Animations of the lamps; may be empty.
        environment: What surrounds the scene; None: nothing that shines.

    Returns:
        Number of bytes written.
    """
    data = glb_bytes(scene, fields, variables, generator, fallback, lamps, exposure, pose, probes, clips, environment)
    return write_atomically(path, data)


def glb_bytes(
    scene: Scene,
    fields: Sequence[FieldEntry],
    variables: Sequence[dict[str, Any]],
    generator: str = GENERATOR,
    fallback: Fallback | None = None,
    lamps: Sequence[LampEntry] = (),
    exposure: float | None = None,
    pose: Sequence[float] | None = None,
    probes: Sequence[FieldEntry] = (),
    clips: Sequence[LampClip] = (),
    environment: EnvironmentEntry | None = None,
) -> bytes:
    """Build the GLB that ``write_glb`` writes; equal arguments give equal bytes.

    Args:
        scene: Scene with at least one triangle.
        fields: Baked fields; may be empty.
        variables: JSON objects of the variables that the fields depend on (format/FORMAT.md).
        generator: Program that made the file, for ``asset.generator``.
        fallback: Light map for viewers that do not know the extension, or None.
        lamps: Groups of the scene's own lights, in the order of the graphs' input ``lamps``.
        exposure: Factor on radiance before tone mapping that suits the scene, > 0; None: the file has none.
        pose: First slider, 0 to 1, of each of the scene's movers, which become variables; None: nothing moves.
        probes: The same light in the air, for what is added to the scene or moves; may be empty.
        clips: Animations of the lamps; may be empty.
        environment: What surrounds the scene; None: nothing that shines.

    Returns:
        The bytes of the file.
    """
    binary = Binary()
    document: dict[str, Any] = {"asset": {"version": "2.0", "generator": generator}}
    materials = _add_surfaces(document, scene, binary)
    _add_lights_and_cameras(document, scene)
    roots = list(range(len(document["nodes"])))
    if scene.movers and pose is not None:
        carried = {k for mover in scene.movers for part in mover.parts for k in moving_nodes(scene, part)}
        variables = [*variables, *add_movers(document, scene, pose, binary)]
        below = {child for node in document["nodes"] for child in node.get("children", ())}
        roots = [k for k in range(len(document["nodes"])) if k not in carried | below]
    add_lamp_clips(document, clips, materials, binary)
    document["scenes"] = [{"name": scene.name, "nodes": roots}]
    document["scene"] = 0
    if fallback is not None:
        add_fallback(document, binary, fallback)
    extension = extension_json(fields, variables, binary, document, lamps, probes)
    if exposure is not None:
        extension["exposure"] = float(exposure)
    if any(material.transmission > 0 for material in scene.materials):
        extension["glass"] = True
    extension |= _surroundings_json(scene, environment, binary, document)
    validate(extension)
    document.setdefault("extensions", {})[EXTENSION] = extension
    document["extensionsUsed"] = sorted({*document.get("extensionsUsed", ()), EXTENSION})
    document["bufferViews"], document["accessors"] = binary.views, binary.accessors
    document["buffers"] = [{"byteLength": len(binary.data)}]
    return pack(document, bytes(binary.data))


def _surroundings_json(
    scene: Scene, environment: EnvironmentEntry | None, binary: Binary, document: dict[str, Any]
) -> dict[str, Any]:
    """What viewers place cameras and lamps by, and what they show behind the scene."""
    entries: dict[str, Any] = {}
    # A file without it is looked at as a whole.
    if not np.array_equal(scene.core, scene.bounds):
        low, high = scene.core.tolist()
        entries["core"] = {"low": low, "high": high}
    if environment is not None:
        entries["environment"] = {"radiance": list(environment.radiance)}
        if environment.picture is not None:
            entries["environment"]["texture"] = add_texture(document, binary, environment.picture)
        if environment.lamp is not None:
            entries["environment"]["lamp"] = environment.lamp
    return entries


def _add_surfaces(document: dict[str, Any], scene: Scene, binary: Binary) -> dict[int, list[int]]:
    """Meshes with their materials, one node each in world space; returns the written materials of each of the scene."""
    table = MaterialTable(binary)
    index_of: dict[tuple[int, tuple[float, ...]], int] = {}

    def written(number: int, material: Material) -> int:
        key = (number, material.emissive)
        if key not in index_of:
            index_of[key] = table.add(material)
        return index_of[key]

    meshes: list[dict[str, Any]] = []
    nodes: list[dict[str, Any]] = []
    for mesh in scene.meshes:
        if not len(mesh.indices):
            continue
        material = _lit_material(scene.materials[mesh.material], mesh)
        # A material of glTF emits on all sides that are shown.
        two = material.dark_back and material.double_sided and max(material.emissive) > 0
        front = replace(material, double_sided=False) if two else material
        primitives = [geometry.primitive(mesh, written(mesh.material, front), uv_sets(front), binary)]
        if two:
            back = replace(front, name=f"{front.name}, back", emissive=(0.0, 0.0, 0.0), emissive_texture=None)
            number = written(mesh.material, back)
            primitives.append(geometry.primitive(geometry.back_of(mesh), number, uv_sets(back), binary))
        nodes.append({"mesh": len(meshes), "name": mesh.name})
        meshes.append({"name": mesh.name, "primitives": primitives})
    if not meshes:
        raise ValueError(f"asset: scene '{scene.name}' has no triangle; nothing can be written")
    document["meshes"], document["nodes"] = meshes, nodes
    for name in ("materials", "textures", "samplers", "images"):
        if entries := getattr(table, name):
            document[name] = entries
    document["extensionsUsed"] = sorted(table.extensions)
    return {k: [found for (of, _), found in index_of.items() if of == k] for k, _ in index_of}


def _lit_material(material: Material, mesh: Mesh) -> Material:
    """The material of a mesh; emissive when the mesh emits light and its material does not."""
    if max(mesh.emission) > 0 and max(material.emissive) <= 0:
        red, green, blue = mesh.emission
        return replace(material, emissive=(float(red), float(green), float(blue)))
    return material


def _add_lights_and_cameras(document: dict[str, Any], scene: Scene) -> None:
    nodes = document["nodes"]
    if scene.lights:
        lights = [geometry.light_entry(light) for light in scene.lights]
        document["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
        document["extensionsUsed"].append("KHR_lights_punctual")
        nodes += [geometry.light_node(light, i) for i, light in enumerate(scene.lights)]
    if scene.cameras:
        document["cameras"] = [geometry.camera_entry(camera) for camera in scene.cameras]
        nodes += [geometry.camera_node(camera, i) for i, camera in enumerate(scene.cameras)]


def extension_json(
    fields: Sequence[FieldEntry],
    variables: Sequence[dict[str, Any]],
    binary: Binary,
    document: dict[str, Any] | None = None,
    lamps: Sequence[LampEntry] = (),
    probes: Sequence[FieldEntry] = (),
) -> dict[str, Any]:
    """Convert fields, variables and lamps to the JSON of the extension.

    Args:
        fields: Baked fields.
        variables: JSON objects of the variables.
        binary: Receives the bytes of the buffers and pictures.
        document: glTF JSON whose texture tables receive the pictures; None when no field has one.
        lamps: Groups of the scene's own lights; a file without them, probes, and kinds of variables of
            version 2 has version 1.
        probes: The same light in the air.

    Returns:
        The JSON of the extension.
    """
    document = {} if document is None else document
    newer = lamps or probes or any("sky" in variable or variable["kind"] in NEWER for variable in variables)
    head = {"version": VERSION_WITH_LAMPS_OR_SKY if newer else VERSION, "variables": list(variables)}
    entries = {"fields": [_field_json(field, binary, document) for field in fields]}
    if probes:
        entries["probes"] = [_field_json(field, binary, document) for field in probes]
    return head | ({"lamps": [lamp.json() for lamp in lamps]} if lamps else {}) | entries


def _field_json(field: FieldEntry, binary: Binary, document: dict[str, Any]) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": field.name, "role": field.role, "graph": _graph_json(field, binary, document)}
    return entry if field.variable is None else {**entry, "variable": field.variable}


def _graph_json(field: FieldEntry, binary: Binary, document: dict[str, Any]) -> dict[str, Any]:
    """The graph's JSON, with an accessor or a texture added to every buffer."""
    from lightwell.graph import graph_to_json

    graph, arrays = graph_to_json(field.graph)
    buffers = {}
    for name, entry in graph["buffers"].items():
        if name not in field.pictures:
            buffers[name] = {**entry, "accessor": binary.add_accessor(buffer_bits(arrays[name]))}
            continue
        picture = field.pictures[name]
        check_picture(name, picture, arrays[name])
        buffers[name] = {**entry, "texture": add_texture(document, binary, picture), "mips": picture.mips}
    return {**graph, "buffers": buffers}


def buffer_bits(array: np.ndarray) -> np.ndarray:
    """Return a graph buffer in the form in which it is stored.

    Args:
        array: Buffer of any shape.

    Returns:
        [count] numbers in row-major order; float16 as the same bits in uint16.
    """
    flat = np.ascontiguousarray(array).reshape(-1)
    return flat.view(np.uint16) if flat.dtype == np.float16 else flat
