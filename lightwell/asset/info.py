"""Summarises an asset: counts, sizes and cost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lightwell.asset.container import read_file, refusing
from lightwell.asset.read import read_light
from lightwell.asset.records import EXTENSION, FieldEntry
from lightwell.limits import Limits

# glTF primitive mode of separate triangles, the default.
TRIANGLES = 4


def info(path: str | Path, limits: Limits | None = None) -> dict[str, Any]:
    """Count the content of a GLB.

    Args:
        path: The file.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.

    Returns:
        Bytes of the file, its generator, numbers of triangles, vertices, meshes, materials, images, cameras and lights;
        ``fields`` (name, role, variable, nodes, bytes of the buffers, multiply-adds per pixel and per frame) and
        ``variables``, both empty for a GLB without learned light; ``probes``, the same of the light in the air;
        ``lamps``, names of its lights with a switch; sums ``field_bytes``, ``probe_bytes`` and ``macs_per_pixel``.
    """
    document, _ = read_file(path, limits)
    with refusing(path):
        counts = _counts(document)
        baked = EXTENSION in document.get("extensions", {})
    fields, probes, variables = read_light(path, limits) if baked else ([], [], [])
    return {
        "path": str(path),
        "bytes": Path(path).stat().st_size,
        **counts,
        "variables": variables,
        "lamps": [lamp["name"] for lamp in document.get("extensions", {}).get(EXTENSION, {}).get("lamps", [])],
        "fields": [_field(field) for field in fields],
        "probes": [_field(field) for field in probes],
        "field_bytes": sum(field.graph.nbytes for field in fields),
        "probe_bytes": sum(field.graph.nbytes for field in probes),
        "macs_per_pixel": sum(field.graph.macs for field in fields),
    }


def _field(field: FieldEntry) -> dict[str, Any]:
    return {
        "name": field.name,
        "role": field.role,
        "variable": field.variable,
        "nodes": len(field.graph.nodes),
        "bytes": field.graph.nbytes,
        "macs": field.graph.macs,
        "macs_per_frame": field.graph.macs_per_frame,
    }


def _counts(document: dict[str, Any]) -> dict[str, Any]:
    """Sizes of the tables; triangles and vertices of all meshes, each counted once however often it is placed."""
    triangles = vertices = 0
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            count = int(document["accessors"][primitive["attributes"]["POSITION"]]["count"])
            corners = int(document["accessors"][primitive["indices"]]["count"]) if "indices" in primitive else count
            vertices += count
            triangles += corners // 3 if primitive.get("mode", TRIANGLES) == TRIANGLES else 0
    return {
        "generator": str(document["asset"].get("generator", "")),
        "triangles": triangles,
        "vertices": vertices,
        **{name: len(document.get(name, [])) for name in ("meshes", "materials", "images", "cameras")},
        "lights": len(document.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", [])),
    }
