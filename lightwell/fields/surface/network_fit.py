"""Base of fields with one network: training, prediction and checkpoints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lightwell.fields.base import FieldSetup, Progress
from lightwell.files import Arrays
from lightwell.networks import Trainer
from lightwell.networks.losses import EPSILON
from lightwell.networks.training import TrainingData, TrainingState
from lightwell.transport.samples import Query, Samples


@dataclass
class NetworkFit:
    """Base of a ``lightwell.fields.base.Learner``. Subclasses set ``_trainer``, give ``learn_from``, ``lower`` and
    ``macs``, and the two functions below.
    """

    setup: FieldSetup
    preset: Any
    seed: int
    _trainer: Trainer[Any] = field(init=False)
    _data: TrainingData = field(init=False)
    # Inputs, factors and radiance in unit S of the held-out samples.
    _validation: tuple[Any, np.ndarray, np.ndarray] = field(init=False)

    def _rows(self, query: Query) -> Any:
        """Inputs of the network for N queries."""
        raise NotImplementedError

    def _modulation(self, query: Query) -> np.ndarray:
        """[N, 3] factor between the network's output and radiance."""
        return self.setup.unit * query.reflectance

    @property
    def state(self) -> TrainingState:
        """Steps, errors and history of the training."""
        return self._trainer.state

    def validate_on(self, samples: Samples) -> None:
        """Set the held-out samples by which the best weights are chosen: mean |f − y| / (max(f, y) + 0.01) in unit S.

        It is the relative error of small errors and at most 1: of the unbounded one, a few places in the dark are the
        most, and it goes up and down with them while all else still gets better.

        Args:
            samples: Path-traced samples.
        """
        scale = self._modulation(samples.query) / self.setup.unit
        self._validation = (self._rows(samples.query), scale, samples.radiance / self.setup.unit)

    def _output(self, parameters: dict[str, np.ndarray], inputs: Any) -> np.ndarray:
        """[N, 3] output of the network."""
        return self._trainer.network.evaluate(parameters, inputs)

    def _error(self, parameters: dict[str, np.ndarray]) -> float:
        inputs, scale, reference = self._validation
        prediction = self._output(parameters, inputs) * scale
        return float(np.mean(np.abs(prediction - reference) / (np.maximum(prediction, reference) + EPSILON)))

    def train(
        self, until: int, total: int, progress: Progress | None = None, checkpoint: Callable[[], None] | None = None
    ) -> bool:
        """Train; ``learn_from`` and ``validate_on`` come first.

        Args:
            until: Step to train to.
            total: Steps of the schedule.
            progress: Called with the state and ``total`` after each evaluation.
            checkpoint: Called when a checkpoint is due.

        Returns:
            Whether early stopping ended the training.
        """
        return self._trainer.fit(self._data, self._error, until, total, progress, checkpoint)

    def begin_again(self, step: int) -> float:
        """Go on from the best weights with the present samples; errors on earlier ones do not count.

        Args:
            step: Step of the schedule to go on at.

        Returns:
            Error of these weights on the held-out samples.
        """
        self._trainer.adopt(self._trainer.best, keep_moments=False)
        error = self._error(self._trainer.best)
        self._trainer.state = TrainingState(step=step, best_error=error, best_step=step)
        return error

    def predict(self, query: Query) -> np.ndarray:
        """Predict radiance with the best weights so far, before they are quantised.

        Args:
            query: N queries.

        Returns:
            [N, 3] radiance, reflectance included.
        """
        return self._output(self._trainer.best, self._rows(query)) * self._modulation(query)

    def arrays(self) -> Arrays:
        """Return the state that a resumed training needs.

        Returns:
            Arrays [...] by name.
        """
        return self._trainer.arrays()

    def restore(self, arrays: Arrays) -> None:
        """Restore the state of a training of the same preset and samples.

        Args:
            arrays: Result of ``arrays``.
        """
        self._trainer.restore(arrays)
