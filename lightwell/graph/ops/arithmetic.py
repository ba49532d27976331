"""Component-wise arithmetic: affine, add, subtract, multiply, scale, clamp, log, reciprocal, select, blend."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lightwell.graph.ops.example import WIDTHS, Example, at_widths, normals
from lightwell.graph.ops.op import Op, Parameter, Use, broadcast_width, expect_width, register, same_width


def _spread(a: list[Any], b: list[Any]) -> tuple[list[Any], list[Any]]:
    """Repeat the operand of width 1 so that both lists are equally long."""
    width = max(len(a), len(b))
    return (a * width if len(a) == 1 else a), (b * width if len(b) == 1 else b)


def _vector(use: Use, name: str) -> np.ndarray:
    return np.asarray(use[name], np.float32)


def _drjit_affine(use: Use, a: Any) -> Any:
    return [component * s + o for component, s, o in zip(a, use["scale"], use["offset"])]


def _drjit_clamp(use: Use, a: Any) -> Any:
    from lightwell.backend import dr

    return [dr.minimum(dr.maximum(component, use["low"]), use["high"]) for component in a]


def _clamp_width(use: Use) -> int:
    use.expect(use["low"] <= use["high"], "low <= high", f"{use['low']} > {use['high']}", "exchange them")
    return use.widths[0]


def _drjit_log(use: Use, a: Any) -> Any:
    from lightwell.backend import dr

    return [dr.log(dr.maximum(component, 0) + use["epsilon"]) for component in a]


def _choice_width(use: Use) -> int:
    expect_width(use, 0, 1, "a first input")
    a, b = use.widths[1:]
    use.expect(a == b, "two values of equal width", f"{a} and {b}", "concat or slice one of them")
    return a


def _numpy_select(use: Use, c: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.where(c > 0, a, b)


def _drjit_select(use: Use, c: Any, a: Any, b: Any) -> Any:
    from lightwell.backend import dr

    return [dr.select(c[0] > 0, x, y) for x, y in zip(a, b)]


def _affine_examples(rng: np.random.Generator) -> Iterator[Example]:
    for width in WIDTHS:
        params = {"scale": rng.normal(size=width), "offset": rng.normal(size=width)}
        yield Example(f"{width}", (normals(rng, width),), params)


def _reciprocal_examples(rng: np.random.Generator) -> Iterator[Example]:
    for width in WIDTHS:
        yield Example(f"{width}", (normals(rng, width) ** 2,), {"epsilon": 0.01})


AFFINE = register(
    Op(
        name="affine",
        arity=(1, 1),
        parameters={"scale": Parameter("numbers"), "offset": Parameter("numbers")},
        width=same_width,
        numpy=lambda use, a: a * _vector(use, "scale") + _vector(use, "offset"),
        drjit=_drjit_affine,
        examples=_affine_examples,
    )
)

ADD = register(
    Op(
        name="add",
        arity=(2, 2),
        width=broadcast_width,
        numpy=lambda use, a, b: a + b,
        drjit=lambda use, a, b: [x + y for x, y in zip(*_spread(a, b))],
        examples=at_widths("nn", "1n"),
    )
)

SUBTRACT = register(
    Op(
        name="subtract",
        arity=(2, 2),
        width=broadcast_width,
        numpy=lambda use, a, b: a - b,
        drjit=lambda use, a, b: [x - y for x, y in zip(*_spread(a, b))],
        examples=at_widths("nn", "1n"),
    )
)

MULTIPLY = register(
    Op(
        name="multiply",
        arity=(2, 2),
        width=broadcast_width,
        numpy=lambda use, a, b: a * b,
        drjit=lambda use, a, b: [x * y for x, y in zip(*_spread(a, b))],
        examples=at_widths("nn", "n1"),
    )
)

SCALE = register(
    Op(
        name="scale",
        arity=(1, 1),
        parameters={"factor": Parameter("number")},
        width=same_width,
        numpy=lambda use, a: a * np.float32(use["factor"]),
        drjit=lambda use, a: [component * use["factor"] for component in a],
        examples=at_widths("n", factor=-1.75),
    )
)

CLAMP = register(
    Op(
        name="clamp",
        arity=(1, 1),
        parameters={"low": Parameter("number"), "high": Parameter("number")},
        width=_clamp_width,
        numpy=lambda use, a: np.clip(a, np.float32(use["low"]), np.float32(use["high"])),
        drjit=_drjit_clamp,
        examples=at_widths("n", low=-0.5, high=1.25),
    )
)

# Least epsilon: below it 1/epsilon leaves the range of half floats' products and the logarithm meets subnormals.
MIN_EPSILON = 1e-12

LOG = register(
    Op(
        name="log",
        arity=(1, 1),
        parameters={"epsilon": Parameter("number", MIN_EPSILON, 1e6)},
        width=same_width,
        numpy=lambda use, a: np.log(np.maximum(a, np.float32(0)) + np.float32(use["epsilon"])),
        drjit=_drjit_log,
        examples=at_widths("n", epsilon=1e-3),
    )
)

RECIPROCAL = register(
    Op(
        name="reciprocal",
        arity=(1, 1),
        parameters={"epsilon": Parameter("number", MIN_EPSILON, 1e6)},
        width=same_width,
        numpy=lambda use, a: np.float32(1) / (a + np.float32(use["epsilon"])),
        drjit=lambda use, a: [1 / (component + use["epsilon"]) for component in a],
        examples=_reciprocal_examples,
    )
)

SELECT = register(
    Op(
        name="select",
        arity=(3, 3),
        width=_choice_width,
        numpy=_numpy_select,
        drjit=_drjit_select,
        examples=at_widths("1nn"),
    )
)

BLEND = register(
    Op(
        name="blend",
        arity=(3, 3),
        width=_choice_width,
        numpy=lambda use, t, a, b: a + (b - a) * t,
        drjit=lambda use, t, a, b: [x + (y - x) * t[0] for x, y in zip(a, b)],
        examples=at_widths("1nn"),
    )
)
