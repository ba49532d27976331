"""Light of groups of lamps: one trunk of features of a point, and a linear layer per group whose outputs add.

    u = grid(x),   h = trunk(u, g) >= 0,   f_k = W_k h,   W_k >= 0

A group's share is never negative, and the light of any setting of the dimmers is  (Σ_k w_k W_k) h: the layers are added
up once per frame, and a pixel costs what it costs for one group. Notation: B rows, U features of the grid, G other
inputs of a pixel, H features of the trunk, K groups, S states (settings of the dimmers) that are trained at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.networks.device import tensor
from lightwell.networks.hashgrid import HashGrid
from lightwell.networks.mlp import ACTIVATIONS, activations_of, apply_layers, evaluate_network, glorot, initial_layers
from lightwell.networks.training import rows_from

# Mean of the initial entries of W_k, times H: the initial share is about the mean of a feature.
INITIAL_SUM = 0.25


@dataclass(frozen=True)
class LampNetwork:
    """Parameters are a dict of tensors: ``grid``; ``grid_w, pixel_w, b0`` of the first layer; ``w1, b1 …`` of the
    others; ``lamps`` [H, 3 K], whose squares are the layers of the groups."""

    grid: HashGrid
    pixel: int
    """G."""
    lamps: int
    """K."""
    hidden: tuple[int, ...] = (48, 48)
    """Widths of the trunk; the last is H."""
    activation: str = "silu"
    features: str = "exp"
    """Activation of the trunk's last layer; its values must not be negative."""

    @property
    def activations(self) -> tuple[str, ...]:
        """Activation of each layer of the trunk."""
        return activations_of(len(self.hidden), self.activation, self.features)

    @property
    def macs(self) -> int:
        """Multiply-adds per pixel, the same for any number of groups."""
        first = (self.grid.width + self.pixel) * self.hidden[0]
        return first + sum(a * b for a, b in pairwise((*self.hidden, 3)))

    def initial(self, seed: int, bias: float = 0.0) -> dict[str, np.ndarray]:
        """Draw initial weights as Glorot & Bengio 2010; biases are constant.

        Args:
            seed: Seed of the weights.
            bias: Initial value of the biases.

        Returns:
            Parameters by name, float32.
        """
        rng = np.random.default_rng(seed)
        first = glorot(rng, self.grid.width + self.pixel, self.hidden[0])
        parameters = {"grid": self.grid.initial(rng), "grid_w": first[: self.grid.width]}
        parameters |= {"pixel_w": first[self.grid.width :], "b0": np.full((1, self.hidden[0]), bias, np.float32)}
        layers = initial_layers(rng, self.hidden, bias)
        parameters |= {f"{name[0]}{int(name[1:]) + 1}": values for name, values in layers.items()}
        mean = (INITIAL_SUM / self.hidden[-1]) ** 0.5
        parameters["lamps"] = rng.uniform(0.5 * mean, 1.5 * mean, (self.hidden[-1], 3 * self.lamps)).astype(np.float32)
        return parameters

    def __call__(self, parameters: Mapping[str, Any], inputs: tuple[Any, Any, Any]) -> Any:
        """Map (grid points [B, 3], pixel inputs [B, G], states [3 K, 3 S]) to [B, 3 S], differentiably."""
        points, pixel, states = inputs
        features = self._features(parameters, points, pixel)
        return dr.matmul(features, dr.matmul(dr.square(parameters["lamps"]), states))

    def _features(self, parameters: Mapping[str, Any], points: Any, pixel: Any) -> Any:
        """[B, H] features of the trunk."""
        u = self.grid(parameters["grid"], points)
        ones = dr.full(mi.TensorXf, 1, (points.shape[0], 1))
        x = dr.matmul(u, parameters["grid_w"]) + dr.matmul(pixel, parameters["pixel_w"])
        x = ACTIVATIONS[self.activations[0]](x + dr.matmul(ones, parameters["b0"]))
        rest = {f"{name[0]}{int(name[1:]) - 1}": parameters[name] for name in parameters if name[1:].isdigit()}
        return apply_layers(rest, x, self.activations[1:])

    def decayed(self, values: Mapping[str, Any], gradients: dict[str, Any]) -> dict[str, Any]:
        """Add the gradients of the penalties on the size of weights.

        Args:
            values: Parameters by name.
            gradients: Gradients of the loss by name.

        Returns:
            Gradients by name.
        """
        return gradients | {"grid": self.grid.decayed(values["grid"], gradients["grid"])}

    def evaluate(self, parameters: Mapping[str, np.ndarray], inputs: tuple[np.ndarray, ...]) -> np.ndarray:
        """Evaluate the network on NumPy arrays, without gradients.

        Args:
            parameters: Weights by name, shapes [...] as ``initial`` makes them.
            inputs: Grid points [B, 3], pixel inputs [B, G] and states [3 K, 3 S].

        Returns:
            [B, 3 S] outputs.
        """
        return evaluate_network(self, parameters, inputs)


@dataclass(frozen=True)
class LampSet:
    """N rows on the device, in random order."""

    points: Any
    """[N, 3] places in the grid."""
    pixel: Any
    """[N, G] other inputs of a pixel."""
    target: Any
    """[N, 3 K] shares of the groups, each in a unit of its own."""
    weight: Any
    """[N, 1] importance weights with mean 1."""
    states: Any
    """[3 K, 3 S] from shares to the light of states, in units of theirs."""

    @staticmethod
    def from_numpy(
        points: np.ndarray, pixel: np.ndarray, target: np.ndarray, weight: np.ndarray, states: np.ndarray
    ) -> LampSet:
        """Copy rows that are in random order to the device.

        Args:
            points: [N, 3] places in the grid.
            pixel: [N, G] other inputs of a pixel.
            target: [N, 3 K] shares.
            weight: [N] importance weights.
            states: [3 K, 3 S] matrix of the states.

        Returns:
            The rows on the device.
        """
        return LampSet(*(tensor(a) for a in (points, pixel, target, np.reshape(weight, (-1, 1)), states)))

    def __len__(self) -> int:
        return self.points.shape[0]

    @property
    def grain(self) -> int:
        """Rows that stay together in batches."""
        return 1

    def rows(self, start: Any, count: int) -> tuple[tuple[Any, Any, Any], Any, Any]:
        """Read a batch of neighbouring rows, cyclic.

        Args:
            start: First row; UInt32 of width 1.
            count: Number of rows B.

        Returns:
            Inputs of ``LampNetwork``, targets [B, 3 S] and weights [B, 1].
        """
        points, pixel, target, weight = (
            rows_from(table, start, count) for table in (self.points, self.pixel, self.target, self.weight)
        )
        return (points, pixel, self.states), dr.matmul(target, self.states), weight
