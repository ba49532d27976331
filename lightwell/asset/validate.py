"""Checks a whole file against format/LIGHTWELL_neural_radiance.md: `lightwell validate`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from lightwell.asset.animations import moving_problems, pointer_problems
from lightwell.asset.container import read_file, refusing
from lightwell.asset.read import read_fields
from lightwell.asset.records import EXTENSION
from lightwell.limits import Limits

# Vertex attributes by the graph input that reads them.
ATTRIBUTES = {"uv": "TEXCOORD_0", "uv1": "TEXCOORD_1"}

# What the web runtime takes, less than the schema allows: web/runtime/src/most.ts and extension.ts.
WEB_ENTRIES = {"variables": 4, "fields": 8, "probes": 8}
WEB_BUFFERS = 1024
WEB_NUMBERS = 1 << 26


def validate_file(path: str | Path, limits: Limits | None = None) -> list[str]:
    """List the places where a GLB does not follow the specification.

    The JSON, every buffer and every graph are read as a viewer would read them. In addition the extension must be
    declared and optional, meshes must have the texture coordinates that a field reads, what moves must be a node or an
    animation of the file, and animations of lamps must name lamps that exist and have a value for each time.

    Args:
        path: A GLB, or the folder of a bake.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.

    Returns:
        One line per problem; empty when the file follows the specification.
    """
    path = Path(path) / "scene.glb" if Path(path).is_dir() else Path(path)
    document, binary = read_file(path, limits)
    try:
        fields, _ = read_fields(path, limits)
    except ValueError as error:
        return [str(error)]
    problems = []
    with refusing(path):
        if EXTENSION not in document.get("extensionsUsed", ()):
            problems.append(f"extensionsUsed: {EXTENSION} is missing; list it")
        if EXTENSION in document.get("extensionsRequired", ()):
            problems.append(f"extensionsRequired: {EXTENSION} must be optional; remove it")
    wanted = {ATTRIBUTES[name] for field in fields for name in field.graph.inputs if name in ATTRIBUTES}
    with refusing(path):
        problems += _missing_coordinates(document, wanted) + _missing_nodes(document) + _missing_environment(document)
        return problems + moving_problems(document) + pointer_problems(document, binary)


def web_notes(path: str | Path, limits: Limits | None = None) -> list[str]:
    """List what the web runtime does not take of a GLB that follows the specification.

    Args:
        path: A GLB for which ``validate_file`` finds no problem, or the folder of a bake.
        limits: Largest file and memory that the asset may need; None for the defaults of ``Limits``.

    Returns:
        One line per limit that is exceeded; empty when a page shows the file.
    """
    path = Path(path) / "scene.glb" if Path(path).is_dir() else Path(path)
    extension = read_file(path, limits)[0]["extensions"][EXTENSION]
    notes = [
        f"{name}: {count}, more than the {most} that the web runtime takes; pages refuse the file"
        for name, most in WEB_ENTRIES.items()
        if (count := len(extension.get(name, ()))) > most
    ]
    for name in ("fields", "probes"):
        for k, entry in enumerate(extension.get(name, ())):
            sizes = [math.prod(buffer["shape"]) for buffer in entry["graph"]["buffers"].values()]
            if len(sizes) > WEB_BUFFERS or sum(sizes) > WEB_NUMBERS:
                notes.append(
                    f"{name}[{k}]: {len(sizes)} buffers with {sum(sizes)} numbers, more than the {WEB_BUFFERS} buffers "
                    f"or {WEB_NUMBERS} numbers that the web runtime takes in a graph; pages refuse the file"
                )
    return notes


def _missing_nodes(document: dict[str, Any]) -> list[str]:
    """Lamps whose nodes do not exist: their surfaces would not follow the switch."""
    known = {node.get("name") for node in document.get("nodes", ())}
    lamps = document["extensions"][EXTENSION].get("lamps", ())
    return [
        f"lamps[{k}]: no node is called '{name}'; name one of the file, or leave it out"
        for k, lamp in enumerate(lamps)
        for name in lamp["nodes"]
        if name not in known
    ]


def _missing_environment(document: dict[str, Any]) -> list[str]:
    """The picture of an environment that does not exist: nothing is shown behind the scene."""
    texture = document["extensions"][EXTENSION].get("environment", {}).get("texture", -1)
    if texture < len(document.get("textures", ())):
        return []
    return [f"environment: there is no texture {texture}; name one of the file, or leave it out"]


def _missing_coordinates(document: dict[str, Any], wanted: set[str]) -> list[str]:
    problems = []
    for i, mesh in enumerate(document.get("meshes", ())):
        for k, primitive in enumerate(mesh.get("primitives", ())):
            missing = sorted(wanted - set(primitive.get("attributes", ())))
            problems += [f"meshes[{i}].primitives[{k}]: no {name}, which a field reads" for name in missing]
    return problems
