"""Factored transport: features of the point, read by a layer whose weights a network of the light computes.

    u = grid(x),   W, b = light network(l),   h = act(W u + b + V g),   f = head(h)

In scenes with glossy surfaces u goes on with (1 - roughness) mirror(exit of the mirrored ray).

The light network is large and runs once per frame; a pixel evaluates only the grid, the first layer and the head.
Notation: B rows, K lights with R rows each (B = K R), U features of the point, G other inputs of a pixel, H hidden
units.

The first layer of the pixel network is emitted as in hypernetworks (Ha, Dai & Le 2017).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.networks.hashgrid import HashGrid
from lightwell.networks.head import FUSED, fused_head
from lightwell.networks.mlp import (
    ACTIVATIONS,
    activations_of,
    apply_layers,
    evaluate_network,
    glorot,
    initial_layers,
)

# Initial scale of the light network's contribution to the layer, relative to the layer's bias: small, so that training
# starts from one layer for all lights.
EMITTED_SCALE = 0.3


@dataclass(frozen=True)
class FactoredNetwork:
    """Parameters are a dict of tensors: ``grid``; ``light_w0, light_b0 …`` and ``emit_w, emit_b`` of the light network;
    ``pixel_w`` (V); ``w0, b0 …`` of the head. Without a light, ``emit_w`` is missing and ``emit_b`` is the layer."""

    grid: HashGrid
    pixel: int
    """G, inputs of a pixel besides the grid's."""
    frame: int
    """Inputs of the light network; 0: no light."""
    light_hidden: tuple[int, ...] = (64, 64)
    hidden: tuple[int, ...] = (24, 14)
    mirror: HashGrid | None = None
    """Grid that is read where the mirrored ray leaves the scene; None: nothing reflects."""
    activation: str = "silu"
    output: str = "exp"

    @property
    def emitted(self) -> int:
        """Number of outputs of the light network: W [U, H] row by row, then b [H]."""
        return (self.features + 1) * self.hidden[0]

    @property
    def features(self) -> int:
        """U, features of the point: those of the grid, then those of what it reflects."""
        return self.grid.width + (self.mirror.width if self.mirror else 0)

    @property
    def light_sizes(self) -> tuple[int, ...]:
        """Widths of the light network without its last layer, input first."""
        return (self.frame, *self.light_hidden) if self.frame else ()

    @property
    def head_sizes(self) -> tuple[int, ...]:
        """Widths of the head, H first."""
        return (*self.hidden, 3)

    @property
    def head_activations(self) -> tuple[str, ...]:
        """Activation of each layer of the head."""
        return activations_of(len(self.hidden), self.activation, self.output)

    def initial(self, seed: int, bias: float = 0.0) -> dict[str, np.ndarray]:
        """Draw initial weights as Glorot & Bengio 2010; biases are constant.

        Args:
            seed: Seed of the weights.
            bias: Initial value of the biases.

        Returns:
            Parameters by name, float32.
        """
        rng = np.random.default_rng(seed)
        first = glorot(rng, self.features + self.pixel, self.hidden[0])
        start = np.concatenate([first[: self.features].ravel(), np.full(self.hidden[0], bias, np.float32)])
        parameters = {"grid": self.grid.initial(rng), "pixel_w": first[self.features :], "emit_b": start[None]}
        parameters |= {"mirror": self.mirror.initial(rng)} if self.mirror else {}
        parameters |= initial_layers(rng, self.light_sizes, bias, prefix="light_")
        if self.frame:
            parameters["emit_w"] = EMITTED_SCALE * glorot(rng, self.light_sizes[-1], self.emitted)
        return parameters | initial_layers(rng, self.head_sizes, bias)

    def __call__(self, parameters: Mapping[str, Any], inputs: tuple[Any, Any, Any]) -> Any:
        """Map (grid points [B, 3], pixel inputs [B, G], frame inputs [K, F]) to [B, 3], differentiably.

        With ``mirror``, points are [B, 7]: followed by the place where the mirrored ray leaves the scene, and by what
        the features read there are multiplied by.

        Rows k R … (k + 1) R − 1 belong to light k; without a light, frame is not used. Biases enter as
        products: see ``Mlp``.
        """
        points, pixel, frame = inputs
        rows, units = points.shape[0], self.hidden[0]
        layer = self._emit(parameters, frame)
        lights = layer.shape[0]
        # A feature of 1 takes the bias, which follows W: the gradient of a product is summed in a fixed order.
        u = dr.custom(_Features, self, parameters["grid"], parameters.get("mirror"), points)
        u = dr.reshape(u, (lights, rows // lights, self.features + 1))
        z = dr.reshape(dr.matmul(u, dr.reshape(layer, (lights, self.features + 1, units))), (rows, units))
        if FUSED:
            names = [f"{name}{k}" for k in range(len(self.hidden)) for name in "wb"]
            weights = [parameters[name] for name in ("pixel_w", *names)]
            return fused_head((self.activation, *self.head_activations), z, pixel, weights)
        x = ACTIVATIONS[self.activation](z + dr.matmul(pixel, parameters["pixel_w"]))
        return apply_layers(parameters, x, self.head_activations)

    def decayed(self, values: Mapping[str, Any], gradients: dict[str, Any]) -> dict[str, Any]:
        """Add the gradients of the penalties on the size of weights.

        Args:
            values: Parameters by name.
            gradients: Gradients of the loss by name.

        Returns:
            Gradients by name.
        """
        found = {"grid": self.grid.decayed(values["grid"], gradients["grid"])}
        if self.mirror:
            found["mirror"] = self.mirror.decayed(values["mirror"], gradients["mirror"])
        return gradients | found

    def _emit(self, parameters: Mapping[str, Any], frame: Any) -> Any:
        """Compute the emitted layers [K, emitted] of all lights; without a light, one layer for all."""
        if not self.frame:
            return parameters["emit_b"]
        x = apply_layers(parameters, frame, (self.activation,) * len(self.light_hidden), prefix="light_")
        return dr.matmul(x, parameters["emit_w"]) + dr.matmul(_ones(frame.shape[0], 1), parameters["emit_b"])

    def evaluate(self, parameters: Mapping[str, np.ndarray], inputs: tuple[np.ndarray, ...]) -> np.ndarray:
        """Evaluate the network on NumPy arrays, without gradients.

        Args:
            parameters: Weights by name, shapes [...] as ``initial`` makes them.
            inputs: Grid points [B, 3], pixel inputs [B, G] and frame inputs [K, F].

        Returns:
            [B, 3] outputs.
        """
        return evaluate_network(self, parameters, inputs)


class _Features(dr.CustomOp):
    """[B, U + 1] features of the points: of the grid, of what they reflect, and 1."""

    def eval(self, network: FactoredNetwork, grid: Any, mirror: Any, points: Any) -> Any:
        self._network, count, width = network, points.shape[0], network.features + 1
        self._at = _part(points, 0)
        out = dr.empty(mi.Float, count * width)
        network.grid.write(out, width, 0, grid, self._at)
        if network.mirror:
            self._exit, self._share = _part(points, 3), _share(points)
            network.mirror.write(out, width, network.grid.width, mirror, self._exit, self._share)
        last = dr.arange(mi.UInt32, count) * width + network.features
        dr.scatter(out, mi.Float(1), last, mode=dr.ReduceMode.Permute)
        return mi.TensorXf(out, (count, width))

    def backward(self) -> None:
        gradient, grid, mirror = self.grad_out(), self._network.grid, self._network.mirror
        self.set_grad_in("grid", grid.gradient(self._at, gradient))
        if mirror:
            self.set_grad_in("mirror", mirror.gradient(self._exit, gradient, grid.width, self._share))

    def forward(self) -> None:
        raise NotImplementedError("features are differentiated in reverse mode only")

    def name(self) -> str:
        return "features"


def _part(points: Any, first: int) -> Any:
    """[B, 3] neighbouring columns of a table."""
    rows, width = points.shape
    lane = dr.arange(mi.UInt32, rows * 3)
    return mi.TensorXf(dr.gather(mi.Float, points.array, lane // 3 * width + first + lane % 3), (rows, 3))


def _share(points: Any) -> Any:
    """[B] what features that are read at the exit are multiplied by."""
    rows, width = points.shape
    return dr.gather(mi.Float, points.array, dr.arange(mi.UInt32, rows) * width + 6)


def _ones(*shape: int) -> Any:
    return dr.full(mi.TensorXf, 1, shape)
