"""Reads the learned light of an asset; every part of the file is checked before it is used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lightwell.asset.container import COMPONENT_TYPES, read_file, refusing
from lightwell.asset.pictures import decoded_texels, image_index
from lightwell.asset.records import EXTENSION, FieldEntry
from lightwell.asset.schema import validate
from lightwell.limits import Limits, LoadBudget

if TYPE_CHECKING:
    from lightwell.graph import Graph
    from lightwell.graph.budget import GraphBudget

# Members of a buffer that locate its numbers in the file; the graph reads the other members.
CARRIERS = ("accessor", "texture", "mips")
# Stored types of the types of graph buffers; float16 is stored as the bits of a uint16.
STORED_TYPES: dict[str, np.dtype[Any]] = {
    "float32": np.dtype("float32"),
    "float16": np.dtype("uint16"),
    "int8": np.dtype("int8"),
    "uint8": np.dtype("uint8"),
}


def read_fields(path: str | Path, limits: Limits | None = None) -> tuple[list[FieldEntry], list[dict[str, Any]]]:
    """Read the fields and the variables of a baked GLB.

    The file is not trusted: anything that does not follow format/FORMAT.md exactly is refused.

    Args:
        path: The file.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.

    Returns:
        The fields with their graphs, and the JSON of the variables.

    Raises:
        ValueError: The file has no learned light, breaks the format or exceeds the limits; one line that names the
            file and the place.
    """
    fields, _, variables = read_light(path, limits)
    return fields, variables


def read_light(
    path: str | Path, limits: Limits | None = None
) -> tuple[list[FieldEntry], list[FieldEntry], list[dict[str, Any]]]:
    """Read the fields, the probes and the variables of a baked GLB; see ``read_fields``.

    Args:
        path: The file.
        limits: As for ``read_fields``.

    Returns:
        The fields and the probes with their graphs, and the JSON of the variables.

    Raises:
        ValueError: As ``read_fields``.
    """
    document, binary = read_file(path, limits)
    budget = (limits or Limits()).budget(f"asset: '{path}'")
    try:
        with refusing(path):
            return _light(document, binary, budget)
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith("asset: ") else f"asset: '{path}': {text}") from error


def refuse_moving(fields: Sequence[FieldEntry], verb: str, cure: str = "") -> None:
    """Refuse fields that follow a node that moves, for what knows one pose.

    Args:
        fields: The fields of a file.
        verb: What cannot take them, for the message.
        cure: What else can be done, before "bake without".

    Raises:
        ValueError: A field reads the pose of a node.
    """
    for field in fields:
        if "pose" in field.graph.inputs:
            raise ValueError(
                f"{verb}: field '{field.name}' follows a node that moves, which only lightwell's own page and runtime "
                f"for three.js play; {cure}bake without --vary node:…"
            )


def _light(
    document: dict[str, Any], binary: bytes, budget: LoadBudget
) -> tuple[list[FieldEntry], list[FieldEntry], list[dict[str, Any]]]:
    extensions = document.get("extensions")
    extension = extensions.get(EXTENSION) if isinstance(extensions, dict) else None
    if extension is None:
        raise ValueError(f"has no {EXTENSION}; bake the scene with 'lightwell bake' first")
    validate(extension)
    found = {what: extension.get(what, []) for what in ("fields", "probes")}
    _charge(document, [*found["fields"], *found["probes"]], budget)
    fields, probes = (_entries(document, binary, found[what], what, budget) for what in found)
    return fields, probes, extension["variables"]


def _entries(
    document: dict[str, Any], binary: bytes, entries: list[dict[str, Any]], what: str, budget: LoadBudget
) -> list[FieldEntry]:
    """Read fields or probes. A surface evaluates all of the one or of the other, so that each has the whole work."""
    from lightwell.graph.budget import BUDGET, graph_work

    allowed, work, found = replace(BUDGET, work=int(budget.limits.work)), 0, []
    for entry in entries:
        where = f"{'field' if what == 'fields' else 'probes'} '{entry['name']}'"
        budget.check_time(where)
        try:
            graph = _graph(entry["graph"], document, binary, allowed)
            work += graph_work(graph)
            budget.check("work", work, f"its {what}")
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from error
        found.append(FieldEntry(entry["name"], entry["role"], graph, entry.get("variable")))
    return found


def _charge(document: dict[str, Any], fields: list[dict[str, Any]], budget: LoadBudget) -> None:
    """Charge all buffers by their declared shapes before any is read; a picture is charged once."""
    pictures = set()
    for entry in fields:
        for name, buffer in entry["graph"].get("buffers", {}).items():
            where, size = f"field '{entry['name']}': buffer '{name}'", math.prod(buffer["shape"])
            if "texture" not in buffer:
                budget.charge("decoded_bytes", size * STORED_TYPES[buffer["type"]].itemsize, where)
                continue
            image = image_index(_entry(document, "textures", buffer["texture"], where))
            if str(image) not in pictures:
                pictures.add(str(image))
                height, width = (*buffer["shape"], 1)[:2]
                budget.check_picture(width, height, where)


def _graph(entry: dict[str, Any], document: dict[str, Any], binary: bytes, budget: GraphBudget) -> Graph:
    from lightwell.graph import OUTPUT_WIDTHS, graph_from_json

    buffers = entry.get("buffers", {})
    arrays = {name: _stored(document, binary, name, buffer) for name, buffer in buffers.items()}
    bare = {name: {k: v for k, v in buffer.items() if k not in CARRIERS} for name, buffer in buffers.items()}
    graph = graph_from_json({**entry, "buffers": bare}, arrays, budget)
    for name, expected in OUTPUT_WIDTHS.items():
        if name in graph.outputs and (width := graph.widths[graph.outputs[name]]) != expected:
            raise ValueError(f"its output '{name}' has width {width}, expected {expected}")
    return graph


def _stored(document: dict[str, Any], binary: bytes, name: str, buffer: dict[str, Any]) -> np.ndarray:
    """The array of a graph buffer from its accessor or its picture."""
    if "texture" not in buffer:
        return buffer_array(document, binary, name, buffer)
    where = f"buffer '{name}'"
    texture = _entry(document, "textures", buffer["texture"], where)
    image = _entry(document, "images", image_index(texture), where)
    view = _entry(document, "bufferViews", image.get("bufferView"), where)
    data = _accessor_bytes(document, binary, image, _whole(view, "byteLength", where, None), where)
    return decoded_texels(bytes(data), buffer, where)


def buffer_array(document: dict[str, Any], binary: bytes, name: str, buffer: dict[str, Any]) -> np.ndarray:
    """Read the array of a graph buffer from its accessor.

    Args:
        document: The glTF JSON.
        binary: Content of the binary chunk.
        name: Name of the buffer, for messages.
        buffer: Declaration of the buffer: ``shape``, ``type`` and ``accessor``.

    Returns:
        Array of the declared shape and type; a copy, so that ``binary`` can be freed.

    Raises:
        ValueError: The accessor does not fit the declaration or the file, or a number is NaN or infinite.
    """
    where = f"buffer '{name}'"
    stored = STORED_TYPES[buffer["type"]]
    count = math.prod(buffer["shape"])
    accessor = _entry(document, "accessors", buffer["accessor"], where)
    expected = {"type": "SCALAR", "componentType": COMPONENT_TYPES[stored], "count": count}
    for key, value in expected.items():
        if accessor.get(key) != value or isinstance(accessor.get(key), bool):
            raise ValueError(f"{where}: its accessor has {key} {str(accessor.get(key))[:40]}, expected {value}")
    if "sparse" in accessor or accessor.get("normalized"):
        raise ValueError(f"{where}: its accessor is sparse or normalized, which is not allowed")
    data = _accessor_bytes(document, binary, accessor, count * stored.itemsize, where)
    array = np.frombuffer(data, stored.newbyteorder("<")).astype(stored)
    array = array.view(np.dtype(buffer["type"])).reshape(buffer["shape"])
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise ValueError(f"{where}: contains NaN or infinity")
    return array


def _accessor_bytes(
    document: dict[str, Any], binary: bytes, accessor: dict[str, Any], size: int, where: str
) -> memoryview:
    """The ``size`` bytes of an accessor, checked against its buffer view and the binary chunk."""
    view = _entry(document, "bufferViews", accessor.get("bufferView"), where)
    if _whole(view, "buffer", where, None) != 0 or "byteStride" in view:
        raise ValueError(f"{where}: its buffer view must be packed and in the file's own binary chunk")
    start, inner = _whole(view, "byteOffset", where), _whole(accessor, "byteOffset", where)
    length = _whole(view, "byteLength", where, None)
    if inner + size > length or start + length > len(binary):
        raise ValueError(f"{where}: its {size} bytes do not lie inside the file")
    return memoryview(binary)[start + inner : start + inner + size]


def _entry(document: dict[str, Any], table: str, index: Any, where: str) -> dict[str, Any]:
    """Entry ``index`` of a root table of the document."""
    entries = document.get(table)
    valid = isinstance(index, int) and not isinstance(index, bool)
    if isinstance(entries, list) and valid and 0 <= index < len(entries) and isinstance(entries[index], dict):
        return entries[index]
    raise ValueError(f"{where}: {table}[{str(index)[:40]}] does not exist")


def _whole(entry: dict[str, Any], key: str, where: str, default: int | None = 0) -> int:
    """A non-negative integer member."""
    value = entry.get(key, default)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{where}: {key} is {str(value)[:40]}, expected a non-negative integer")
    return value
