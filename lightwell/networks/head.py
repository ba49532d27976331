"""The head of a pixel's network: one kernel forward, one backward, and one product for the gradients of each layer.

    h_0 = act_0(z + V g),   h_k+1 = act_k+1(W_k h_k + b_k)

Layers of a few units over thousands of rows leave products of whole matrices little to do: most of their time is spent
on packing, launches and on writing what lies between two layers. Here a row stays in registers (Dr.Jit's cooperative
vectors). The gradients of weights are sums over rows; a product of matrices adds them in a fixed order, so that the
same seed gives the same weights.

Notation: B rows, G inputs of a pixel, H units of the first layer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lightwell.backend import ACTIVE, dr, mi
from lightwell.networks.mlp import ACTIVATIONS, DERIVATIVES

# With CUDA, Dr.Jit has cooperative vectors in kernels of OptiX alone.
FUSED = not ACTIVE.variant.startswith("cuda")


def fused_head(activations: Sequence[str], z: Any, pixel: Any, weights: Sequence[Any]) -> Any:
    """Apply the head to a batch, differentiably in ``z`` and ``weights``, in reverse mode; not with CUDA.

    Args:
        activations: Activation of each layer.
        z: [B, H] tensor, what the first layer has of its other inputs.
        pixel: [B, G] tensor, inputs of a pixel.
        weights: Tensors V [G, H], then W [in, out] and b [1, out] of each further layer.

    Returns:
        [B, out] tensor.
    """
    keep = dr.grad_enabled(z, *weights)
    return dr.custom(_Head, tuple(activations), z, pixel, list(weights), keep)


class _Head(dr.CustomOp):
    """The head of one batch, and what its gradients need."""

    def eval(self, activations: tuple[str, ...], z: Any, pixel: Any, weights: list[Any], keep: bool) -> Any:
        self._activations, self._z, self._pixel, self._weights = activations, z, pixel, weights
        self._count = z.shape[0]
        arguments, values = self._layers()
        if keep:
            # Written while they are in registers; computed again they would take twice as long.
            self._inputs = [_table([*layer, mi.Float(1)], self._count) for layer in values[:-1]]
            self._slopes = [
                _table([DERIVATIVES[activation](x, y) for x, y in zip(xs, ys)], self._count)
                for activation, xs, ys in zip(activations, arguments, values)
            ]
        return _table(values[-1], self._count)

    def backward(self) -> None:
        gradients: list[Any] = []
        d = _columns(self.grad_out(), self._count)
        for layer in reversed(range(len(self._slopes))):
            d = [g * slope for g, slope in zip(d, _columns(self._slopes[layer], self._count))]
            gradients.insert(0, _table(d, self._count))
            if layer:
                d = list(dr.nn.matvec(dr.nn.view(self._weights[2 * layer - 1]), dr.nn.CoopVec(*d)))
        # All in one kernel, before the products, each of which would evaluate its part in one of its own.
        dr.eval(gradients)
        self.set_grad_in("z", gradients[0])
        parts = [dr.matmul(self._pixel, gradients[0], At=True)]
        for x, gradient in zip(self._inputs, gradients[1:]):
            both = dr.matmul(x, gradient, At=True)
            parts += [both[:-1], both[-1:]]
        self.set_grad_in("weights", parts)

    def _layers(self) -> tuple[list[list[Any]], list[list[Any]]]:
        """Arguments and values of all units of each layer."""
        view, first = dr.nn.view, self._weights[0]
        x = dr.nn.matvec(view(first), dr.nn.CoopVec(*_columns(self._pixel, self._count)), transpose=True)
        arguments = [[a + b for a, b in zip(list(x), _columns(self._z, self._count))]]
        values = [[ACTIVATIONS[self._activations[0]](a) for a in arguments[0]]]
        for w, b, activation in zip(self._weights[1::2], self._weights[2::2], self._activations[1:]):
            x = dr.nn.matvec(view(w), dr.nn.CoopVec(*values[-1]), view(b.array), transpose=True)
            arguments.append(list(x))
            values.append([ACTIVATIONS[activation](a) for a in arguments[-1]])
        return arguments, values

    def forward(self) -> None:
        raise NotImplementedError("a head is differentiated in reverse mode only")

    def name(self) -> str:
        return "head"


def _columns(table: Any, count: int) -> list[Any]:
    """The columns of a [count, width] tensor, one lane per row."""
    width = table.shape[1]
    first = dr.arange(mi.UInt32, count) * width
    return [dr.gather(mi.Float, table.array, first + k) for k in range(width)]


def _table(columns: Sequence[Any], count: int) -> Any:
    """[count, width] tensor of columns."""
    out = dr.empty(mi.Float, count * len(columns))
    dr.scatter(out, mi.ArrayXf(list(columns)), dr.arange(mi.UInt32, count))
    return mi.TensorXf(out, (count, len(columns)))
