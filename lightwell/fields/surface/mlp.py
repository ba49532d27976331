"""One network for the whole scene: the two sizes of the 2013 report on raw inputs, and ``default`` on encoded inputs.

The targets of ``default`` are divided by the surface's reflectance (demodulated), so that textures stay sharp and the
network learns the light alone; its exponential output cannot be negative and holds a high dynamic range.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lightwell.fields.features import FeatureOctaves, encoded_features, open_builder, raw_features
from lightwell.fields.surface.field import SurfaceField
from lightwell.fields.surface.lowering import as_radiance, graph_layers
from lightwell.fields.surface.network_fit import NetworkFit
from lightwell.fields.surface.options import SurfaceOptions
from lightwell.fields.tabulate import Tabulated
from lightwell.graph import Graph, quantise
from lightwell.graph.layers import add_layers
from lightwell.networks import Mlp, Trainer, TrainingSet, TrainingSettings
from lightwell.networks.loop import REPORT_TRAINING
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


# The report's text does not give a batch size.
_REPORT_TRAINING = replace(REPORT_TRAINING, batch=512, evaluate_every=500)


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
class MlpFit(NetworkFit):
    """See ``lightwell.fields.base.Learner``."""

    preset: MlpPreset
    # Pixel features first, then those of the frame.
    _features: Tabulated = field(init=False)
    # How many of the features depend on the pixel.
    _pixel_width: int = field(init=False)

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
    def macs(self) -> int:
        """Multiply-accumulates per pixel; what depends on the light alone is evaluated once per frame."""
        mlp = self._trainer.network
        return mlp.macs - (mlp.sizes[0] - self._pixel_width) * mlp.sizes[1]

    # ------------------------------------------------------------------ data

    def _rows(self, query: Query) -> np.ndarray:
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
        features = self._rows(samples.query[order])
        self._data = TrainingSet.from_numpy(features, target[order], np.asarray(samples.weight)[order])

    # ------------------------------------------------------------------ lower

    def lower(self) -> Graph:
        """Return the shading graph: features, layers, unit. The light's part of the first layer is evaluated once per
        frame.

        Returns:
            The graph.
        """
        b = open_builder()
        pixel, frame = self._feature_nodes(b)
        weights, mlp = self._trainer.best, self._trainer.network
        x = b.activate(self._first_layer(b, pixel, frame, weights), mlp.activations[0])
        x = add_layers(b, x, graph_layers(weights, range(1, mlp.layers)), mlp.activations[1:])
        return quantise(
            b.build(radiance=as_radiance(b, x, self.preset.demodulated, self.setup.unit)), self.preset.storage
        )

    def _first_layer(self, b: Any, pixel: list[str], frame: list[str], weights: dict[str, np.ndarray]) -> str:
        split, w, bias = self._pixel_width, weights["w0"], weights["b0"][0]
        if not frame:
            return b.linear(b.concat(*pixel), w.T, bias)
        of_pixel = b.linear(b.concat(*pixel), w[:split].T, np.zeros_like(bias))
        of_frame = b.linear(b.concat(*frame, per_frame=True), w[split:].T, bias, per_frame=True)
        return b.add(of_pixel, of_frame)


FIELD = SurfaceField("mlp", PRESETS, MlpFit, SurfaceOptions)
