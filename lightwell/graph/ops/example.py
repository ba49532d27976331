"""Examples of ops: `tools/format_vectors.py` makes the test vectors of every runtime from them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

# Points of an example.
POINTS = 24
# Widths around the four components of a register.
WIDTHS = (1, 3, 4, 9)


@dataclass(frozen=True)
class Example:
    """One use of an op on numbers."""

    name: str
    """What tells it from the other examples of the op: a file is ``OP_NAME.json``."""
    inputs: tuple[np.ndarray, ...]
    """[POINTS, C] each."""
    params: Mapping[str, Any] = field(default_factory=dict)
    """The parameters; arrays become buffers."""


Examples = Callable[[np.random.Generator], Iterator[Example]]


def no_examples(rng: np.random.Generator) -> Iterator[Example]:
    """Make nothing.

    Args:
        rng: Source of the numbers.

    Returns:
        An empty iterator.
    """
    return iter(())


def coordinates(rng: np.random.Generator, width: int) -> np.ndarray:
    """Draw points mostly in the unit cube, some outside, on its borders and in its middle.

    Args:
        rng: Source of the numbers.
        width: Components.

    Returns:
        [POINTS, width].
    """
    points = rng.uniform(-0.1, 1.1, (POINTS, width))
    points[:4] = np.array([0, 1, 0.5, -3])[:, None]
    return points


def normals(rng: np.random.Generator, width: int, spread: float = 2.0) -> np.ndarray:
    """Draw normally distributed values, and zero.

    Args:
        rng: Source of the numbers.
        width: Components.
        spread: Standard deviation.

    Returns:
        [POINTS, width].
    """
    points = rng.normal(0, spread, (POINTS, width))
    points[0] = 0
    return points


def directions(rng: np.random.Generator, width: int = 3) -> np.ndarray:
    """Draw unit vectors, the axes among them.

    Args:
        rng: Source of the numbers.
        width: Components.

    Returns:
        [POINTS, width].
    """
    d = rng.normal(size=(POINTS, width))
    d[:3] = np.eye(3, width)
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def indices(rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw indices that are not whole numbers, some far outside of what there is.

    Args:
        rng: Source of the numbers.
        count: Number of things, ≥ 1.

    Returns:
        [POINTS, 1]; no value lies where rounding decides.
    """
    index = rng.integers(0, count, (POINTS, 1)) + rng.uniform(-0.4, 0.4, (POINTS, 1))
    index[:2] = [[-4.0], [1e6]]
    return index


def at_widths(*inputs: str, **params: Any) -> Examples:
    """Use an op at the widths around those of a register.

    Args:
        *inputs: Widths of the inputs of one use: ``n`` stands for the width, ``1`` for one component.
        **params: Parameters of the op.

    Returns:
        What makes the examples.
    """

    def examples(rng: np.random.Generator) -> Iterator[Example]:
        for signature in inputs:
            for width in WIDTHS if signature == inputs[0] else WIDTHS[1:]:
                drawn = tuple(normals(rng, width if letter == "n" else 1) for letter in signature)
                name = f"{width}" if signature == inputs[0] else f"{signature}_{width}"
                yield Example(name, drawn, params)

    return examples


def unit_cube_tables(*shapes: tuple[int, ...]) -> Examples:
    """Read tables that are given over the unit square or the unit cube.

    Args:
        *shapes: Shapes of the tables, channels last.

    Returns:
        What makes the examples.
    """

    def examples(rng: np.random.Generator) -> Iterator[Example]:
        for shape in shapes:
            at = coordinates(rng, len(shape) - 1)
            yield Example("x".join(map(str, shape)), (at,), {"buffer": rng.normal(size=shape)})

    return examples
