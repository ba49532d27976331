"""Light of groups of lamps in a scene where something moves: the layer of a group is a function of the pose.

    W_k(p) = Σ_m B_m(p) W_km,   B_m >= 0, W_km >= 0,   h = trunk(u, g; s(p)) >= 0,   f_k = W_k(p) h

What depends on the pose p alone, the weights B of the bases and the shifts s of the trunk's layers, is computed once
per frame: a pixel costs what it costs in a scene that stands still, shares are never negative, and they add. Notation
as in ``lamps``; M bases, F features of a pose, P runs of R rows each that share a pose (B = P R).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.networks.device import tensor
from lightwell.networks.lamps import LampNetwork, LampSet
from lightwell.networks.mlp import ACTIVATIONS, apply_layers, glorot, initial_layers
from lightwell.networks.training import rows_from

# Initial scale of the shifts: small, so that training starts from one trunk for all poses.
SHIFT_SCALE = 0.3
# Added to the seed of the network, for what depends on the pose.
POSE_STREAM = 0x905E


@dataclass(frozen=True)
class PosedLampNetwork(LampNetwork):
    """Parameters beside those of ``LampNetwork``: ``pose_w0, pose_b0`` of the network of the pose and ``shift0 …``,
    what it adds to each layer of the trunk. ``lamps`` is [M H, 3 K]: one matrix after the other."""

    bases: int = 1
    """M."""
    frame: int = 1
    """F."""
    pose_hidden: int = 32
    """Units of the network of the pose."""

    def initial(self, seed: int, bias: float = 0.0) -> dict[str, np.ndarray]:
        """Draw initial weights as ``LampNetwork.initial``; all bases begin alike.

        Args:
            seed: Seed of the weights.
            bias: Initial value of the biases.

        Returns:
            Parameters by name, float32.
        """
        parameters = super().initial(seed, bias)
        parameters["lamps"] = np.tile(parameters["lamps"], (self.bases, 1))
        rng = np.random.default_rng([seed, POSE_STREAM])
        parameters |= initial_layers(rng, (self.frame, self.pose_hidden), bias, prefix="pose_")
        for k, width in enumerate(self.hidden):
            parameters[f"shift{k}"] = SHIFT_SCALE * glorot(rng, self.pose_hidden, width)
        return parameters

    def __call__(self, parameters: Mapping[str, Any], inputs: tuple[Any, ...]) -> Any:
        """Map (grid points [B, 3], pixel inputs [B, G], pose features [P, F], weights of the bases [P, M], states
        [3 K, 3 S]) to [B, 3 S], differentiably. Rows p R … (p + 1) R − 1 have pose p."""
        points, pixel, frame, basis, states = inputs
        rows, runs, width = points.shape[0], basis.shape[0], states.shape[1]
        features = self._shifted(parameters, points, pixel, frame)
        layers = dr.matmul(dr.square(parameters["lamps"]), states)
        layers = dr.matmul(basis, dr.reshape(layers, (self.bases, self.hidden[-1] * width)))
        layers = dr.reshape(layers, (runs, self.hidden[-1], width))
        out = dr.matmul(dr.reshape(features, (runs, rows // runs, self.hidden[-1])), layers)
        return dr.reshape(out, (rows, width))

    def _shifted(self, parameters: Mapping[str, Any], points: Any, pixel: Any, frame: Any) -> Any:
        """[B, H] features of the trunk, whose layers are shifted by the pose."""
        rows, runs = points.shape[0], frame.shape[0]
        pose = apply_layers(parameters, frame, (self.activation,), prefix="pose_")
        one, each = dr.full(mi.TensorXf, 1, (rows, 1)), dr.full(mi.TensorXf, 1, (runs, rows // runs, 1))
        u = self.grid(parameters["grid"], points)
        x = dr.matmul(u, parameters["grid_w"]) + dr.matmul(pixel, parameters["pixel_w"])
        for k, activation in enumerate(self.activations):
            x = dr.matmul(x, parameters[f"w{k}"]) if k else x
            shift = dr.reshape(dr.matmul(pose, parameters[f"shift{k}"]), (runs, 1, self.hidden[k]))
            # Products, as in ``apply_layers``: their gradients are summed in a fixed order.
            shift = dr.reshape(dr.matmul(each, shift), (rows, self.hidden[k]))
            x = ACTIVATIONS[activation](x + dr.matmul(one, parameters[f"b{k}"]) + shift)
        return x


@dataclass(frozen=True)
class PosedLampSet(LampSet):
    """N rows on the device: P runs of R rows, each of one pose; the runs are in random order."""

    frame: Any
    """[P, F] features of the pose of each run."""
    basis: Any
    """[P, M] weights of the bases."""

    @staticmethod
    def of_runs(rows: LampSet, frame: np.ndarray, basis: np.ndarray) -> PosedLampSet:
        """Say in which poses rows are.

        Args:
            rows: N rows, run by run.
            frame: [P, F] features of the pose of each run.
            basis: [P, M] weights of the bases.

        Returns:
            The rows on the device.
        """
        return PosedLampSet(
            rows.points, rows.pixel, rows.target, rows.weight, rows.states, tensor(frame), tensor(basis)
        )

    @property
    def grain(self) -> int:
        """R: batches start and end between runs."""
        return len(self) // int(self.frame.shape[0])

    def rows(self, start: Any, count: int) -> tuple[tuple[Any, ...], Any, Any]:
        """Read a batch of neighbouring runs, cyclic.

        Args:
            start: First row, a multiple of R; UInt32 of width 1.
            count: Number of rows, a multiple of R.

        Returns:
            Inputs of ``PosedLampNetwork``, targets [count, 3 S] and weights [count, 1].
        """
        (points, pixel, states), target, weight = super().rows(start, count)
        run, runs = start // self.grain, count // self.grain
        frame, basis = (rows_from(table, run, runs) for table in (self.frame, self.basis))
        return (points, pixel, frame, basis, states), target, weight
