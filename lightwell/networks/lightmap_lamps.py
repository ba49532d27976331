"""The network of a neural light map whose lamps have switches: its light adds up over groups of lamps.

    f_s = base_s (1 + g (exp(o₀…₂) − 1)) + g specular (Σ_k s_k W_k) exp(o₃…),   W_k ≥ 0

``base_s`` is albedo · E' of the lamps in a state s of their dimmers. The features exp(o) are shared; every group has a
linear layer of its own, which is not negative. Notation: B rows, K groups, R pictures of E', M features, S states that
are trained at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats
from lightwell.networks.device import tensor
from lightwell.networks.lightmap import GAIN, GLOSS, HEAD, LightmapNetwork
from lightwell.networks.mlp import ACTIVATIONS
from lightwell.networks.training import rows_from


@dataclass(frozen=True)
class LampLightmapNetwork(LightmapNetwork):
    """A network of K groups. Parameters beside those of ``LightmapNetwork``: ``lamps`` [M, 3 K], whose squares are the
    layers W. A row has albedo · E' of each picture, 3 R numbers, after what is known of the place."""

    lamps: int = 1
    """K."""
    parts: int = 1
    """R."""
    features_of_gloss: int = 3
    """M."""

    @staticmethod
    def of(network: LightmapNetwork, lamps: int, parts: int, features: int) -> LampLightmapNetwork:
        """Make the network of a light map one of groups of lamps.

        Args:
            network: The network, with a base.
            lamps: K.
            parts: R.
            features: M.

        Returns:
            The network.
        """
        known = {f.name: getattr(network, f.name) for f in fields(LightmapNetwork)}
        return LampLightmapNetwork(**known, lamps=lamps, parts=parts, features_of_gloss=features)

    @property
    def outputs(self) -> int:
        """Width of the last layer."""
        return 3 + self.features_of_gloss

    def initial(self, seed: int, bias: float = 0.0) -> dict[str, np.ndarray]:
        """Draw initial parameters; every group begins with about the mean of the features.

        Args:
            seed: Seed of the parameters.
            bias: Initial value of the biases.

        Returns:
            Parameters by name, float32.
        """
        made = super().initial(seed, bias)
        mean = (1 / self.features_of_gloss) ** 0.5
        rng = np.random.default_rng([seed, 0x1A3])
        shape = (self.features_of_gloss, 3 * self.lamps)
        return made | {"lamps": rng.uniform(0.5 * mean, 1.5 * mean, shape).astype(np.float32)}

    def __call__(self, parameters: Mapping[str, Any], inputs: Any) -> Any:
        """Map (rows, states [3 K, 3 S], mixing [3 R, 3 S], three [3, 3 S]) to light [B, 3 S] in units of the states."""
        rows, states, mixing, three = inputs
        e = ACTIVATIONS["exp"](self.corrections(parameters, rows))
        gloss = dr.matmul(rows[:, GLOSS], dr.full(mi.TensorXf, 1, (1, 3)))
        factor = dr.matmul(1 + gloss * (e[:, 0:3] - 1), three)
        gain = dr.matmul(rows[:, GAIN] * gloss, three)
        begin = HEAD + self.inputs + self.about
        base = dr.matmul(rows[:, begin : begin + 3 * self.parts], mixing)
        layers = dr.matmul(dr.square(parameters["lamps"]), states)
        return base * factor + gain * dr.matmul(e[:, 3 : self.outputs], layers)


@dataclass(frozen=True)
class LampRows:
    """N rows on the device, in random order."""

    features: Any
    """[N, F] rows of the network."""
    target: Any
    """[N, 3 (K + 1)] light of each group in a unit of its own, then that of all."""
    weight: Any
    """[N] importance weights with mean 1."""
    states: Any
    """[3 K, 3 S] from light of groups to that of states, in units of theirs."""
    mixing: Any
    """[3 R, 3 S] from pictures to diffuse light of states."""
    wanted: Any
    """[3 (K + 1), 3 S] from the target to that of states; the state of all lamps has a target of its own."""
    three: Any
    """[3, 3 S] repeats red, green and blue for each state."""

    @staticmethod
    def from_numpy(
        rows: np.ndarray,
        target: np.ndarray,
        weight: np.ndarray,
        states: np.ndarray,
        units: np.ndarray,
        mixing: np.ndarray,
    ) -> LampRows:
        """Copy rows that are in random order to the device.

        Args:
            rows: [N, F] rows.
            target: [N, K + 1, 3] light of each group in a unit of its own, then that of all in unit S.
            weight: [N] importance weights.
            states: [S, K] settings of the dimmers.
            units: [K] unit of each group, relative to S.
            mixing: [3 R, 3 S] from pictures to diffuse light of states.

        Returns:
            The rows on the device.
        """
        whole, three = states @ units, np.eye(3)
        alone = (states * units / whole[:, None]).T
        wanted = np.concatenate([alone, np.zeros((1, len(states)))])
        together = (states == 1).all(axis=1)
        wanted[:, together] = 0
        wanted[-1, together] = 1 / whole[together]
        tables = (np.kron(alone, three), mixing, np.kron(wanted, three), np.tile(three, len(states)))
        flat = target.reshape(len(target), -1)
        return LampRows(tensor(rows), tensor(flat), upload_floats(weight), *map(tensor, tables))

    def __len__(self) -> int:
        return self.features.shape[0]

    @property
    def grain(self) -> int:
        """Rows that stay together in batches."""
        return 1

    def rows(self, start: Any, count: int) -> tuple[tuple[Any, Any, Any, Any], Any, Any]:
        """Read a batch of neighbouring rows, cyclic.

        Args:
            start: First row; UInt32 of width 1.
            count: Number of rows B.

        Returns:
            Inputs of ``LampLightmapNetwork``, targets [B, 3 S] and weights [B, 1].
        """
        weight = mi.TensorXf(self.weight, (len(self), 1))
        features, target, weight = (rows_from(table, start, count) for table in (self.features, self.target, weight))
        return (features, self.states, self.mixing, self.three), dr.matmul(target, self.wanted), weight
