"""Base of fields whose light is a mixture of bases by the position of a light: the network of the factors.

Notation: K bases, N samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.fields.base import Progress
from lightwell.fields.surface.network_fit import NetworkFit
from lightwell.graph import Graph
from lightwell.networks import Mlp, Trainer, TrainingSet
from lightwell.probes.code import WeightCode
from lightwell.transport.samples import Query, Samples

# Samples that the light's network is trained on at most.
MOST_SAMPLES = 1 << 18


@dataclass(frozen=True)
class CodeNetwork:
    """Mixes K bases by the position of the light. A row is (features of the light [F], light per basis [3 K])."""

    mlp: Mlp

    @property
    def rank(self) -> int:
        """K."""
        return self.mlp.sizes[-1]

    def initial(self, seed: int, bias: float = 0.0) -> dict[str, np.ndarray]:
        """Make initial parameters.

        Args:
            seed: Seed of the weights.
            bias: Bias of the last layer.

        Returns:
            Arrays by name.
        """
        return self.mlp.initial(seed, bias)

    def __call__(self, parameters: Any, x: Any) -> Any:
        """[B, F + 3 K] → [B, 3]."""
        features = self.mlp.sizes[0]
        code = self.mlp(parameters, x[:, :features])
        k = self.rank
        # The code three times over; then the sum of each colour. Made on the device: a frozen step cannot upload.
        mixed = x[:, features:] * dr.matmul(code, _ones_where(k, 3 * k, lambda row, column: column % k == row))
        return dr.matmul(mixed, _ones_where(3 * k, 3, lambda row, column: row // k == column))

    def evaluate(self, parameters: Any, x: np.ndarray) -> np.ndarray:
        """Evaluate the network with NumPy.

        Args:
            parameters: Arrays by name.
            x: [N, F + 3 K] rows.

        Returns:
            [N, 3] light in unit S, without reflectance.
        """
        features = self.mlp.sizes[0]
        code = self.mlp.evaluate(parameters, x[:, :features])
        return np.einsum("nck,nk->nc", x[:, features:].reshape(len(x), 3, -1), code)


def _ones_where(rows: int, columns: int, condition: Callable[[Any, Any], Any]) -> Any:
    """[rows, columns] tensor of ones where a condition on (row, column) holds."""
    index = dr.arange(mi.UInt32, rows * columns)
    return mi.TensorXf(dr.select(condition(index // columns, index % columns), mi.Float(1), 0), (rows, columns))


@dataclass
class MixedFit(NetworkFit):
    """Base of a ``lightwell.fields.base.Learner``. Subclasses call ``_start``, give ``lower``, and the function below.

    Their presets have ``hidden``, the widths of the network, and its ``training``.
    """

    def _factors(self, query: Query) -> np.ndarray:
        """[N, 3 K] radiance over reflectance of each basis at the points, unit S; the basis is fastest."""
        raise NotImplementedError

    def lower(self) -> Graph:
        """Return the shading graph.

        Returns:
            The graph.
        """
        raise NotImplementedError

    def _start(self, rank: int) -> None:
        """Make the untrained network of K factors."""
        # Directions to a sun lie in the unit cube, positions of a lamp in the box of the scene.
        sun = self.setup.light == "sun"
        box = ((0.0, 0.0, 0.0), 1.0) if sun else (tuple(self.setup.center), float(self.setup.half_extent))
        self._code = WeightCode(*box, [])
        self._untrained = self.setup.light == "static"
        sizes = (self._code.width, *self.preset.hidden, rank)
        self._trainer = Trainer(CodeNetwork(Mlp(sizes, "silu", "identity")), self.preset.training, self.seed)

    @property
    def macs(self) -> int:
        """Multiply-accumulates per pixel."""
        return self.lower().macs

    @property
    def code(self) -> WeightCode | None:
        """The network of the light's position with the best weights so far; None: the scene's own light."""
        if self._untrained:
            return None
        best, layers = self._trainer.best, self._trainer.network.mlp.layers
        weights = [(best[f"w{k}"].T, best[f"b{k}"][0]) for k in range(layers)]
        return WeightCode(self._code.center, self._code.half, weights)

    def _rows(self, query: Query) -> np.ndarray:
        light = np.zeros_like(query.position) if self._untrained else query.light
        return np.concatenate([self._code.features(light), self._factors(query)], axis=1)

    def learn_from(self, samples: Samples) -> None:
        """Set the training samples of the light's network; without a variable light they are not used.

        Args:
            samples: Path-traced samples.
        """
        if self._untrained:
            return
        order = np.random.default_rng((self.seed, len(samples))).permutation(len(samples))[:MOST_SAMPLES]
        part = samples[order]
        target = part.radiance / (self.setup.unit * part.query.reflectance)
        self._data = TrainingSet.from_numpy(self._rows(part.query), target, np.asarray(part.weight))

    def validate_on(self, samples: Samples) -> None:
        """Set the held-out samples of early stopping, on which mean |f − y| / (y + 0.01) in unit S is measured.

        Args:
            samples: Path-traced samples.
        """
        self._validation = (self._rows(samples.query), samples.query.reflectance, samples.radiance / self.setup.unit)

    def _output(self, parameters: dict[str, np.ndarray], inputs: np.ndarray) -> np.ndarray:
        if self._untrained:
            return np.maximum(inputs[:, self._code.width :], 0)
        return np.maximum(super()._output(parameters, inputs), 0)

    def train(
        self, until: int, total: int, progress: Progress | None = None, checkpoint: Callable[[], None] | None = None
    ) -> bool:
        """Train the light's network; without a variable light only the error is measured.

        Args:
            until: Step to train to.
            total: Steps of the schedule.
            progress: Called with the state and ``total`` after each evaluation.
            checkpoint: Called when a checkpoint is due.

        Returns:
            Whether early stopping ended the training.
        """
        if not self._untrained:
            return super().train(until, total, progress, checkpoint)
        state = self.state
        if not state.history:
            state.best_error = self._error({})
            state.history.append((0, state.best_error, state.best_error))
        state.step = until
        return False

    def predict(self, query: Query) -> np.ndarray:
        """Predict radiance.

        Args:
            query: N queries.

        Returns:
            [N, 3] radiance, reflectance included.
        """
        return self._output(self._trainer.best, self._rows(query)) * self.setup.unit * query.reflectance
