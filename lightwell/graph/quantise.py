"""Rounds the buffers of a graph to a smaller type."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lightwell.graph.buffers import UINT8_STEPS, Buffer, pack
from lightwell.graph.graph import Graph
from lightwell.graph.ops import OPS

# Tables that are read without interpolation: whole numbers in them are indices.
INDEX_TABLES = ("rows", "nearest")
# Largest magnitude up to which float16 holds every whole number.
FLOAT16_EXACT = 2048


def quantise(graph: Graph, type: str = "float16", *, per_row: bool = True) -> Graph:
    """Round the buffers of a graph to a smaller type.

    ``float16`` halves everything. ``int8`` stores weights with a symmetric step per output row and tables with one
    step; biases stay float16, because they are few and their rounding does not average out. The nodes of a ``tree``
    stay as they are, and a table of indices (whole numbers, read by ``rows`` or ``nearest``) takes the smallest type
    that holds each of them.

    Args:
        graph: Graph to round.
        type: "float32", "float16", "int8" or "uint8".
        per_row: False: one step for each buffer instead of one for each row of weights.

    Returns:
        The graph with new buffers.
    """
    biases = {use.params["bias"] for use in graph.uses if "bias" in use.params}
    tables = {use.params["buffer"] for use in graph.uses if "buffer" in use.params}
    exact, indices = _exact(graph), _indices(graph)
    buffers = {}
    for name, buffer in graph.buffers.items():
        if name in exact:
            buffers[name] = buffer
        elif name in indices:
            buffers[name] = pack_indices(buffer.values())
        else:
            kind = "float16" if type in ("int8", "uint8") and name in biases else type
            buffers[name] = pack(buffer.values(), kind, per_row=per_row and name not in tables)
    return replace(graph, buffers=buffers)


def _exact(graph: Graph) -> set[str]:
    """Names of the buffers that some op needs unrounded."""
    return {
        use.params[name]
        for node, use in zip(graph.nodes, graph.uses)
        for name, parameter in OPS[node.op].parameters.items()
        if parameter.exact
    }


def _indices(graph: Graph) -> set[str]:
    """Names of the tables of whole numbers that are read without interpolation."""
    read = {use.params["buffer"] for node, use in zip(graph.nodes, graph.uses) if node.op in INDEX_TABLES}
    return {name for name in read if np.array_equal(values := graph.buffers[name].values(), np.rint(values))}


def pack_indices(values: np.ndarray) -> Buffer:
    """Store whole numbers without loss: as bytes where their range allows, else as float16, else as float32.

    Args:
        values: [...] whole numbers.

    Returns:
        The buffer.
    """
    low, high = float(values.min()), float(values.max())
    if high - low <= UINT8_STEPS:
        return Buffer((values - np.float32(low)).astype(np.uint8), "uint8", np.float32(1), low)
    return pack(values, "float16" if max(-low, high) <= FLOAT16_EXACT else "float32")
