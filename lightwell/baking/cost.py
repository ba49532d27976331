"""The cost of storing and evaluating shading graphs."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from typing import TypedDict

import numpy as np

from lightwell.fields.protocol import Lowered
from lightwell.graph import Buffer


class Cost(TypedDict):
    """The cost of fields in a report, summed over their graphs."""

    bytes: int
    """All buffers as stored."""
    compressed_bytes: int
    """... after zlib at its highest level."""
    parameters: int
    """Stored numbers without scales."""
    macs_per_pixel: int
    fetches_per_pixel: int
    """Table entries read."""


def cost(fields: Sequence[Lowered]) -> Cost:
    """Sum the cost of the fields that one pixel evaluates; a picture counts as its encoded bytes.

    Args:
        fields: Graphs as they are written.

    Returns:
        The cost.
    """
    graphs = [field.graph for field in fields]
    return Cost(
        bytes=sum(_stored(field, lambda buffer: buffer.nbytes) for field in fields),
        compressed_bytes=sum(compressed_bytes(field) for field in fields),
        parameters=sum(graph.parameters for graph in graphs),
        macs_per_pixel=sum(graph.macs for graph in graphs),
        fetches_per_pixel=sum(graph.fetches for graph in graphs),
    )


def _stored(field: Lowered, size: Callable[[Buffer], int]) -> int:
    weights = sum(size(buffer) for name, buffer in field.graph.buffers.items() if name not in field.pictures)
    return weights + sum(len(picture.data) for picture in field.pictures.values())


def compressed_bytes(field: Lowered) -> int:
    """Count the bytes of all weights and their scales after zlib (brotli is not in the standard library), and of
    pictures.

    Args:
        field: Graph as it is written; its pictures are compressed already.

    Returns:
        Bytes.
    """
    parts = []
    for name, buffer in field.graph.buffers.items():
        if name in field.pictures:
            continue
        parts.append(buffer.array.tobytes())
        if buffer.scale is not None:
            parts.append(np.asarray(buffer.scale, np.float32).tobytes())
    packed = len(zlib.compress(b"".join(parts), 9)) if parts else 0
    return packed + sum(len(picture.data) for picture in field.pictures.values())
