"""Base of fields with many small networks, one per segment: training, prediction, lowering and checkpoints.

A segment is a leaf or an expert; its number is a function of the query. Notation: E segments, N rows.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.fields.base import FieldSetup, Progress
from lightwell.fields.features import FeatureOctaves, open_builder
from lightwell.fields.surface.examples import Examples
from lightwell.fields.surface.inputs import Inputs, Kind
from lightwell.fields.surface.lowering import as_radiance, graph_layers
from lightwell.files import Arrays, prefixed, under
from lightwell.graph import Builder, Graph, quantise
from lightwell.graph.layers import add_layers
from lightwell.networks import Mlp, TrainingSettings
from lightwell.networks.checkpoint import check_like
from lightwell.networks.grouped import GroupedRows
from lightwell.networks.loop import TrainingState, run_steps
from lightwell.transport.samples import Query, Samples

# Arrays of ``state_arrays`` whose shape or width of text depends on how far the training was.
STATE_VARYING = ("history", "facts")


@dataclass(frozen=True)
class NetworkPreset:
    """Settings of the small networks: inputs, shape and training."""

    training: TrainingSettings
    inputs: Kind = "local"
    hidden: tuple[int, ...] = (20, 10)
    demodulated: bool = True
    """Targets divided by the reflectance."""
    activation: str = "silu"
    output: str = "exp"
    octaves: FeatureOctaves | None = None
    """Octaves of the 'encoded' inputs."""
    storage: str = "float16"
    """Type of the stored weights."""


class SegmentedFit:
    """Base of a ``lightwell.fields.base.Learner``. Subclasses implement ``segment``, ``weights``, ``_lower_segment``,
    ``_step``, ``_look`` and their part of a checkpoint.
    """

    def __init__(self, setup: FieldSetup, preset: NetworkPreset, seed: int) -> None:
        """Start a fit.

        Args:
            setup: Bounds, light and radiance unit of the scene.
            preset: Settings.
            seed: Seed of the weights.
        """
        self._setup, self.preset, self._seed = setup, preset, seed
        self._inputs = Inputs(setup, preset.inputs, preset.octaves)
        self.mlp = Mlp((self._inputs.width, *preset.hidden, 3), preset.activation, preset.output)
        self.state = TrainingState()
        self.facts: dict[str, Any] = {}
        # Set by ``learn_from`` and ``validate_on``.
        self.examples: Examples
        self._validation: Examples

    # ------------------------------------------------------------------ what a subclass gives

    def segment(self, query: Query) -> np.ndarray:
        """Find the segment of each point.

        Args:
            query: N queries.

        Returns:
            [N] int segment.

        Raises:
            NotImplementedError: The subclass does not implement it.
        """
        raise NotImplementedError

    @property
    def weights(self) -> dict[str, np.ndarray]:
        """Return the best weights of all segments so far.

        Returns:
            [E, …] arrays by name.

        Raises:
            NotImplementedError: The subclass does not implement it.
        """
        raise NotImplementedError

    @property
    def macs(self) -> int:
        """Count the multiply-accumulates per pixel.

        Returns:
            Number of multiply-accumulates.

        Raises:
            NotImplementedError: The subclass does not implement it.
        """
        raise NotImplementedError

    def _lower_segment(self, b: Builder, x: str) -> str:
        """Add the nodes that find the segment to a graph; x: name of the node of the networks' inputs."""
        raise NotImplementedError

    def _step(self, total: int) -> bool:
        """Do one step of ``total``; return whether nothing is left to do."""
        raise NotImplementedError

    def _look(self) -> tuple[float, float]:
        """(training loss, validation error); the best weights are kept."""
        raise NotImplementedError

    def _arrays(self) -> Arrays:
        """Arrays that a resumed training needs besides state and facts."""
        raise NotImplementedError

    # Beginnings of the names of arrays whose shape depends on how far the training was; ``_restore`` checks them.
    _varying: tuple[str, ...] = ()

    def _restore(self, arrays: Arrays) -> None:
        """Restore the result of ``_arrays``; ``ValueError`` or ``KeyError`` where it does not fit together."""
        raise NotImplementedError

    def _rearrange(self) -> None:
        """Called when the samples or the state have been replaced."""

    # ------------------------------------------------------------------ data

    def learn_from(self, samples: Samples) -> None:
        """Set the training samples; those with a target that is not finite are dropped and counted.

        Args:
            samples: Path-traced samples.
        """
        self.examples = Examples.of(samples, self._setup, self._inputs, self.preset.demodulated)
        self.facts["dropped_samples"] = self.examples.dropped
        self._rearrange()

    def validate_on(self, samples: Samples) -> None:
        """Set the held-out samples of early stopping, on which mean |f − y| / (y + 0.01) in unit S is measured.

        Args:
            samples: Path-traced samples.
        """
        self._validation = Examples.of(samples, self._setup, self._inputs, self.preset.demodulated)
        self._rearrange()

    def _outputs(self, examples: Examples, weights: dict[str, np.ndarray] | None = None) -> np.ndarray:
        """[N, 3] outputs in unit S of the network of each sample's segment; weights: None for the best so far."""
        weights = weights or self.weights
        segments = len(next(iter(weights.values())))
        rows = GroupedRows(examples.features, self.segment(examples.query), segments)
        return rows.evaluate(self.mlp, weights)

    def _validation_error(self) -> float:
        """Mean relative error on the validation samples."""
        return float(self._validation.relative_error(self._outputs(self._validation)).mean())

    # ------------------------------------------------------------------ fit

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
        step = lambda: self._step(total)  # noqa: E731
        return run_steps(self.state, self.preset.training, until, total, step, self._look, progress, checkpoint)

    def predict(self, query: Query) -> np.ndarray:
        """Predict radiance with the best weights so far, before they are quantised.

        Args:
            query: N queries.

        Returns:
            [N, 3] radiance, reflectance included.
        """
        weights = self.weights
        rows = GroupedRows(self._inputs.rows(query), self.segment(query), len(next(iter(weights.values()))))
        scale = self._setup.unit * (query.reflectance if self.preset.demodulated else 1.0)
        return rows.evaluate(self.mlp, weights) * scale

    # ------------------------------------------------------------------ lower

    def lower(self) -> Graph:
        """Return the shading graph; its output ``segment`` is the number of the expert or leaf of a point.

        Returns:
            The graph.
        """
        b = open_builder()
        x = self._inputs.node(b)
        segment = self._lower_segment(b, x)
        layers = graph_layers(self.weights, range(self.mlp.layers))
        x = add_layers(b, x, layers, self.mlp.activations, segment)
        radiance = as_radiance(b, x, self.preset.demodulated, self._setup.unit)
        return quantise(b.build(radiance=radiance, segment=segment), self.preset.storage)

    # ------------------------------------------------------------------ checkpoints

    def arrays(self) -> Arrays:
        """Return the state that a resumed training needs.

        Returns:
            Arrays [...] by name.
        """
        return state_arrays(self.state, self.facts) | prefixed("field", self._arrays())

    def restore(self, arrays: Arrays) -> None:
        """Restore the state of a fit of the same field, preset and samples.

        Args:
            arrays: Result of ``arrays``.
        """
        check_like(arrays, self.arrays(), (*STATE_VARYING, *(f"field.{name}" for name in self._varying)))
        state, facts = state_of(arrays)
        self._restore(under("field", arrays))
        self.state = state
        self.facts |= facts
        self._rearrange()


def state_arrays(state: TrainingState, facts: dict[str, Any]) -> Arrays:
    """Convert the state of a training and the facts of a fit to the arrays of a checkpoint.

    Args:
        state: Steps, errors and history.
        facts: JSON values.

    Returns:
        Arrays by name.
    """
    return state.arrays() | {"facts": np.array(json.dumps(facts))}


def state_of(arrays: Arrays) -> tuple[TrainingState, dict[str, Any]]:
    """Restore the state of a training and the facts of a fit.

    Args:
        arrays: The result of ``state_arrays`` by name (scalar values and history [K, 3]). A missing name is a
            ``KeyError``.

    Returns:
        State and facts.

    Raises:
        ValueError: The arrays do not describe a training.
    """
    state = TrainingState.of(arrays)
    try:
        facts = json.loads(str(arrays["facts"]))
    except RecursionError as error:
        raise ValueError("'facts' is nested too deeply") from error
    if not isinstance(facts, dict):
        raise ValueError("'facts' is not a JSON object")
    return state, facts
