"""Ten small experts and a gate that selects one of them for each point: the mixtures of the 2013 report.

Three gates, all of the shape 12-20-20-10:

    autoencoder  argmax of the code of a tied-weight auto-encoder of the inputs. It is trained first and then constant;
                 each expert learns from the samples that the gate assigns to it. It depends on geometry, not on light.
    joint        softmax; experts and gate minimise Σ_j p_j loss_j together. After a while such a gate hardly changes,
                 even if its split is bad.
    multinomial  one expert is drawn per sample; the gate learns by the score function, whose gradient is noisy.

``facts`` reproduces the findings of the report: entropy of the gate and share of every expert over time, and for
``joint`` and ``multinomial`` the variance of the gate's gradient. At run time every gate is an argmax. In the report's
presets light and view are inputs of the gate, so that a region may change its expert when they move; in ``default`` the
position alone is.

M experts, N samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from scipy.special import expit

from lightwell.fields.base import FieldSetup
from lightwell.fields.features import FeatureOctaves
from lightwell.fields.surface.field import SurfaceField
from lightwell.fields.surface.gate import append, choose, entropy, lower_choice, share_facts, shares, softmax
from lightwell.fields.surface.inputs import Inputs, Kind
from lightwell.fields.surface.segmented import NetworkPreset, SegmentedFit
from lightwell.files import Arrays, prefixed, under
from lightwell.graph import Builder
from lightwell.networks import Mlp, TrainingSettings
from lightwell.networks.autoencoder import GateTraining, TiedAutoencoder
from lightwell.networks.batched import BatchedSet, BatchedTrainer, initial_batch
from lightwell.networks.grouped import sort_into_runs
from lightwell.networks.loop import REPORT_TRAINING
from lightwell.networks.mixture import EXPERTS, GATE, MixtureSet, MixtureTrainer
from lightwell.transport.samples import Query

Gater = Literal["autoencoder", "joint", "multinomial"]
# Share of the samples, those whose two best experts are nearest, that counts as the border of a region.
BORDER_SHARE = 0.1
# Offset from the seeds of the gate.
EXPERT_SEED = 7919


@dataclass(frozen=True)
class ExpertsPreset(NetworkPreset):
    """Settings of an ``experts`` field."""

    gater: Gater = "autoencoder"
    experts: int = 10
    gate_inputs: Kind = "place"
    gate_hidden: tuple[int, ...] = (20, 20)
    gate_training: GateTraining = field(default_factory=GateTraining)
    """Of the auto-encoder; the other gates are trained as the experts are."""
    border_weight: float = 1.0
    """Weight of samples at borders of the 'autoencoder' gate: the report guessed that the worst-fitted samples there
    should count for more."""


_REPORT = ExpertsPreset(
    REPORT_TRAINING, "raw", demodulated=False, activation="tanh", output="sigmoid", gate_inputs="raw"
)

PRESETS: dict[str, ExpertsPreset] = {
    "default": ExpertsPreset(
        TrainingSettings(rate=1e-2, batch=1024),
        "encoded",
        octaves=FeatureOctaves(position=2, light=1),
        gate_training=GateTraining(batch=128, most_updates=4000),
    ),
    "report": _REPORT,
    "report-joint": replace(_REPORT, gater="joint", training=replace(REPORT_TRAINING, batch=512)),
    "report-multinomial": replace(_REPORT, gater="multinomial", training=replace(REPORT_TRAINING, batch=512)),
    # The report's code differs from its text: ReLU, batches of 16, decay 1e-6. There a batch is shared by the experts,
    # and its first sample goes to all of them; here every expert has batches of its own.
    "report-code": replace(_REPORT, activation="relu", training=replace(REPORT_TRAINING, batch=16, decay=1e-6)),
    "report-border-boost": replace(_REPORT, border_weight=2.0),
}


class GatedFit(SegmentedFit):
    """Base of fields with a learned gate: the gate in prediction and graph, and the facts about it."""

    preset: ExpertsPreset

    def __init__(self, setup: FieldSetup, preset: ExpertsPreset, seed: int) -> None:
        """Start a fit.

        Args:
            setup: Bounds, light and radiance unit of the scene.
            preset: Settings.
            seed: Seed of the weights.
        """
        super().__init__(setup, preset, seed)
        self.gate_inputs = Inputs(setup, preset.gate_inputs, preset.octaves)
        self.gate = Mlp((self.gate_inputs.width, *preset.gate_hidden, preset.experts), "tanh", "identity")
        self.gate_weights = self.gate.initial(seed)
        self.facts |= {"gate": self._kind, "curves": {}}

    @property
    def _kind(self) -> str:
        return self.preset.gater

    @property
    def macs(self) -> int:
        """Multiply-accumulates of one expert and the gate."""
        return self.mlp.macs + self.gate.macs

    def segment(self, query: Query) -> np.ndarray:
        """Select the expert of each point.

        Args:
            query: N queries.

        Returns:
            [N] int expert.
        """
        return choose(self.gate, self.gate_weights, self.gate_inputs.rows(query))

    def _lower_segment(self, b: Builder, x: str) -> str:
        gated = x if self.preset.gate_inputs == self.preset.inputs else self.gate_inputs.node(b)
        return lower_choice(b, self.gate, self.gate_weights, gated)

    def _describe(self, probabilities: np.ndarray, **more: Any) -> None:
        """Add a point to the curves; probabilities [N, M] of the gate on some samples."""
        share = shares(probabilities.argmax(axis=1), self.preset.experts)
        append(
            self.facts["curves"],
            step=self.state.step,
            entropy=round(entropy(probabilities), 5),
            entropy_of_shares=round(entropy(share), 5),
            share=[round(float(s), 4) for s in share],
            **more,
        )


class CodedFit(GatedFit):
    """Gate by auto-encoder: trained by the first ``train``, constant afterwards. See ``fields.base.Learner``."""

    def __init__(self, setup: FieldSetup, preset: ExpertsPreset, seed: int) -> None:
        """Start a fit.

        Args:
            setup: Bounds, light and radiance unit of the scene.
            preset: Settings.
            seed: Seed of the weights.
        """
        super().__init__(setup, preset, seed)
        self._coder = TiedAutoencoder((self.gate_inputs.width, *preset.gate_hidden, preset.experts))
        seeds = seed * EXPERT_SEED + np.arange(preset.experts)
        self._trainer = BatchedTrainer(self.mlp, preset.training, seeds)
        self._gated = False
        # Computed from the samples when needed: training set; validation's expert of each row.
        self.training_set: Any = None
        self._owner: np.ndarray | None = None

    @property
    def weights(self) -> dict[str, np.ndarray]:
        """Best weights of each expert."""
        return self._trainer.best

    def _rearrange(self) -> None:
        self.training_set = self._owner = None

    # ------------------------------------------------------------------ gate

    def learn_gate(self) -> None:
        """Train the auto-encoder on the inputs of the training samples; its encoder becomes the gate."""
        rows = self.gate_inputs.rows(self.examples.query)
        code, history = self._coder.train(rows, self.preset.gate_training, self._seed)
        self.gate_weights = {
            f"{kind}{k}": code[f"{kind}{k}"].reshape(shape).astype(np.float32)
            for k, (a, b) in enumerate(zip(self.gate.sizes, self.gate.sizes[1:]))
            for kind, shape in (("w", (a, b)), ("b", (1, b)))
        }
        self.facts["gate_loss"] = [round(value, 5) for value in history]
        self._gated = True

    def at_border(self, rows: np.ndarray) -> np.ndarray:
        """Find samples at a border: their two largest codes are among the nearest to each other.

        Args:
            rows: [N, G] inputs of the gate.

        Returns:
            [N] bool.
        """
        code = expit(self.gate.evaluate(self.gate_weights, rows))
        largest = np.partition(code, -2, axis=1)[:, -2:]
        margin = largest[:, 1] - largest[:, 0]
        return margin <= np.quantile(margin, BORDER_SHARE)

    def _arrange(self) -> None:
        """Assign every sample to its expert."""
        examples = self.examples
        rows = self.gate_inputs.rows(examples.query)
        expert = choose(self.gate, self.gate_weights, rows)
        self.facts |= share_facts(expert, self.preset.experts)
        weight = examples.weight
        if self.preset.border_weight != 1.0:
            weight = weight * np.where(self.at_border(rows), self.preset.border_weight, 1.0)
        order, runs = sort_into_runs(expert, self.preset.experts, (self._seed, len(examples)))
        self.training_set = BatchedSet.from_numpy(examples.features[order], examples.target[order], weight[order], runs)

    # ------------------------------------------------------------------ fit

    def _step(self, total: int) -> bool:
        if not self._gated:
            self.learn_gate()
        if self.training_set is None:
            self._arrange()
        self._last = self._trainer.step(self.training_set, total)
        self.state.samples_seen += self.preset.training.batch * self.preset.experts
        return False

    def _look(self) -> tuple[float, float]:
        validation, experts = self._validation, self.preset.experts
        if self._owner is None:
            self._owner = self.segment(validation.query)
        count = np.bincount(self._owner, minlength=experts)
        error = validation.relative_error(self._outputs(validation, self._trainer.parameters))
        with np.errstate(invalid="ignore", divide="ignore"):
            each = np.bincount(self._owner, error, experts) / count
        # Experts without validation samples keep their latest weights.
        self._trainer.look(np.where(count > 0, each, -float(self.state.step)))
        code = expit(self.gate.evaluate(self.gate_weights, self.gate_inputs.rows(validation.query)))
        self._describe(code / code.sum(axis=1, keepdims=True))
        losses, share = self._trainer.losses(self._last), count / len(validation)
        best = np.where(count > 0, self._trainer.best_error, 0)
        return float((losses * share).sum()), float((best * share).sum())

    # ------------------------------------------------------------------ checkpoints

    def _arrays(self) -> Arrays:
        arrays = prefixed("gate", self.gate_weights) | prefixed("experts", self._trainer.arrays())
        return arrays | {"gated": np.array(self._gated)}

    def _restore(self, arrays: Arrays) -> None:
        self.gate_weights, self._gated = under("gate", arrays), bool(arrays["gated"])
        self._trainer.restore(under("experts", arrays))


class JointFit(GatedFit):
    """Experts and softmax gate together, by ``joint`` or ``multinomial``. See ``lightwell.fields.base.Learner``."""

    def __init__(self, setup: FieldSetup, preset: ExpertsPreset, seed: int) -> None:
        """Start a fit.

        Args:
            setup: Bounds, light and radiance unit of the scene.
            preset: Settings.
            seed: Seed of the weights.
        """
        super().__init__(setup, preset, seed)
        self._trainer = MixtureTrainer(self.mlp, self.gate, preset.gater, preset.training, seed * EXPERT_SEED)
        self._best = initial_batch(self.mlp, seed * EXPERT_SEED + np.arange(preset.experts))
        self._data: Any = None
        self._gate_rows: np.ndarray | None = None

    @property
    def weights(self) -> dict[str, np.ndarray]:
        """Weights of the experts at the least validation error of the whole."""
        return self._best

    def _rearrange(self) -> None:
        self._data = self._gate_rows = None

    def _arrange(self) -> None:
        examples = self.examples
        order = np.random.default_rng((self._seed, len(examples))).permutation(len(examples))
        gated = self.gate_inputs.rows(examples.query)
        weight = examples.weight / examples.weight.mean()
        columns = (examples.features, gated, examples.target, weight)
        self._data = MixtureSet.from_numpy(*(column[order] for column in columns))

    def _step(self, total: int) -> bool:
        if self._data is None:
            self._arrange()
        self._last = self._trainer.step(self._data, total)
        self.state.samples_seen += min(self.preset.training.batch, len(self._data))
        return False

    def _look(self) -> tuple[float, float]:
        validation = self._validation
        if self._gate_rows is None:
            self._gate_rows = self.gate_inputs.rows(validation.query)
        now = self._trainer.parameters
        kept = self._best, self.gate_weights
        self._best, self.gate_weights = now[EXPERTS], {name: value[0] for name, value in now[GATE].items()}
        z = self.gate.evaluate(self.gate_weights, self._gate_rows)
        self._describe(softmax(z), gate_gradient_variance=self._trainer.gradient_variance())
        error = self._validation_error()
        if error >= self.state.best_error:
            self._best, self.gate_weights = kept
        else:
            self.facts |= share_facts(z.argmax(axis=1), self.preset.experts)
        return float(self._last[0]), error

    # ------------------------------------------------------------------ checkpoints

    def _arrays(self) -> Arrays:
        best = prefixed("best", self._best) | prefixed("gate", self.gate_weights)
        return best | prefixed("trainer", self._trainer.arrays())

    def _restore(self, arrays: Arrays) -> None:
        self._best, self.gate_weights = under("best", arrays), under("gate", arrays)
        self._trainer.restore(under("trainer", arrays))


def _learner(setup: FieldSetup, preset: ExpertsPreset, seed: int) -> GatedFit:
    return (CodedFit if preset.gater == "autoencoder" else JointFit)(setup, preset, seed)


FIELD = SurfaceField("experts", PRESETS, _learner)
