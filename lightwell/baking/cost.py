"""What a shading graph costs to store and to run."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import TypedDict

import numpy as np

from lightwell.graph import Graph


class Cost(TypedDict):
    """The cost fields of a report, summed over its graphs."""

    bytes: int
    """All buffers as stored."""
    compressed_bytes: int
    """... after zlib at its highest level."""
    parameters: int
    """Stored numbers, scales apart."""
    macs_per_pixel: int
    fetches_per_pixel: int
    """Table entries read."""


def cost(graphs: Sequence[Graph]) -> Cost:
    """The summed cost of the graphs that one pixel evaluates."""
    return Cost(
        bytes=sum(graph.nbytes for graph in graphs),
        compressed_bytes=sum(compressed_bytes(graph) for graph in graphs),
        parameters=sum(graph.parameters for graph in graphs),
        macs_per_pixel=sum(graph.macs for graph in graphs),
        fetches_per_pixel=sum(graph.fetches for graph in graphs),
    )


def compressed_bytes(graph: Graph) -> int:
    """Bytes of all buffers and their scales, in order, after zlib: brotli is not in the standard library."""
    parts = []
    for buffer in graph.buffers.values():
        parts.append(buffer.array.tobytes())
        if buffer.scale is not None:
            parts.append(np.asarray(buffer.scale, np.float32).tobytes())
    return len(zlib.compress(b"".join(parts), 9))
