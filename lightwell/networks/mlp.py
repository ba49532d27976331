"""A multi-layer perceptron in tensor mode. Notation: B rows of a batch, sizes (in, hidden …, out)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.graph.ops.activate import EXP_HIGH, EXP_LOW
from lightwell.networks.device import tensor, tensors


def _sigmoid(x: Any) -> Any:
    return 1 / (1 + dr.exp(-x))


def _silu(x: Any) -> Any:
    return x / (1 + dr.exp(-x))


def _softplus(x: Any) -> Any:
    # ln(1 + e^x) without overflow.
    return dr.maximum(x, 0) + dr.log(1 + dr.exp(-dr.abs(x)))


# Functions of the shading graph's ``activate`` op that networks here are trained with.
ACTIVATIONS = {
    "identity": lambda x: x,
    "relu": lambda x: dr.maximum(x, 0),
    "sigmoid": _sigmoid,
    "silu": _silu,
    "sine": dr.sin,
    "softplus": _softplus,
    "tanh": dr.tanh,
    "exp": lambda x: dr.exp(dr.clip(x, EXP_LOW, EXP_HIGH)),
}

# Derivatives of the same, of an argument x and the value y there.
DERIVATIVES: dict[str, Callable[[Any, Any], Any]] = {
    "identity": lambda x, y: 1,
    "relu": lambda x, y: dr.select(x > 0, 1, 0),
    "sigmoid": lambda x, y: y * (1 - y),
    "silu": lambda x, y: _sigmoid(x) * (1 - y) + y,
    "sine": lambda x, y: dr.cos(x),
    "softplus": lambda x, y: _sigmoid(x),
    "tanh": lambda x, y: 1 - y * y,
    "exp": lambda x, y: dr.select((x > EXP_LOW) & (x < EXP_HIGH), y, 0),
}


def glorot(rng: np.random.Generator, inputs: int, outputs: int) -> np.ndarray:
    """Draw weights U(±√(6/(in+out))) (Glorot & Bengio 2010).

    Args:
        rng: Random generator.
        inputs: Width of the input.
        outputs: Width of the output.

    Returns:
        [in, out] float32.
    """
    bound = np.sqrt(6.0 / (inputs + outputs))
    return rng.uniform(-bound, bound, (inputs, outputs)).astype(np.float32)


def initial_layers(
    rng: np.random.Generator, sizes: Sequence[int], bias: float = 0.0, names: str = "wb", prefix: str = ""
) -> dict[str, np.ndarray]:
    """Draw initial weights of layers as ``glorot``; biases are constant.

    Args:
        rng: Random generator.
        sizes: Widths, input first, output last.
        bias: Initial value of the biases.
        names: Letters of weights and biases.
        prefix: First part of the names.

    Returns:
        ``w0 [in, out], b0 [1, out], w1 …``, float32.
    """
    parameters: dict[str, np.ndarray] = {}
    for k, (inputs, outputs) in enumerate(pairwise(sizes)):
        parameters[f"{prefix}{names[0]}{k}"] = glorot(rng, inputs, outputs)
        parameters[f"{prefix}{names[1]}{k}"] = np.full((1, outputs), bias, np.float32)
    return parameters


def apply_layers(
    parameters: Mapping[str, Any], x: Any, activations: Sequence[str], names: str = "wb", prefix: str = ""
) -> Any:
    """Apply layers to a batch, differentiably.

    Args:
        parameters: Tensors as ``initial_layers`` names them, or with one more axis E in front: E networks at once.
        x: Tensor [B, in], or [E, B, in].
        activations: Activation of each layer.
        names: Letters of weights and biases.
        prefix: First part of the names.

    Returns:
        Tensor [B, out], or [E, B, out].
    """
    # The bias enters as a product, because the gradient of a product sums in a fixed order and that of a broadcast
    # does not: the same seed must give the same weights.
    ones = dr.full(mi.TensorXf, 1, (*x.shape[:-1], 1))
    for k, activation in enumerate(activations):
        weights, bias = (parameters[f"{prefix}{name}{k}"] for name in names)
        x = ACTIVATIONS[activation](dr.matmul(x, weights) + dr.matmul(ones, bias))
    return x


def activations_of(layers: int, inside: str, last: str) -> tuple[str, ...]:
    """List the activation of each layer.

    Args:
        layers: Number of layers.
        inside: Activation of all layers but the last.
        last: Activation of the last layer.

    Returns:
        Names of activations.
    """
    return (inside,) * (layers - 1) + (last,)


def evaluate_network(network: Callable[..., Any], parameters: Mapping[str, np.ndarray], inputs: Any) -> np.ndarray:
    """Evaluate a network on NumPy arrays, without gradients: for validation sets, not for inner loops.

    Args:
        network: Function of tensors by name and of its inputs.
        parameters: Arrays [...] by name.
        inputs: Array [B, in] or a tuple of arrays.

    Returns:
        [B, out] outputs.
    """
    values = tensors(parameters)
    with dr.suspend_grad():
        return np.array(network(values, tuple(map(tensor, inputs)) if isinstance(inputs, tuple) else tensor(inputs)))


@dataclass(frozen=True)
class Mlp:
    """A multi-layer perceptron with one activation inside and one at the end.

    Parameters are a dict of tensors ``w0 [in, out], b0 [1, out], w1 …``, the form that Dr.Jit's optimisers take.
    """

    sizes: tuple[int, ...]
    """Widths, input first, output last."""
    activation: str = "silu"
    output: str = "exp"

    @property
    def layers(self) -> int:
        """Number of linear layers."""
        return len(self.sizes) - 1

    @property
    def activations(self) -> tuple[str, ...]:
        """Activation of each layer."""
        return activations_of(self.layers, self.activation, self.output)

    @property
    def macs(self) -> int:
        """Multiply-accumulates per evaluation."""
        return sum(a * b for a, b in pairwise(self.sizes))

    def initial(self, seed: int, bias: float = 0.0) -> dict[str, np.ndarray]:
        """Draw initial weights as ``glorot``; biases are constant.

        Args:
            seed: Seed of the weights.
            bias: Initial value of the biases.

        Returns:
            Parameters by name, float32.
        """
        return initial_layers(np.random.default_rng(seed), self.sizes, bias)

    def __call__(self, parameters: Mapping[str, Any], x: Any) -> Any:
        """Map a tensor [B, in] to a tensor [B, out], differentiably.

        With one more axis E in front of ``x`` and of all parameters: E networks at once.
        """
        return apply_layers(parameters, x, self.activations)

    def evaluate(self, parameters: Mapping[str, np.ndarray], x: np.ndarray) -> np.ndarray:
        """Evaluate the network on NumPy arrays, without gradients: for validation sets, not for inner loops.

        Args:
            parameters: Weights ``w0 [in, out], b0 [1, out], …``.
            x: [B, in] inputs.

        Returns:
            [B, out] outputs.
        """
        return evaluate_network(self, parameters, x)
