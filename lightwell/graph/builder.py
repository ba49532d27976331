"""Makes graphs concisely."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from lightwell.graph.buffers import Buffer
from lightwell.graph.graph import Graph, Node
from lightwell.graph.ops import OPS


class Builder:
    """Collects nodes and buffers; every method returns the name of the value that it adds.

    >>> b = Builder(position=3)
    >>> e = b.frequency("position", octaves=4)
    >>> h = b.activate(b.linear(e, np.zeros((16, 24)), np.zeros(16)), "silu")
    >>> graph = b.build(radiance=b.linear(h, np.zeros((3, 16)), np.zeros(3)))

    Every op of the registry is a method: inputs first, then parameters in the order of the registry or by name.
    Arrays (or ``Buffer`` objects) given to buffer parameters become buffers. Any of them takes ``per_frame=True`` and
    ``name=``.
    """

    def __init__(self, **inputs: int) -> None:
        """Start a graph.

        Args:
            **inputs: Name to width of each input.
        """
        self._inputs = inputs
        self._buffers: dict[str, Buffer] = {}
        self._nodes: list[Node] = []

    def node(self, op: str, *inputs: str, name: str | None = None, per_frame: bool = False, **params: Any) -> str:
        """Add a node; arrays given to buffer parameters are stored as buffers of their own.

        Args:
            op: Name of a registered op.
            *inputs: Names of graph inputs or earlier nodes.
            name: Name of the value; None: the next free one of n0, n1, …
            per_frame: Whether it depends on frame inputs only and runs once a frame.
            **params: Parameters of the op by name.

        Returns:
            Name of the value.

        Raises:
            ValueError: No op of that name is registered.
        """
        if op not in OPS:
            raise ValueError(f"graph: expected an op of {', '.join(sorted(OPS))}, found '{op}'; choose one of them")
        taken = {node.id for node in self._nodes} | set(self._inputs)
        if name is None:
            name = next(free for count in itertools.count(len(self._nodes)) if (free := f"n{count}") not in taken)
        for key, parameter in OPS[op].parameters.items():
            if parameter.kind == "buffer" and key in params and not isinstance(params[key], str):
                params[key] = self.buffer(params[key])
            if parameter.kind == "numbers" and key in params:
                params[key] = tuple(np.asarray(params[key], float).ravel().tolist())
        self._nodes.append(Node(name, op, inputs, params, per_frame))
        return name

    def buffer(self, values: np.ndarray | Buffer, name: str | None = None) -> str:
        """Add a buffer; one that was added before under no name is shared.

        Args:
            values: [...] numbers, stored as float32, or a ``Buffer``.
            name: Name of the buffer; None: the next of w0, w1, …

        Returns:
            Name of the buffer.
        """
        if name is None:
            for known, buffer in self._buffers.items():
                if buffer is values:
                    return known
            name = f"w{len(self._buffers)}"
        self._buffers[name] = values if isinstance(values, Buffer) else Buffer(np.asarray(values, np.float32))
        return name

    def build(self, **outputs: str) -> Graph:
        """Check everything and make the graph.

        Args:
            **outputs: Name of each output to the name of the value that it returns.

        Returns:
            The graph.
        """
        return Graph(dict(self._inputs), dict(self._buffers), tuple(self._nodes), outputs)

    def __getattr__(self, op: str) -> Callable[..., str]:
        """Every op of the registry as a method: inputs first, then parameters in the order of the op's list."""
        if op not in OPS:
            raise AttributeError(f"Builder has no method '{op}', and no op of that name is registered")
        return partial(self._op, op)

    def _op(self, op: str, *values: Any, index: str | None = None, **options: Any) -> str:
        """Tell inputs from parameters; the optional input of ``linear`` comes last or is named ``index``."""
        least, names = OPS[op].arity[0], list(OPS[op].parameters)
        if not names:
            return self.node(op, *values, **options)
        end = least + len(names)
        optional = values[end:] if index is None else (index,)
        params = dict(zip(names, values[least:end], strict=False))
        return self.node(op, *values[:least], *(v for v in optional if v is not None), **params, **options)
