"""A multi-layer perceptron in tensor mode. Notation: B rows of a batch, sizes (in, hidden …, out)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi

# Bounds of the argument of the exponential output: e^6 = 403 units is brighter than any target in the training set.
EXP_LOW, EXP_HIGH = -12.0, 6.0


def _silu(x: Any) -> Any:
    return x / (1 + dr.exp(-x))


def _softplus(x: Any) -> Any:
    # ln(1 + e^x) without overflow.
    return dr.maximum(x, 0) + dr.log(1 + dr.exp(-dr.abs(x)))


# Functions of the shading graph's ``activate`` op that networks here are trained with.
ACTIVATIONS = {
    "identity": lambda x: x,
    "relu": lambda x: dr.maximum(x, 0),
    "sigmoid": lambda x: 1 / (1 + dr.exp(-x)),
    "silu": _silu,
    "sine": dr.sin,
    "softplus": _softplus,
    "tanh": dr.tanh,
    "exp": lambda x: dr.exp(dr.clip(x, EXP_LOW, EXP_HIGH)),
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
    def macs(self) -> int:
        """Multiply-accumulates per evaluation."""
        return sum(a * b for a, b in zip(self.sizes, self.sizes[1:]))

    def initial(self, seed: int, bias: float = 0.0) -> dict[str, np.ndarray]:
        """Draw initial weights as ``glorot``; biases are constant.

        Args:
            seed: Seed of the weights.
            bias: Initial value of the biases.

        Returns:
            Parameters by name, float32.
        """
        rng = np.random.default_rng(seed)
        parameters: dict[str, np.ndarray] = {}
        for k, (a, b) in enumerate(zip(self.sizes, self.sizes[1:])):
            parameters[f"w{k}"] = glorot(rng, a, b)
            parameters[f"b{k}"] = np.full((1, b), bias, np.float32)
        return parameters

    def __call__(self, parameters: Mapping[str, Any], x: Any) -> Any:
        """Map a tensor [B, in] to a tensor [B, out], differentiably.

        With one more axis E in front of ``x`` and of all parameters: E networks at once.
        """
        # The bias enters as a product, because the gradient of a product sums in a fixed order and that of a broadcast
        # does not: the same seed must give the same weights.
        ones = dr.full(mi.TensorXf, 1, (*x.shape[:-1], 1))
        for k in range(self.layers):
            x = dr.matmul(x, parameters[f"w{k}"]) + dr.matmul(ones, parameters[f"b{k}"])
            x = ACTIVATIONS[self.activation if k + 1 < self.layers else self.output](x)
        return x

    def evaluate(self, parameters: Mapping[str, np.ndarray], x: np.ndarray) -> np.ndarray:
        """Evaluate the network on NumPy arrays, without gradients: for validation sets, not for inner loops.

        Args:
            parameters: Weights ``w0 [in, out], b0 [1, out], …``.
            x: [B, in] inputs.

        Returns:
            [B, out] outputs.
        """
        tensors = {name: mi.TensorXf(value) for name, value in parameters.items()}
        with dr.suspend_grad():
            return np.array(self(tensors, mi.TensorXf(np.ascontiguousarray(x, np.float32))))
