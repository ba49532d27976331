"""Layers of a network as nodes of a graph."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from lightwell.graph.buffers import Buffer
from lightwell.graph.builder import Builder

Layer = tuple[np.ndarray | Buffer, np.ndarray | Buffer]
"""Weights [out, in] and bias [out]; with an index, [E, out, in] and [E, out]."""


def add_layers(
    b: Builder,
    x: str,
    layers: Iterable[Layer],
    activations: Sequence[str | None],
    index: str | None = None,
    per_frame: bool = False,
) -> str:
    """Add the layers of a network to a graph.

    Args:
        b: Graph to add nodes to.
        x: Name of the node with the inputs.
        layers: Weights and bias of each layer.
        activations: Activation of each layer; None: none.
        index: Name of the node that selects one of E networks; None: there is one network.
        per_frame: Whether the network depends on frame inputs only.

    Returns:
        Name of the node with the outputs of the last layer.
    """
    for (weights, bias), activation in zip(layers, activations, strict=True):
        x = b.linear(x, weights, bias, index=index, per_frame=per_frame)
        x = b.activate(x, activation, per_frame=per_frame) if activation else x
    return x
