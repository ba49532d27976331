"""The NumPy evaluator. It defines what a shading graph means; every other evaluator is tested against it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lightwell.graph.graph import Graph
from lightwell.graph.ops import OPS


def evaluate(graph: Graph, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Evaluate a graph at N points with NumPy. This defines what a graph means.

    Args:
        graph: Graph to evaluate.
        inputs: Name of each input to its values, [N, C] or [1, C].

    Returns:
        Name of each output to its values, [N, C] float32.

    Raises:
        ValueError: An input has another number of points than the others.
    """
    values = {name: _input(graph, inputs, name) for name in graph.inputs}
    points = max(len(value) for value in values.values())
    for name, value in values.items():
        if len(value) not in (1, points):
            raise ValueError(f"graph: input '{name}': expected {points} points or 1, found {len(value)}; repeat it")
        values[name] = np.broadcast_to(value, (points, value.shape[1]))
    for node, use in zip(graph.nodes, graph.uses):
        value = OPS[node.op].numpy(use, *(values[name] for name in node.inputs))
        values[node.id] = value.astype(np.float32, copy=False)
    return {name: values[value] for name, value in graph.outputs.items()}


def _input(graph: Graph, inputs: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    width = graph.inputs[name]
    if name not in inputs:
        raise ValueError(f"graph: input '{name}': expected [N, {width}], found nothing; pass it")
    value = np.asarray(inputs[name], np.float32)
    if value.ndim != 2 or value.shape[1] != width:
        raise ValueError(f"graph: input '{name}': expected [N, {width}], found {list(value.shape)}; reshape it")
    return value
