"""Makes graphs concisely."""

from __future__ import annotations

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

    Every op of the registry is a method: inputs first, then parameters by name. Arrays (or ``Buffer`` objects) given to
    buffer parameters become buffers. ``per_frame=True`` and ``name=`` go to any of them.
    """

    def __init__(self, **inputs: int):
        self._inputs = inputs
        self._buffers: dict[str, Buffer] = {}
        self._nodes: list[Node] = []

    def node(self, op: str, *inputs: str, name: str | None = None, per_frame: bool = False, **params: Any) -> str:
        """Add a node; array-valued buffer parameters are stored as buffers of their own."""
        if op not in OPS:
            raise ValueError(f"graph: expected an op of {', '.join(sorted(OPS))}, found '{op}'; choose one of them")
        taken = {node.id for node in self._nodes} | set(self._inputs)
        if name is None:
            count = len(self._nodes)
            while (name := f"n{count}") in taken:
                count += 1
        for key, parameter in OPS[op].parameters.items():
            if parameter.kind == "buffer" and key in params and not isinstance(params[key], str):
                params[key] = self.buffer(params[key])
            if parameter.kind == "numbers" and key in params:
                params[key] = tuple(np.asarray(params[key], float).ravel().tolist())
        self._nodes.append(Node(name, op, inputs, params, per_frame))
        return name

    def buffer(self, values: np.ndarray | Buffer, name: str | None = None) -> str:
        """Add a buffer (float32 unless a ``Buffer`` is given); one that was added before is shared."""
        if name is None:
            for known, buffer in self._buffers.items():
                if buffer is values:
                    return known
            name = f"w{len(self._buffers)}"
        self._buffers[name] = values if isinstance(values, Buffer) else Buffer(np.asarray(values, np.float32))
        return name

    def build(self, **outputs: str) -> Graph:
        """Check everything and return the graph whose outputs are the given values."""
        return Graph(dict(self._inputs), dict(self._buffers), tuple(self._nodes), outputs)

    def concat(self, *inputs, **options) -> str:
        return self.node("concat", *inputs, **options)

    def slice(self, a, start, width, **options) -> str:
        return self.node("slice", a, start=start, width=width, **options)

    def affine(self, a, scale, offset, **options) -> str:
        return self.node("affine", a, scale=scale, offset=offset, **options)

    def add(self, a, b, **options) -> str:
        return self.node("add", a, b, **options)

    def subtract(self, a, b, **options) -> str:
        return self.node("subtract", a, b, **options)

    def multiply(self, a, b, **options) -> str:
        return self.node("multiply", a, b, **options)

    def scale(self, a, factor, **options) -> str:
        return self.node("scale", a, factor=factor, **options)

    def dot(self, a, b, **options) -> str:
        return self.node("dot", a, b, **options)

    def length(self, a, **options) -> str:
        return self.node("length", a, **options)

    def normalize(self, a, **options) -> str:
        return self.node("normalize", a, **options)

    def reflect(self, n, v, **options) -> str:
        return self.node("reflect", n, v, **options)

    def log(self, a, epsilon, **options) -> str:
        return self.node("log", a, epsilon=epsilon, **options)

    def reciprocal(self, a, epsilon, **options) -> str:
        return self.node("reciprocal", a, epsilon=epsilon, **options)

    def clamp(self, a, low=0.0, high=1.0, **options) -> str:
        return self.node("clamp", a, low=low, high=high, **options)

    def frequency(self, a, octaves, **options) -> str:
        return self.node("frequency", a, octaves=octaves, **options)

    def oneblob(self, a, bins, **options) -> str:
        return self.node("oneblob", a, bins=bins, **options)

    def sh(self, d, degree, **options) -> str:
        return self.node("sh", d, degree=degree, **options)

    def grid(self, p, buffer, **options) -> str:
        return self.node("grid", p, buffer=buffer, **options)

    def texture(self, uv, buffer, **options) -> str:
        return self.node("texture", uv, buffer=buffer, **options)

    def hashgrid(self, p, buffer, levels, base, growth, entries_log2, **options) -> str:
        layout = dict(levels=levels, base=base, growth=growth, entries_log2=entries_log2)
        return self.node("hashgrid", p, buffer=buffer, **layout, **options)

    def nearest(self, p, buffer, **options) -> str:
        return self.node("nearest", p, buffer=buffer, **options)

    def rows(self, index, buffer, **options) -> str:
        return self.node("rows", index, buffer=buffer, **options)

    def tree(self, a, nodes, depth, **options) -> str:
        return self.node("tree", a, nodes=nodes, depth=depth, **options)

    def top2(self, g, **options) -> str:
        return self.node("top2", g, **options)

    def linear(self, a, weights, bias, index=None, **options) -> str:
        inputs = (a,) if index is None else (a, index)
        return self.node("linear", *inputs, weights=weights, bias=bias, **options)

    def matvec(self, matrix, a, rows, **options) -> str:
        return self.node("matvec", matrix, a, rows=rows, **options)

    def activate(self, a, function, **options) -> str:
        return self.node("activate", a, function=function, **options)

    def select(self, c, a, b, **options) -> str:
        return self.node("select", c, a, b, **options)

    def blend(self, t, a, b, **options) -> str:
        return self.node("blend", t, a, b, **options)
