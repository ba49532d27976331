"""What an op is: its arity, its parameters, its width rule, and its meaning in NumPy and in Dr.Jit.

N is the number of points; a value of width C is [N, C] float32 in NumPy and a list of C arrays of N in Dr.Jit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lightwell.graph.ops.example import Examples, no_examples

# Limits that no field of lightwell comes near; a file from a stranger that exceeds one is refused before evaluation.
MAX_WIDTH = 4096
MAX_NODES = 4096
MAX_ELEMENTS = 1 << 26
MAX_MACS = 1 << 24
MAX_NUMBER = float(np.finfo(np.float32).max)
# Largest count that a 32-bit float holds exactly, as do all whole numbers below it.
MAX_EXACT = 1 << 24


@dataclass(frozen=True)
class Parameter:
    """One parameter of an op, as it stands in the JSON of a node."""

    kind: str
    """``number``, ``numbers`` (one per component of the first input), ``integer``, ``choice`` or ``buffer``."""
    low: float = -MAX_NUMBER
    """Least value of a number, or of each of the numbers."""
    high: float = MAX_NUMBER
    """Greatest value."""
    choices: tuple[str, ...] = ()
    """Allowed words of a choice."""
    ranks: tuple[int, ...] = ()
    """Allowed ranks of a buffer."""
    exact: bool = False
    """Whether a buffer must keep its float32 numbers: `quantise` leaves it alone."""


@dataclass(frozen=True)
class Use:
    """One use of an op: what its functions may know of the node and of what flows into it."""

    id: str
    """Name of the node, for error messages."""
    params: Mapping[str, Any]
    """The node's parameters."""
    widths: tuple[int, ...]
    """Widths of the inputs."""
    buffers: Mapping[str, Any]
    """Parameter name to ``Buffer``."""
    state: dict[str, Any] = field(default_factory=dict)
    """What ``Op.prepare`` put there: device arrays, kept from call to call."""

    def __getitem__(self, name: str) -> Any:
        return self.params[name]

    def values(self, name: str) -> np.ndarray:
        """Return the dequantised numbers of a buffer.

        Args:
            name: Parameter that names the buffer.

        Returns:
            [...] float32, of the stored shape.
        """
        return self.buffers[name].values()

    def expect(self, condition: bool, expected: str, found: str, cure: str) -> None:
        """Raise the one-line error of this node unless a condition holds.

        Args:
            condition: What must be true.
            expected: What was expected, in words.
            found: What was found.
            cure: What the reader can do.

        Raises:
            ValueError: The condition is false.
        """
        if not condition:
            raise ValueError(f"graph: node '{self.id}': expected {expected}, found {found}; {cure}")


def _no_cost(use: Use) -> int:
    return 0


def _no_state(use: Use) -> dict[str, Any]:
    return {}


@dataclass(frozen=True)
class Op:
    """An operation of the shading graph. Registered once, it is tested on every evaluator."""

    name: str
    """The word in the file."""
    arity: tuple[int, int]
    """Least and greatest number of inputs."""
    width: Callable[[Use], int]
    """Width of the value; raises ``ValueError`` when widths or buffers do not fit."""
    numpy: Callable[..., Any]
    """``numpy(use, *inputs [N, Ci]) -> [N, C]``: defines the meaning."""
    drjit: Callable[..., Any]
    """``drjit(use, *inputs) -> list of C arrays``; a packed op also takes and returns a cooperative vector."""
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    """Required parameters by name."""
    macs: Callable[[Use], int] = _no_cost
    """Multiply-adds per evaluation (weights only: trigonometry and interpolation are not counted)."""
    fetches: Callable[[Use], int] = _no_cost
    """Table reads per evaluation, in entries."""
    prepare: Callable[[Use], dict[str, Any]] = _no_state
    """Uploads the buffers once for Dr.Jit; its result becomes ``use.state``."""
    packed: Callable[[Use], bool] = lambda use: False
    """Whether the Dr.Jit function wants its first input as a cooperative vector and returns one."""
    examples: Examples = no_examples
    """Makes the uses that test vectors show, at least one."""


OPS: dict[str, Op] = {}


def register(op: Op) -> Op:
    """Add an op to the registry.

    Args:
        op: The op; its name must be new.

    Returns:
        The same op.

    Raises:
        ValueError: An op of that name is registered already.
    """
    if op.name in OPS:
        raise ValueError(f"graph: op '{op.name}' is registered twice; give the new one another name")
    OPS[op.name] = op
    return op


def same_width(use: Use) -> int:
    """Return the width of the first input: the width rule of ops that work on each component.

    Args:
        use: Use of an op.

    Returns:
        Components of the value.
    """
    return use.widths[0]


def one(use: Use) -> int:
    """Return 1: the width rule of ops that make one number of inputs of equal width.

    Args:
        use: Use of an op.

    Returns:
        Components of the value.
    """
    use.expect(len(set(use.widths)) == 1, "inputs of equal width", f"{list(use.widths)}", "concat or slice one of them")
    return 1


def expect_width(use: Use, position: int, width: int, meaning: str) -> None:
    """Require an input to have a width; raise the error of the node otherwise.

    Args:
        use: Use of an op.
        position: Which input, from 0.
        width: Components that it must have.
        meaning: What the input is, in words.
    """
    found = use.widths[position]
    use.expect(found == width, f"{meaning} of width {width}", f"width {found}", "slice the input or feed another one")


def broadcast_width(use: Use) -> int:
    """Return the width of two operands of which one may have a single component.

    Args:
        use: Use of an op.

    Returns:
        Components of the value.
    """
    a, b = use.widths
    use.expect(a == b or 1 in (a, b), "operands of equal width or of width 1", f"{a} and {b}", "concat or slice one")
    return max(a, b)
