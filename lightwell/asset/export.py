"""Prints a learned field as one self-contained shader: `lightwell export` (docs/web.md).

The printer is that of the web runtime, built into `lightwell/graph/exporter.js`, so that the page and the command
line share one implementation. It needs a JavaScript engine: Node where it is installed, else the package mini-racer.
"""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.asset.container import read_file, refusing
from lightwell.asset.read import read_light
from lightwell.asset.records import EXTENSION, MOVING, FieldEntry
from lightwell.files import write_atomically
from lightwell.graph import graph_to_json
from lightwell.graph.budget import graph_work
from lightwell.graph.pictures import encode
from lightwell.limits import Limits

TARGETS = ("glsl", "wgsl", "shadertoy", "hlsl", "msl", "gdshader")
# Where weights may be; the empty word chooses by the size of the network.
WEIGHTS = ("", "inline", "table")
# Default ending of the written file.
ENDINGS = {
    "glsl": ".glsl",
    "wgsl": ".wgsl",
    "shadertoy": ".shadertoy.glsl",
    "hlsl": ".hlsl",
    "msl": ".metal",
    "gdshader": ".gdshaderinc",
}
# Begins the names of probes.
PROBES = "probes:"
# Seconds that printing may take: the largest field that FORMAT.md allows takes a few.
TIMEOUT = 120
# Reads the exporter's path and the request, writes the answer.
NODE_PROGRAM = (
    "const fs=require('fs');require('vm').runInThisContext(fs.readFileSync(process.argv[1],'utf8'));"
    "process.stdout.write(lightwellExport(fs.readFileSync(0,'utf8')));"
)
CURE = "install Node (nodejs.org), or: pip install 'lightwell[export]'"


@dataclass(frozen=True)
class Exported:
    """A printed shader and the data that its host must bind."""

    text: str
    """Source of the shader."""
    tables: dict[str, bytes]
    """Little-endian numbers by name of the uniform, four per texel; the shader's header gives size and format."""
    pictures: dict[str, bytes]
    """PNG files by name of the uniform."""
    sizes: dict[str, tuple[int, int, str]]
    """Width and height in texels and format of each table: rgba16float, rgba32float or storage."""


def export_field(
    path: str | Path,
    to: str,
    *,
    field: str = "",
    name: str = "lightwell",
    weights: str = "",
    limits: Limits | None = None,
) -> Exported:
    """Print the radiance of a field of a baked asset, or of its probes, as shader source.

    Args:
        path: A GLB, or the folder of a bake.
        to: Target language, one of ``TARGETS``.
        field: Name of the field, or ``probes:NAME`` for the probes of that name; "" takes the first field.
        name: Name of the printed function.
        weights: "inline" (literals in the text) or "table" (textures); "" chooses literals up to 16,384 multiply-adds.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.

    Returns:
        The shader and the data that its host must bind.

    Raises:
        ValueError: The target, the field or the place of the weights is unknown, the asset is not valid, or the field
            cannot be printed.
    """
    if to not in TARGETS:
        raise ValueError(f"export: expected --to {', '.join(TARGETS)}, found '{to}'; choose one of them")
    if weights not in WEIGHTS:
        raise ValueError(f"export: expected --weights inline or table, found '{weights}'; choose one of them")
    path = Path(path) / "scene.glb" if Path(path).is_dir() else Path(path)
    fields, probes, variables = read_light(path, limits)
    entry = _named([*fields, *(replace(entry, name=PROBES + entry.name) for entry in probes)], field, path)
    document, _ = read_file(path, limits)
    with refusing(path):
        request, bounds = _request(entry, document), _bounds(document)
    small = entry.graph.macs + entry.graph.macs_per_frame <= 16384
    request["options"] = {
        "to": to,
        "name": name,
        "title": entry.name,
        "weights": weights or ("inline" if small else "table"),
        "bounds": bounds,
        "movers": [_range(variable) for variable in variables if variable["kind"] in MOVING],
    }
    # The exporter's own budget is set to the work of this asset, which has passed its limits.
    request["work"] = graph_work(entry.graph)
    answer = json.loads(run_exporter(json.dumps(request)))
    if "error" in answer:
        raise ValueError(f"export: field '{entry.name}': {answer['error']}")
    tables = {table["name"]: base64.b64decode(table["data"]) for table in answer["tables"]}
    buffers = entry.graph.buffers
    pictures = {
        uniform: encode(np.asarray(buffers[buffer].array), "png").data for uniform, buffer in answer["pictures"].items()
    }
    sizes = {table["name"]: (table["width"], table["height"], table["format"]) for table in answer["tables"]}
    return Exported(answer["text"], tables, pictures, sizes)


def write_export(out: Path, exported: Exported) -> list[Path]:
    """Write a printed shader, and next to it one file per table (.bin) and picture (.png).

    Args:
        out: File for the shader text.
        exported: Result of ``export_field``.

    Returns:
        Paths of the written files; the shader is first.
    """
    files = {out: exported.text.encode()}
    files |= {out.with_name(f"{name}.bin"): data for name, data in exported.tables.items()}
    files |= {out.with_name(f"{name}.png"): data for name, data in exported.pictures.items()}
    for path, data in files.items():
        write_atomically(path, data)
    return list(files)


def _range(mover: dict[str, Any]) -> str:
    """Say between which values something moves, such as "Door, 0 to 90 degrees"."""
    low, high = mover["range"]
    return f"{mover['name']}, {low:g} to {high:g} {mover['unit']}"


def _named(fields: list[FieldEntry], name: str, path: Path) -> FieldEntry:
    for entry in fields:
        if name in ("", entry.name):
            return entry
    known = ", ".join(f"'{entry.name}'" for entry in fields)
    raise ValueError(f"export: '{path}' has no field '{name}'; it has {known}")


def _request(entry: FieldEntry, document: dict[str, Any]) -> dict[str, Any]:
    """The exporter's request: the graph, its arrays, and the mip levels of the buffers that are pictures."""
    graph, arrays = graph_to_json(entry.graph.only("radiance"))
    table, name = ("probes", entry.name[len(PROBES) :]) if entry.name.startswith(PROBES) else ("fields", entry.name)
    stored = next(f for f in document["extensions"][EXTENSION].get(table, ()) if f["name"] == name)["graph"]
    declared = stored.get("buffers", {})
    pictures = {name: declared[name].get("mips", 0) for name in graph["buffers"] if "texture" in declared[name]}
    numbers = {
        name: base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
        for name, array in arrays.items()
        if name not in pictures
    }
    return {"graph": graph, "arrays": numbers, "pictures": pictures}


def _bounds(document: dict[str, Any]) -> dict[str, list[float]]:
    """Bounding box of all positions; bakes are written in world space."""
    low, high = [], []
    for mesh in document.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            accessor = document["accessors"][primitive["attributes"]["POSITION"]]
            if "min" in accessor and "max" in accessor:
                low.append(_corner(accessor["min"]))
                high.append(_corner(accessor["max"]))
    if not low:
        return {"low": [-1.0] * 3, "high": [1.0] * 3}
    return {"low": np.min(low, axis=0).tolist(), "high": np.max(high, axis=0).tolist()}


def _corner(values: Any) -> list[float]:
    if not isinstance(values, list) or len(values) != 3 or not all(type(v) in (int, float) for v in values):
        raise TypeError(f"a corner of POSITION is {str(values)[:40]}, expected three numbers")
    return [float(v) for v in values]


def run_exporter(request: str) -> str:
    """Call the exporter `lightwell/graph/exporter.js` (source: web/exporter/main.ts).

    Args:
        request: The request, as JSON text.

    Returns:
        The answer, as JSON text.

    Raises:
        RuntimeError: There is no JavaScript engine, or Node failed.
    """
    script = resources.files("lightwell.graph").joinpath("exporter.js")
    node = shutil.which("node")
    if node:
        with resources.as_file(script) as path:
            command = [node, "-e", NODE_PROGRAM, str(path)]
            done = subprocess.run(command, input=request, capture_output=True, text=True, timeout=TIMEOUT, check=False)
        if done.returncode:
            raise RuntimeError(f"export: {node} failed: {done.stderr.strip()[-200:]}; {CURE}")
        return done.stdout
    try:
        from py_mini_racer import MiniRacer
    except ImportError as error:
        raise RuntimeError(f"export: printing shaders needs a JavaScript engine; {CURE}") from error
    engine = MiniRacer()
    engine.eval(script.read_text("utf-8"))
    return engine.call("lightwellExport", request)
