"""The shading graph: what a baked field computes, as a list of few ops over named inputs.

A ``Graph`` that exists is valid: names, widths, parameters and buffers were checked when it was made, with limits that
keep a file from a stranger from asking for absurd work. N points; a value of width C is [N, C] float32.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NoReturn

import numpy as np

from lightwell.graph.buffers import Buffer, leading_axes
from lightwell.graph.ops import OPS, Parameter, Use
from lightwell.graph.ops.op import MAX_ELEMENTS, MAX_MACS, MAX_NODES, MAX_WIDTH

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.]{0,63}\Z")
# Inputs that are the same for every pixel of a frame; `per_frame` nodes may use these only.
FRAME_INPUTS = ("light", "lamps", "pose")
# Inputs that `per_frame` nodes alone may use: shaders have no such value.
FRAME_ONLY = ("lamps", "pose")
MAX_INPUTS = 64
# Widths of the outputs that runtimes know; a graph may have others, of any width.
OUTPUT_WIDTHS = {"radiance": 3, "segment": 1, "overlap": 1, "second": 1}


@dataclass(frozen=True)
class Node:
    """One operation."""

    id: str
    """Name of the value."""
    op: str
    """Name of the op."""
    inputs: tuple[str, ...]
    """Names of graph inputs or earlier nodes."""
    params: Mapping[str, Any] = field(default_factory=dict)
    """Parameters of the op."""
    per_frame: bool = False
    """Whether it depends on frame inputs only and runs once a frame."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "inputs", tuple(self.inputs))


@dataclass(frozen=True)
class Graph:
    """A list of nodes in evaluation order."""

    inputs: Mapping[str, int]
    """Name to width."""
    buffers: Mapping[str, Buffer]
    """Name to stored array."""
    nodes: tuple[Node, ...]
    """In evaluation order."""
    outputs: Mapping[str, str]
    """Name of the output to the name of the value."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", tuple(self.nodes))
        _check_names(self)
        for name, buffer in self.buffers.items():
            _check_buffer(name, buffer)
        nodes, widths, uses = [], dict(self.inputs), []
        frame = {name for name in self.inputs if name in FRAME_INPUTS}
        for node in self.nodes:
            node, use = _check_node(node, widths, self.buffers, frame)
            width = OPS[node.op].width(use)
            use.expect(1 <= width <= MAX_WIDTH, f"a value of width 1 to {MAX_WIDTH}", f"{width}", "make it narrower")
            widths[node.id] = width
            if node.per_frame:
                frame.add(node.id)
            nodes.append(node)
            uses.append(use)
        object.__setattr__(self, "nodes", tuple(nodes))
        object.__setattr__(self, "widths", widths)
        object.__setattr__(self, "uses", tuple(uses))
        _check_ends(self)

    widths: dict[str, int] = field(init=False, repr=False, compare=False)
    """Width of every input and node."""
    uses: tuple[Use, ...] = field(init=False, repr=False, compare=False)
    """What each node's op sees, in the order of ``nodes``."""

    def __repr__(self) -> str:
        given = ", ".join(f"{name} [{width}]" for name, width in self.inputs.items())
        return f"<Graph of {given}: {len(self.nodes)} nodes, {self.nbytes:,} bytes, {self.macs:,} MAC per pixel>"

    def _total(self, cost: str, per_frame: bool) -> int:
        pairs = zip(self.nodes, self.uses)
        return sum(getattr(OPS[node.op], cost)(use) for node, use in pairs if node.per_frame == per_frame)

    @cached_property
    def macs(self) -> int:
        """Count the multiply-adds per pixel in ``linear``, ``matvec`` and ``dot``.

        Returns:
            Multiply-adds of the nodes that are not per-frame.
        """
        return self._total("macs", False)

    @cached_property
    def macs_per_frame(self) -> int:
        """Count the multiply-adds that run once a frame.

        Returns:
            Multiply-adds of the per-frame nodes.
        """
        return self._total("macs", True)

    @cached_property
    def fetches(self) -> int:
        """Count the entries of tables and trees that are read per pixel.

        Returns:
            Entries.
        """
        return self._total("fetches", False)

    @property
    def nbytes(self) -> int:
        """Bytes of all buffers as stored."""
        return sum(buffer.nbytes for buffer in self.buffers.values())

    @property
    def parameters(self) -> int:
        """Stored numbers, scales apart."""
        return sum(buffer.array.size for buffer in self.buffers.values())

    def only(self, *outputs: str) -> Graph:
        """Cut the graph down to what some outputs need.

        Args:
            *outputs: Names of outputs to keep.

        Returns:
            A graph of fewer nodes, buffers and inputs whose outputs have the same values.
        """
        for name in outputs:
            if name not in self.outputs:
                _fail("outputs", f"one of {', '.join(self.outputs)}", _brief(name), "name an output of the graph")
        needed = {self.outputs[name] for name in outputs}
        for node in reversed(self.nodes):
            if node.id in needed:
                needed |= set(node.inputs)
        nodes = tuple(node for node in self.nodes if node.id in needed)
        used = {use.params[name] for use in self.uses if use.id in needed for name in use.buffers}
        return Graph(
            {name: width for name, width in self.inputs.items() if name in needed},
            {name: buffer for name, buffer in self.buffers.items() if name in used},
            nodes,
            {name: self.outputs[name] for name in outputs},
        )

    def frame_part(self) -> Graph | None:
        """Cut the graph down to its per-frame nodes.

        Returns:
            A graph whose outputs are the per-frame values that other nodes or outputs use, by the names of their nodes;
            None where no node is per-frame.
        """
        used = {name for node in self.nodes if not node.per_frame for name in node.inputs} | set(self.outputs.values())
        ends = [node.id for node in self.nodes if node.per_frame and node.id in used]
        return replace(self, outputs={name: name for name in ends}).only(*ends) if ends else None


def _fail(where: str, expected: str, found: str, cure: str) -> NoReturn:
    raise ValueError(f"graph: {where}: expected {expected}, found {found}; {cure}")


def _check_name(kind: str, name: Any) -> None:
    if not isinstance(name, str) or not NAME.match(name):
        _fail(kind, "a name of letters, digits, _ and . (at most 64)", repr(name)[:80], "rename it")


def _check_names(graph: Graph) -> None:
    if not 1 <= len(graph.inputs) <= MAX_INPUTS:
        _fail("inputs", f"1 to {MAX_INPUTS} inputs", f"{len(graph.inputs)}", "declare those that the nodes use")
    if not 1 <= len(graph.nodes) <= MAX_NODES:
        _fail("nodes", f"1 to {MAX_NODES} nodes", f"{len(graph.nodes)}", "merge nodes")
    for name, width in graph.inputs.items():
        _check_name("inputs", name)
        if not isinstance(width, int) or isinstance(width, bool) or not 1 <= width <= MAX_WIDTH:
            _fail(f"input '{name}'", f"a width of 1 to {MAX_WIDTH}", repr(width)[:80], "give its number of components")
    for name in graph.buffers:
        _check_name("buffers", name)


def _check_buffer(name: str, buffer: Buffer) -> None:
    where = f"buffer '{name}'"
    if not 1 <= buffer.array.ndim <= 4 or not 0 < buffer.array.size <= MAX_ELEMENTS:
        _fail(where, f"1 to 4 axes and 1 to {MAX_ELEMENTS} numbers", f"{list(buffer.shape)}", "export it again")
    if buffer.type.startswith("float"):
        if buffer.scale is not None or buffer.offset:
            _fail(where, "no scale or offset on a float type", "one", "drop it or store int8")
        if not np.isfinite(buffer.array).all():
            _fail(where, "finite numbers", "NaN or infinity", "train again with a lower rate or drop the field")
        return
    if buffer.scale is None:
        _fail(where, f"a scale for {buffer.type}", "none", "add 'scale'")
    if buffer.scale.size != 1 and not leading_axes(buffer.shape, buffer.scale.size):
        _fail(
            where,
            "one scale, or one per index of the first axis or of the first two",
            f"{buffer.scale.size} for {list(buffer.shape)}",
            "export it again",
        )
    if not np.isfinite(buffer.scale).all() or not math.isfinite(buffer.offset):
        _fail(where, "a finite scale and offset", "NaN or infinity", "export it again")
    largest = float(np.abs(buffer.scale).max()) * 255 + abs(buffer.offset)
    if largest > float(np.finfo(np.float32).max):
        _fail(where, "values within 32-bit floats", f"up to {largest:.3g}", "make the scale smaller")


def _check_node(
    node: Node, widths: Mapping[str, int], buffers: Mapping[str, Buffer], frame: set[str]
) -> tuple[Node, Use]:
    _check_name("nodes", node.id)
    where = f"node '{node.id}'"
    if node.id in widths:
        _fail(where, "a new name", "one that is taken", "rename the node")
    if node.op not in OPS:
        _fail(where, f"an op of {', '.join(sorted(OPS))}", repr(node.op)[:80], "use a newer lightwell or another op")
    op = OPS[node.op]
    if not op.arity[0] <= len(node.inputs) <= op.arity[1]:
        _fail(where, f"{op.arity[0]} to {op.arity[1]} inputs of {node.op}", f"{len(node.inputs)}", "name them all")
    for name in node.inputs:
        if name not in widths:
            _fail(where, "inputs that are graph inputs or earlier nodes", repr(name)[:80], "reorder or rename")
        if name in FRAME_ONLY and not node.per_frame:
            _fail(where, f"a per_frame node where the input is '{name}'", "one per pixel", "mark it per_frame")
        if node.per_frame and name not in frame:
            _fail(where, "a per_frame node to use frame inputs only", f"'{name}'", "drop per_frame or the input")
    input_widths = tuple(widths[name] for name in node.inputs)
    params = _check_params(where, op.parameters, node, input_widths, buffers)
    used = {name: buffers[params[name]] for name, p in op.parameters.items() if p.kind == "buffer"}
    return Node(node.id, node.op, node.inputs, params, bool(node.per_frame)), Use(node.id, params, input_widths, used)


def _check_params(
    where: str, parameters: Mapping[str, Parameter], node: Node, widths: tuple[int, ...], buffers: Mapping[str, Buffer]
) -> dict[str, Any]:
    for name in node.params:
        if name not in parameters:
            known = ", ".join(parameters) or "none"
            _fail(where, f"parameters of {node.op}: {known}", repr(name)[:80], "remove it")
    out = {}
    for name, parameter in parameters.items():
        if name not in node.params:
            _fail(where, f"parameter '{name}' of {node.op}", "nothing", "add it")
        out[name] = _check_param(f"{where}, '{name}'", parameter, node.params[name], widths[0], buffers)
    return out


def _check_param(where: str, p: Parameter, value: Any, width: int, buffers: Mapping[str, Buffer]) -> Any:
    if p.kind == "number":
        return _check_number(where, p, value)
    if p.kind == "integer":
        number = _check_number(where, p, value)
        if number != int(number):
            _fail(where, "a whole number", f"{number}", "round it")
        return int(number)
    if p.kind == "numbers":
        if not isinstance(value, (list, tuple, np.ndarray)) or len(value) != width:
            _fail(where, f"a list of {width} numbers", _brief(value), "give one per component of the input")
        return tuple(_check_number(where, p, v) for v in value)
    if p.kind == "choice":
        if value not in p.choices:
            _fail(where, f"one of {', '.join(p.choices)}", _brief(value), "choose one of them")
        return value
    if not isinstance(value, str) or value not in buffers:
        _fail(where, "the name of a buffer", _brief(value), "declare it under buffers")
    if buffers[value].array.ndim not in p.ranks:
        ranks = " or ".join(map(str, p.ranks))
        _fail(where, f"a buffer of {ranks} axes", f"{list(buffers[value].shape)}", "reshape it")
    return value


def _check_number(where: str, p: Parameter, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        _fail(where, "a number", _brief(value), "write a number")
    if not p.low <= value <= p.high:  # also false for NaN, and exact for integers of any size
        _fail(where, f"a finite number from {p.low:g} to {p.high:g}", _brief(value), "bring it into the range")
    return float(value)


def _brief(value: Any) -> str:
    """A value of any kind from a stranger, named in a few characters."""
    if isinstance(value, (str, int, float)):
        try:
            return repr(value)[:60]
        except ValueError:  # an integer of more digits than Python prints
            return "a huge number"
    return f"a {type(value).__name__}" + (f" of {len(value)}" if hasattr(value, "__len__") else "")


def _check_ends(graph: Graph) -> None:
    """Outputs exist, every buffer is used, the total work is sane."""
    if not 1 <= len(graph.outputs) <= MAX_INPUTS:
        _fail("outputs", f"1 to {MAX_INPUTS} outputs", f"{len(graph.outputs)}", "name the value to return")
    for name, value in graph.outputs.items():
        _check_name("outputs", name)
        if value not in graph.widths:
            _fail(f"output '{name}'", "the name of an input or node", _brief(value), "name the last node")
    used = {use.params[name] for node, use in zip(graph.nodes, graph.uses) for name in use.buffers}
    for name in graph.buffers:
        if name not in used:
            _fail(f"buffer '{name}'", "a buffer that some node uses", "none that does", "remove it")
    if graph.macs > MAX_MACS or graph.macs_per_frame > MAX_MACS:
        _fail("nodes", f"at most {MAX_MACS} multiply-adds", f"{max(graph.macs, graph.macs_per_frame)}", "shrink it")
