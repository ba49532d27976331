"""Activation functions, each a pair of a NumPy and a Dr.Jit meaning."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.graph.ops.example import Example, normals
from lightwell.graph.ops.layers import cooperative
from lightwell.graph.ops.op import Op, Parameter, Use, register, same_width

# Slope of leaky_relu below zero.
LEAK = 0.01
# The argument of `exp` is clamped to this range: radiance from 6e-6 to 403 relative units.
EXP_LOW, EXP_HIGH = -12.0, 6.0
# Beyond this, exp(-x) leaves the 32-bit range and sigmoid is 0 or 1 to the last bit that matters.
SIGMOID_LIMIT = 80.0


@dataclass(frozen=True)
class Function:
    """One activation function."""

    numpy: Callable[[np.ndarray], np.ndarray]
    """Meaning, [N, C] float32 to the same."""
    drjit: Callable[[Any, Any], Any]
    """``drjit(dr, x)`` for a Dr.Jit array or a cooperative vector."""


def _sigmoid(x: np.ndarray) -> np.ndarray:
    return np.float32(1) / (np.float32(1) + np.exp(-np.clip(x, -SIGMOID_LIMIT, SIGMOID_LIMIT)))


def _softplus(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, np.float32(0)) + np.log1p(np.exp(-np.abs(x)))


def _drjit_exp(dr: Any, x: Any) -> Any:
    return dr.exp2(x * 1.4426950408889634)


def _drjit_sigmoid(dr: Any, x: Any) -> Any:
    # As a hyperbolic tangent, because cooperative vectors have no division.
    return dr.fma(dr.tanh(x * 0.5), 0.5, 0.5)


def _drjit_softplus(dr: Any, x: Any) -> Any:
    # |x| = 2 max(x, 0) - x, because cooperative vectors have no absolute value.
    positive = dr.maximum(x, 0)
    return positive + dr.log2(1 + _drjit_exp(dr, x - 2 * positive)) * 0.6931471805599453


FUNCTIONS: dict[str, Function] = {
    "identity": Function(lambda x: x, lambda dr, x: x),
    "relu": Function(lambda x: np.maximum(x, np.float32(0)), lambda dr, x: dr.maximum(x, 0)),
    "leaky_relu": Function(lambda x: np.maximum(x, np.float32(LEAK) * x), lambda dr, x: dr.maximum(x, x * LEAK)),
    "sigmoid": Function(_sigmoid, _drjit_sigmoid),
    "tanh": Function(np.tanh, lambda dr, x: dr.tanh(x)),
    "silu": Function(lambda x: x * _sigmoid(x), lambda dr, x: x * _drjit_sigmoid(dr, x)),
    "softplus": Function(_softplus, _drjit_softplus),
    "sine": Function(np.sin, lambda dr, x: dr.sin(x)),
    "exp": Function(
        lambda x: np.exp(np.clip(x, np.float32(EXP_LOW), np.float32(EXP_HIGH))),
        lambda dr, x: _drjit_exp(dr, dr.minimum(dr.maximum(x, EXP_LOW), EXP_HIGH)),
    ),
}


def _drjit_activate(use: Use, a: Any) -> Any:
    from lightwell.backend import dr

    function = FUNCTIONS[use["function"]].drjit
    return [function(dr, x) for x in a] if isinstance(a, list) else function(dr, a)


def _examples(rng: np.random.Generator) -> Iterator[Example]:
    for function in FUNCTIONS:
        a = normals(rng, 5, 3.0)
        a[1], a[2] = -30, 30
        yield Example(function, (a,), {"function": function})


ACTIVATE = register(
    Op(
        name="activate",
        arity=(1, 1),
        parameters={"function": Parameter("choice", choices=tuple(FUNCTIONS))},
        width=same_width,
        numpy=lambda use, a: FUNCTIONS[use["function"]].numpy(a),
        drjit=_drjit_activate,
        packed=lambda use: use["function"] != "sine" and cooperative(),  # cooperative vectors have no sine
        examples=_examples,
    )
)
