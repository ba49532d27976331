"""Rounds the buffers of a graph to a smaller type."""

from __future__ import annotations

from dataclasses import replace

from lightwell.graph.buffers import pack
from lightwell.graph.graph import Graph


def quantise(graph: Graph, type: str = "float16", *, per_row: bool = True) -> Graph:
    """The same graph with smaller buffers, rounded to nearest.

    ``float16`` halves everything. ``int8`` stores weights with a symmetric step per output row (``per_row=False``: one
    step a buffer) and tables with one step; biases stay float16, because they are few and their rounding does not
    average out.
    """
    biases = {use.params["bias"] for use in graph.uses if "bias" in use.params}
    tables = {use.params["buffer"] for use in graph.uses if "buffer" in use.params}
    buffers = {}
    for name, buffer in graph.buffers.items():
        kind = "float16" if type in ("int8", "uint8") and name in biases else type
        buffers[name] = pack(buffer.values(), kind, per_row=per_row and name not in tables)
    return replace(graph, buffers=buffers)
