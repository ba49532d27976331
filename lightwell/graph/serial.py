"""The JSON of a shading graph, as `format/FORMAT.md` describes it: schema, writing, reading what strangers wrote."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from lightwell.graph.budget import BUDGET, GraphBudget, check_budget
from lightwell.graph.buffers import TYPES, Buffer
from lightwell.graph.graph import MAX_INPUTS, NAME, Graph, Node
from lightwell.graph.ops import OPS, Op, Parameter
from lightwell.graph.ops.op import MAX_ELEMENTS, MAX_NODES, MAX_NUMBER, MAX_WIDTH

VERSION = 1
# Reserved keys of a node; all others are parameters.
NODE_KEYS = ("id", "op", "inputs", "per_frame")

_NAME = {"type": "string", "pattern": "^" + NAME.pattern.replace("\\Z", "$"), "maxLength": 64}
_NUMBER = {"type": "number", "minimum": -MAX_NUMBER, "maximum": MAX_NUMBER}


def _parameter_schema(p: Parameter) -> dict[str, Any]:
    if p.kind == "choice":
        return {"enum": list(p.choices)}
    if p.kind == "buffer":
        return _NAME
    if p.kind == "numbers":
        return {"type": "array", "items": _NUMBER, "minItems": 1, "maxItems": MAX_WIDTH}
    return {"type": p.kind, "minimum": p.low, "maximum": p.high}


def _op_schema(op: Op) -> dict[str, Any]:
    """What a node of one op must look like, applied when its ``op`` says so."""
    properties = {
        "id": True,
        "op": True,
        "per_frame": True,
        "inputs": {"minItems": op.arity[0], "maxItems": op.arity[1]},
    }
    properties |= {name: _parameter_schema(p) for name, p in op.parameters.items()}
    then = {"properties": properties, "required": list(op.parameters), "additionalProperties": False}
    return {"if": {"properties": {"op": {"const": op.name}}, "required": ["op"]}, "then": then}


def _node_schema() -> dict[str, Any]:
    return {
        "type": "object",
        "properties": {
            "id": _NAME,
            "op": {"enum": sorted(OPS)},
            "inputs": {"type": "array", "items": _NAME},
            "per_frame": {"type": "boolean"},
        },
        "required": ["id", "op", "inputs"],
        "allOf": [_op_schema(OPS[name]) for name in sorted(OPS)],
    }


def _buffer_schema() -> dict[str, Any]:
    dimension = {"type": "integer", "minimum": 1, "maximum": MAX_ELEMENTS}
    return {
        "type": "object",
        "properties": {
            "shape": {"type": "array", "items": dimension, "minItems": 1, "maxItems": 4},
            "type": {"enum": list(TYPES)},
            "scale": {"oneOf": [_NUMBER, {"type": "array", "items": _NUMBER, "minItems": 1, "maxItems": MAX_ELEMENTS}]},
            "offset": _NUMBER,
            "accessor": {"type": "integer", "minimum": 0},
            "texture": {"type": "integer", "minimum": 0},
            "mips": {"type": "integer", "minimum": 0},
        },
        "required": ["shape", "type"],
        "additionalProperties": False,
    }


@cache
def schema() -> dict[str, Any]:
    """Build the JSON schema of a graph from the registered ops.

    Returns:
        A JSON schema (draft 2020-12).
    """
    names = {"type": "object", "propertyNames": _NAME}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "lightwell shading graph",
        "type": "object",
        "properties": {
            "version": {"const": VERSION},
            "inputs": names
            | {
                "additionalProperties": {"type": "integer", "minimum": 1, "maximum": MAX_WIDTH},
                "minProperties": 1,
                "maxProperties": MAX_INPUTS,
            },
            "buffers": names | {"additionalProperties": _buffer_schema()},
            "nodes": {"type": "array", "items": _node_schema(), "minItems": 1, "maxItems": MAX_NODES},
            "outputs": names | {"additionalProperties": _NAME, "minProperties": 1, "maxProperties": MAX_INPUTS},
        },
        "required": ["version", "inputs", "buffers", "nodes", "outputs"],
        "additionalProperties": False,
    }


def graph_to_json(graph: Graph) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Write a graph as JSON.

    Args:
        graph: Graph to write.

    Returns:
        The document of ``format/FORMAT.md``, and the stored arrays by buffer name.
    """
    document = {
        "version": VERSION,
        "inputs": dict(graph.inputs),
        "buffers": {name: _buffer_json(buffer) for name, buffer in graph.buffers.items()},
        "nodes": [_node_json(node) for node in graph.nodes],
        "outputs": dict(graph.outputs),
    }
    return document, {name: buffer.array for name, buffer in graph.buffers.items()}


def _buffer_json(buffer: Buffer) -> dict[str, Any]:
    out: dict[str, Any] = {"shape": list(buffer.shape), "type": buffer.type}
    if buffer.scale is not None:
        scale = [float(s) for s in buffer.scale.ravel()]
        out |= {"scale": scale[0] if len(scale) == 1 else scale}
        out |= {"offset": float(buffer.offset)} if buffer.offset else {}
    return out


def _node_json(node: Node) -> dict[str, Any]:
    out: dict[str, Any] = {"id": node.id, "op": node.op, "inputs": list(node.inputs)}
    out |= {name: list(value) if isinstance(value, tuple) else value for name, value in node.params.items()}
    return out | ({"per_frame": True} if node.per_frame else {})


def graph_from_json(document: Any, arrays: Mapping[str, np.ndarray], budget: GraphBudget = BUDGET) -> Graph:
    """Check a JSON document and make its graph.

    Args:
        document: Parsed JSON of ``format/FORMAT.md``, from anyone.
        arrays: Buffer name to its stored numbers, of any shape of the right size.
        budget: What the graph may ask for.

    Returns:
        The graph.
    """
    _check_schema(document)
    buffers = {name: _read_buffer(name, spec, arrays) for name, spec in document["buffers"].items()}
    nodes = [
        Node(
            spec["id"],
            spec["op"],
            tuple(spec["inputs"]),
            {name: value for name, value in spec.items() if name not in NODE_KEYS},
            spec.get("per_frame", False),
        )
        for spec in document["nodes"]
    ]
    inputs = {name: int(width) for name, width in document["inputs"].items()}
    graph = Graph(inputs, buffers, tuple(nodes), document["outputs"])
    check_budget(graph, budget)
    return graph


@cache
def _validator() -> Any:
    from jsonschema import Draft202012Validator

    return Draft202012Validator(schema())


def _check_schema(document: Any) -> None:
    try:
        error = next(_validator().iter_errors(document), None)
        if error is None:
            return
        message = error.message
    except (RecursionError, OverflowError, ValueError):
        raise ValueError(
            "graph: expected plain JSON, found numbers or nesting beyond all use; export it again"
        ) from None
    path = list(error.absolute_path)
    where = "/".join(map(str, path))[:120] or "document"
    if len(path) >= 2 and path[0] == "nodes" and isinstance(document["nodes"][path[1]], dict):
        name = document["nodes"][path[1]].get("id")
        where = f"node '{name}'" if isinstance(name, str) and len(name) <= 64 else f"node {path[1]}"
        where += f", '{path[2]}'" if len(path) > 2 else ""
    shown = message if len(message) <= 200 else f"{message[:90]} … {message[-90:]}"
    shown = " ".join(shown.split())
    raise ValueError(f"graph: {where}: {shown}; compare it with format/FORMAT.md")


def _read_buffer(name: str, spec: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Buffer:
    shape = tuple(int(s) for s in spec["shape"])
    size = 1
    for s in shape:
        size *= s
    if size > MAX_ELEMENTS:
        raise ValueError(
            f"graph: buffer '{name}': expected at most {MAX_ELEMENTS} numbers, found {size}; split the field"
        )
    if name not in arrays:
        raise ValueError(
            f"graph: buffer '{name}': expected its numbers beside the JSON, found none; pass them in arrays"
        )
    array = np.asarray(arrays[name])
    if array.dtype != TYPES[spec["type"]] or array.size != size:
        raise ValueError(
            f"graph: buffer '{name}': expected {size} numbers of {spec['type']} for shape {list(shape)}, "
            f"found {array.size} of {array.dtype}; export the file again"
        )
    if "scale" not in spec and spec.get("offset"):
        raise ValueError(f"graph: buffer '{name}': expected a scale beside the offset, found none; add 'scale'")
    scale = np.asarray(spec["scale"], np.float32) if "scale" in spec else None
    return Buffer(array.reshape(shape), spec["type"], scale, float(spec.get("offset", 0.0)))
