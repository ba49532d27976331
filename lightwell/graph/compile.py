"""The Dr.Jit evaluator: a graph whose weights are uploaded and packed once, to be called inside kernels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from lightwell.graph.graph import Graph, Node
from lightwell.graph.ops import OPS, Op, Use


class Compiled:
    """A graph ready for Dr.Jit. Calling it only traces: it adds to the caller's kernel and copies nothing.

    Runs of ``linear`` and ``activate`` stay in cooperative vectors from one to the next. When every frame input is a
    single value (width 1, not one per point), the ``per_frame`` nodes are evaluated first, once. It is made for
    inference: the packed weights do not support reverse-mode derivatives.
    """

    graph: Graph
    """What is computed."""
    steps: list[tuple[Op, Use, Node]]
    """The op, its use with uploaded buffers, and the node, in evaluation order."""

    def __init__(self, graph: Graph) -> None:
        """Upload and pack the weights.

        Args:
            graph: Graph to evaluate.
        """
        self.graph = graph
        self.steps = []
        for node, use in zip(graph.nodes, graph.uses):
            op = OPS[node.op]
            self.steps.append((op, replace(use, state=op.prepare(use)), node))

    def __call__(
        self, inputs: Mapping[str, Any], settled: Mapping[str, list[Any]] | None = None
    ) -> dict[str, list[Any]]:
        """Inputs name -> C Dr.Jit floats (a sequence, Vector or tensor [C, N]); outputs name -> list of C floats.

        ``settled``: values of the outputs of ``Graph.frame_part``, which are then not computed here.
        """
        values = self.components(inputs)
        packed: dict[str, Any] = {}
        steps = self.steps
        if settled is not None:
            values, steps = values | dict(settled), [step for step in steps if not step[2].per_frame]
        frame = [node.id for _, _, node in steps if node.per_frame]
        for op, use, node in steps:
            self.step(op, use, node, lambda name: unpack(values, packed, name), values, packed)
            if frame and node.id == frame[-1]:
                settle(values, packed, frame)
        return {name: list(unpack(values, packed, value)) for name, value in self.graph.outputs.items()}

    def components(self, inputs: Mapping[str, Any]) -> dict[str, list[Any]]:
        """Read the inputs of the graph from what a caller passes.

        Args:
            inputs: Name of each input to its Dr.Jit floats: a sequence, a vector, or a tensor [C, N].

        Returns:
            Name of each input to a list of C floats of width N or 1.
        """
        return {name: _components(self.graph, inputs, name) for name in self.graph.inputs}

    @staticmethod
    def step(
        op: Op,
        use: Use,
        node: Node,
        read: Callable[[str], list[Any]],
        values: dict[str, list[Any]],
        packed: dict[str, Any],
    ) -> None:
        """Evaluate one node.

        Args:
            op: What the node does.
            use: Its parameters, with uploaded buffers.
            node: The node.
            read: Returns the components of a value by its name.
            values: Name to components of the values so far; the result is added here ...
            packed: ... or, where the op computes with cooperative vectors, here.
        """
        if not op.packed(use):
            values[node.id] = op.drjit(use, *(read(name) for name in node.inputs))
            return
        import drjit.nn as nn

        first = node.inputs[0]
        if first not in packed:
            packed[first] = nn.CoopVec(*read(first))
        packed[node.id] = op.drjit(use, packed[first])


def _components(graph: Graph, inputs: Mapping[str, Any], name: str) -> list[Any]:
    from lightwell.backend import dr, mi

    width = graph.inputs[name]
    if name not in inputs:
        raise ValueError(f"graph: input '{name}': expected {width} Dr.Jit floats, found nothing; pass it")
    value = inputs[name]
    if isinstance(value, mi.Float):
        value = [value]
    elif dr.is_tensor_v(value):
        value = [value[i].array for i in range(value.shape[0])]
    components = [mi.Float(component) for component in value]
    if len(components) != width:
        raise ValueError(f"graph: input '{name}': expected {width} components, found {len(components)}; slice it")
    return components


def unpack(values: dict[str, list[Any]], packed: dict[str, Any], name: str) -> list[Any]:
    """Return the components of a value, taken out of its cooperative vector where it is in one.

    Args:
        values: Name to components; the result is added.
        packed: Name to cooperative vector.
        name: Name of the value.

    Returns:
        C Dr.Jit floats.
    """
    if name not in values:
        values[name] = list(packed[name])
    return values[name]


def settle(values: dict[str, list[Any]], packed: dict[str, Any], frame: list[str]) -> None:
    """Evaluate per-frame values at once where they are single numbers, so that no pixel computes them again.

    Args:
        values: Name to components.
        packed: Name to cooperative vector; those of evaluated values are removed.
        frame: Names of the per-frame values.
    """
    from lightwell.backend import dr

    components = [component for name in frame for component in unpack(values, packed, name)]
    if max(dr.width(component) for component in components) == 1:
        dr.make_opaque(*components)
        for name in frame:
            packed.pop(name, None)


def compile(graph: Graph) -> Compiled:
    """Upload and pack the weights of a graph for Dr.Jit.

    Args:
        graph: Graph to evaluate.

    Returns:
        A callable that adds the graph to the kernel of its caller.
    """
    return Compiled(graph)


def evaluate_drjit(graph: Graph, inputs: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Evaluate a graph once with Dr.Jit. Keep ``compile(graph)`` where it is called more than once.

    Args:
        graph: Graph to evaluate.
        inputs: Name of each input to its Dr.Jit floats: a sequence, a vector, or a tensor [C, N].

    Returns:
        Name of each output to a list of C floats.
    """
    return compile(graph)(inputs)
