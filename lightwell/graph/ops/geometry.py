"""Vector ops: dot, length, normalize, reflect."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lightwell.graph.ops.example import WIDTHS, Example, at_widths, normals
from lightwell.graph.ops.op import Op, Use, one, register, same_width

# A vector shorter than this is not brought to unit length, so that zero stays zero.
SHORTEST = 1e-8


def _sum(terms: list[Any]) -> Any:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def _drjit_dot(use: Use, a: Any, b: Any) -> Any:
    return [_sum([x * y for x, y in zip(a, b)])]


def _drjit_length(use: Use, a: Any) -> Any:
    from lightwell.backend import dr

    return [dr.sqrt(_drjit_dot(use, a, a)[0])]


def _drjit_normalize(use: Use, a: Any) -> Any:
    from lightwell.backend import dr

    inverse = 1 / dr.maximum(_drjit_length(use, a)[0], SHORTEST)
    return [x * inverse for x in a]


def _reflect_width(use: Use) -> int:
    one(use)
    return use.widths[0]


def _drjit_reflect(use: Use, n: Any, v: Any) -> Any:
    twice = 2 * _drjit_dot(use, n, v)[0]
    return [twice * x - y for x, y in zip(n, v)]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Dot product of rows: [N, C], [N, C] -> [N, 1]."""
    return (a * b).sum(axis=1, keepdims=True, dtype=np.float32)


def _length(a: np.ndarray) -> np.ndarray:
    return np.sqrt(_dot(a, a))


def _reflect_examples(rng: np.random.Generator) -> Iterator[Example]:
    for width in WIDTHS:
        axis = normals(rng, width)
        yield Example(f"{width}", (axis / np.maximum(_length(axis), SHORTEST), normals(rng, width)))


DOT = register(
    Op(
        name="dot",
        arity=(2, 2),
        width=one,
        numpy=lambda use, a, b: _dot(a, b),
        drjit=_drjit_dot,
        macs=lambda use: use.widths[0],
        examples=at_widths("nn"),
    )
)

LENGTH = register(
    Op(
        name="length",
        arity=(1, 1),
        width=lambda use: 1,
        numpy=lambda use, a: _length(a),
        drjit=_drjit_length,
        examples=at_widths("n"),
    )
)

NORMALIZE = register(
    Op(
        name="normalize",
        arity=(1, 1),
        width=same_width,
        numpy=lambda use, a: a / np.maximum(_length(a), np.float32(SHORTEST)),
        drjit=_drjit_normalize,
        examples=at_widths("n"),
    )
)

REFLECT = register(
    Op(
        name="reflect",
        arity=(2, 2),
        width=_reflect_width,
        numpy=lambda use, n, v: np.float32(2) * _dot(n, v) * n - v,
        drjit=_drjit_reflect,
        examples=_reflect_examples,
    )
)
