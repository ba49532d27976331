"""Parts of shading graphs that several fields lower to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from lightwell.graph import Buffer, Builder
from lightwell.graph.layers import Layer

# Keeps 1/reflectance finite where the learned value is radiance.
REFLECTANCE_FLOOR = 1e-9


def graph_layers(
    weights: Mapping[str, np.ndarray],
    numbers: Iterable[int],
    store: Callable[[np.ndarray], Buffer | np.ndarray] = lambda values: values,
    prefix: str = "",
) -> list[Layer]:
    """Convert trained weights to those of the graph's op ``linear``.

    Args:
        weights: ``w0 [in, out], b0 [1, out], …``, or with one more axis E in front.
        numbers: Numbers of the layers.
        store: Converts an array [...] to the type in which it is stored.
        prefix: First part of the names.

    Returns:
        Weights [out, in] and bias [out] of each layer, or [E, out, in] and [E, out].
    """
    pairs = ((weights[f"{prefix}w{k}"], weights[f"{prefix}b{k}"]) for k in numbers)
    return [(store(np.swapaxes(w, -1, -2)), store(b[..., 0, :])) for w, b in pairs]


def as_radiance(b: Builder, x: str, demodulated: bool, unit: float) -> str:
    """Convert a network's output to the output of the graph: radiance divided by the reflectance.

    Args:
        b: Graph to add nodes to.
        x: Name of the node with the network's output, width 3.
        demodulated: Whether the network's targets were divided by the reflectance.
        unit: Radiance unit S.

    Returns:
        Name of the new node, width 3.
    """
    if not demodulated:
        x = b.multiply(x, b.reciprocal("reflectance", REFLECTANCE_FLOOR))
    return b.scale(x, unit)
