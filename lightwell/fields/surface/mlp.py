"""One network for the whole scene: the two sizes of the 2013 report on raw inputs, and ``default`` on encoded inputs.

The targets of ``default`` are divided by the surface's reflectance (demodulated), so that textures stay sharp and the
network learns the light alone; its exponential output cannot be negative and holds a high dynamic range.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.fields.base import FieldSetup, Progress
from lightwell.fields.features import FeatureOctaves, encoded_features, open_builder, raw_features
from lightwell.fields.surface.field import SurfaceField
from lightwell.fields.tabulate import Tabulated
from lightwell.graph import Graph, quantise
from lightwell.networks import Mlp, Trainer, TrainingSet, TrainingSettings
from lightwell.networks.losses import EPSILON
from lightwell.networks.training import TrainingState
from lightwell.transport.samples import Query, Samples

_DEFAULT_OCTAVES = FeatureOctaves()
# Found by a sweep on the Cornell box; 3e-3 learns visibly less in the same steps.
_DEFAULT_TRAINING = TrainingSettings(rate=1e-2)


@dataclass(frozen=True)
class MlpPreset:
    """Settings of an ``mlp`` field."""

    hidden: tuple[int, ...]
    """Widths of the hidden layers."""
    encoded: bool = True
    """Encoded inputs and local light terms instead of the report's 12 raw numbers."""
    demodulated: bool = True
    """Targets divided by the reflectance."""
    activation: str = "silu"
    output: str = "exp"
    octaves: FeatureOctaves = _DEFAULT_OCTAVES
    training: TrainingSettings = _DEFAULT_TRAINING
    storage: str = "float16"
    """Type of the stored weights."""


# The report: tanh inside, sigmoid out, relative L1, μ = 0.5 · 50 / (50 + epoch), decay 1e-4, biases 0.25. Its text does
# not give a batch size.
_REPORT_TRAINING = TrainingSettings(
    loss="relative",
    optimiser="sgd",
    rate=0.5,
    schedule="report",
    batch=512,
    decay=1e-4,
    initial_bias=0.25,
    evaluate_every=500,
)


def _report(hidden: tuple[int, int]) -> MlpPreset:
    return MlpPreset(
        hidden, encoded=False, demodulated=False, activation="tanh", output="sigmoid", training=_REPORT_TRAINING
    )


PRESETS: dict[str, MlpPreset] = {
    "default": MlpPreset((64, 64)),
    "small": MlpPreset((32, 32)),
    "large": MlpPreset((128, 128)),
    "report-20": _report((20, 10)),
    "report-200": _report((200, 100)),
    "report": _report((200, 100)),
    # The report's code differs from its text: ReLU, μ = 0.1 · 100 / (100 + epoch), batches of 8, no decay.
    "report-code": replace(
        _report((20, 10)),
        activation="relu",
        training=replace(_REPORT_TRAINING, rate=0.1, tau=100.0, batch=8, decay=0.0),
    ),
}


@dataclass
class MlpFit:
    """See ``lightwell.fields.base.Learner``."""

    setup: FieldSetup
    preset: MlpPreset
    seed: int
    _trainer: Trainer = field(init=False)
    # Pixel features first, then those of the frame.
    _features: Tabulated = field(init=False)
    # How many of the features depend on the pixel.
    _pixel_width: int = field(init=False)
    _data: TrainingSet | None = None
    _validation: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def __post_init__(self) -> None:
        b = open_builder()
        pixel, frame = self._feature_nodes(b)
        graph = b.build(features=b.concat(*pixel, *frame))
        width = graph.widths[graph.outputs["features"]]
        self._pixel_width = sum(graph.widths[node] for node in pixel)
        self._features = Tabulated(graph)
        mlp = Mlp((width, *self.preset.hidden, 3), self.preset.activation, self.preset.output)
        self._trainer = Trainer(mlp, self.preset.training, self.seed)

    def _feature_nodes(self, b: Any) -> tuple[list[str], list[str]]:
        if self.preset.encoded:
            return encoded_features(b, self.setup, self.preset.octaves)
        pixel, frame = raw_features(b, self.setup)
        return pixel + frame, []

    @property
    def state(self) -> TrainingState:
        """Steps, errors and history of the training."""
        return self._trainer.state

    @property
    def macs(self) -> int:
        """Multiply-accumulates per pixel; what depends on the light alone is evaluated once per frame."""
        mlp = self._trainer.network
        return mlp.macs - (mlp.sizes[0] - self._pixel_width) * mlp.sizes[1]

    # ------------------------------------------------------------------ data

    def _feature_rows(self, query: Query) -> np.ndarray:
        """[N, F] features."""
        return self._features(query)["features"]

    def _modulation(self, query: Query) -> np.ndarray:
        """[N, 3] factor between the network's output and radiance."""
        return self.setup.unit * (query.reflectance if self.preset.demodulated else np.ones_like(query.reflectance))

    def learn_from(self, samples: Samples) -> None:
        """Set the training samples; their random order depends on the seed and their number alone.

        Args:
            samples: Path-traced samples.
        """
        order = np.random.default_rng((self.seed, len(samples))).permutation(len(samples))
        target = samples.radiance / self._modulation(samples.query)
        features = self._feature_rows(samples.query[order])
        self._data = TrainingSet.from_numpy(features, target[order], np.asarray(samples.weight)[order])

    def validate_on(self, samples: Samples) -> None:
        """Set the held-out samples of early stopping, on which mean |f − y| / (y + 0.01) in unit S is measured.

        Args:
            samples: Path-traced samples.
        """
        features = self._feature_rows(samples.query)
        scale = self._modulation(samples.query) / self.setup.unit
        self._validation = (features, scale, samples.radiance / self.setup.unit)

    def _error(self, parameters: dict[str, np.ndarray]) -> float:
        features, scale, truth = self._validation
        prediction = self._trainer.network.evaluate(parameters, features) * scale
        return float(np.mean(np.abs(prediction - truth) / (truth + EPSILON)))

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
        return self._trainer.fit(self._data, self._error, until, total, progress, checkpoint)

    def predict(self, query: Query) -> np.ndarray:
        """Predict radiance with the best weights so far, before they are quantised.

        Args:
            query: N queries.

        Returns:
            [N, 3] radiance, reflectance included.
        """
        output = self._trainer.network.evaluate(self._trainer.best, self._feature_rows(query))
        return output * self._modulation(query)

    def save(self, path: Path) -> None:
        """Write a checkpoint atomically.

        Args:
            path: File to write.
        """
        self._trainer.save(path)

    def load(self, path: Path) -> None:
        """Continue from a checkpoint.

        Args:
            path: File that ``save`` wrote.
        """
        self._trainer.load(path)

    # ------------------------------------------------------------------ lower

    def lower(self) -> Graph:
        """Return the shading graph: features, layers, unit. The light's part of the first layer is evaluated once per
        frame.

        Returns:
            The graph.
        """
        b = open_builder()
        pixel, frame = self._feature_nodes(b)
        weights = self._trainer.best
        x = self._first_layer(b, pixel, frame, weights)
        layers = self._trainer.network.layers
        for k in range(layers):
            if k:
                x = b.linear(x, weights[f"w{k}"].T, weights[f"b{k}"][0])
            x = b.activate(x, self.preset.activation if k + 1 < layers else self.preset.output)
        if not self.preset.demodulated:
            x = b.multiply(x, b.reciprocal("reflectance", 1e-9))
        return quantise(b.build(radiance=b.scale(x, self.setup.unit)), self.preset.storage)

    def _first_layer(self, b: Any, pixel: list[str], frame: list[str], weights: dict[str, np.ndarray]) -> str:
        split, w, bias = self._pixel_width, weights["w0"], weights["b0"][0]
        if not frame:
            return b.linear(b.concat(*pixel), w.T, bias)
        of_pixel = b.linear(b.concat(*pixel), w[:split].T, np.zeros_like(bias))
        of_frame = b.linear(b.concat(*frame, per_frame=True), w[split:].T, bias, per_frame=True)
        return b.add(of_pixel, of_frame)


FIELD = SurfaceField("mlp", PRESETS, MlpFit)
