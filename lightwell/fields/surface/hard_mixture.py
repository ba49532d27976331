"""A hard parallel mixture of experts (Collobert, Bengio & Bengio 2002 and 2003).

Split the samples at random into M parts. Then, round after round:

    1. train the experts apart, each on its part;
    2. freeze them and train the gate on everything: it minimises Σ_j p_j loss_j;
    3. send each sample to the expert that the gate prefers, at most n/M · (1 + margin) samples to one;

until the validation error has not fallen for some rounds. Time is nearly linear in the number of samples, because no
expert sees another one's. How full an expert may be is not in the sources; the margin here is a third. The weights with
the least validation error are kept. M experts, n samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.fields.surface.experts import PRESETS as EXPERTS_PRESETS
from lightwell.fields.surface.experts import ExpertsPreset, GatedFit
from lightwell.fields.surface.field import SurfaceField
from lightwell.fields.surface.gate import share_facts, softmax
from lightwell.files import Arrays, prefixed, under
from lightwell.networks import LOSSES, TrainingSettings
from lightwell.networks.batched import BatchedSet, BatchedTrainer, initial_batch
from lightwell.networks.capacity import assign_within
from lightwell.networks.checkpoint import check_like
from lightwell.networks.device import tensor
from lightwell.networks.grouped import Runs, sort_into_runs

# Share of a round's steps that train the experts; the rest train the gate.
EXPERT_STEPS = 2 / 3
# Offset from the seeds of the experts.
GATE_SEED = 104_729

_GATE_TRAINING = TrainingSettings(loss="expected", rate=1e-2, batch=1024)


@dataclass(frozen=True)
class HardMixturePreset(ExpertsPreset):
    """Settings of a ``hard-mixture`` field."""

    rounds: int = 6
    """Number of rounds that the steps are divided into."""
    patience_rounds: int = 2
    """Rounds without a lower validation error until the training stops."""
    margin: float = 1 / 3
    """Largest relative excess of an expert's samples over n/M."""
    gate_settings: TrainingSettings = _GATE_TRAINING


def _of(preset: ExpertsPreset, **changes: Any) -> HardMixturePreset:
    return HardMixturePreset(**(vars(preset) | changes))


PRESETS: dict[str, HardMixturePreset] = {
    "default": _of(EXPERTS_PRESETS["default"]),
    # The experts of the 2013 report, whose author reports that this method works but is difficult to tune.
    "report": _of(
        EXPERTS_PRESETS["report"],
        gate_settings=replace(EXPERTS_PRESETS["report"].training, loss="expected", batch=512, initial_bias=0.0),
    ),
}


class HardMixtureFit(GatedFit):
    """See ``lightwell.fields.base.Learner``."""

    preset: HardMixturePreset

    def __init__(self, setup: FieldSetup, preset: HardMixturePreset, seed: int) -> None:
        """Start a fit.

        Args:
            setup: Bounds, light and radiance unit of the scene.
            preset: Settings.
            seed: Seed of the weights and of the first split.
        """
        super().__init__(setup, preset, seed)
        self.facts["rounds"] = []
        # Initial weights of the trainers of this round.
        start = initial_batch(self.mlp, self._expert_seeds, preset.training.initial_bias)
        gate = {name: value[None] for name, value in self.gate_weights.items()}
        self._best = start
        # Steps per round, fixed when training starts; round; step in it; rounds without a gain.
        self._round_steps = self._round = self._step_in_round = self._idle = 0
        self._round_error = np.inf
        self._experts = BatchedTrainer(self.mlp, preset.training, self._expert_seeds, start)
        self._gate = self._gate_trainer(gate)
        # The gate by which samples are assigned; none in the first round, which is random.
        self._assigning: dict[str, np.ndarray] | None = None
        # Computed from the samples when needed: the experts' rows, the gate's rows, features of the gate.
        self._expert_data: Any = None
        self._gate_data: Any = None
        self._gate_rows: dict[str, np.ndarray] = {}

    @property
    def _kind(self) -> str:
        return "hard mixture"

    @property
    def _expert_seeds(self) -> np.ndarray:
        return self._seed * 1000 + np.arange(self.preset.experts)

    def _gate_trainer(self, weights: dict[str, np.ndarray]) -> BatchedTrainer:
        return BatchedTrainer(self.gate, self.preset.gate_settings, [self._seed + GATE_SEED], weights)

    @property
    def weights(self) -> dict[str, np.ndarray]:
        """Weights of the experts at the least validation error of the whole."""
        return self._best

    def _rearrange(self) -> None:
        self._expert_data = self._gate_data = None
        self._gate_rows = {}

    # ------------------------------------------------------------------ samples

    def _rows(self, kind: str) -> np.ndarray:
        """[N, G] gate inputs of 'examples' or '_validation'."""
        if kind not in self._gate_rows:
            self._gate_rows[kind] = self.gate_inputs.rows(getattr(self, kind).query)
        return self._gate_rows[kind]

    def assignment(self) -> np.ndarray:
        """Assign training samples to experts: at random in the first round, then by the gate, within the cap.

        Returns:
            [n] expert of each training sample.
        """
        count, experts = len(self.examples), self.preset.experts
        if self._assigning is None:
            return np.random.default_rng((self._seed, count)).permutation(count) % experts
        preference = softmax(self.gate.evaluate(self._assigning, self._rows("examples")))
        return assign_within(preference, int(np.ceil(count / experts * (1 + self.preset.margin))))

    def _arrange_experts(self) -> None:
        examples, expert = self.examples, self.assignment()
        self.facts |= share_facts(expert, self.preset.experts)
        order, runs = sort_into_runs(expert, self.preset.experts, (self._seed, len(examples)))
        features, target, weight = examples.features[order], examples.target[order], examples.weight[order]
        self._expert_data = BatchedSet.from_numpy(features, target, weight, runs)

    def _arrange_gate(self) -> None:
        """Training data of the gate: its inputs, and the loss of every frozen expert on every sample."""
        examples, count = self.examples, len(self.examples)
        target, loss = tensor(examples.target), LOSSES[self.preset.training.loss]
        frozen = self._experts.parameters
        losses = np.empty((count, self.preset.experts), np.float32)
        for e in range(self.preset.experts):
            output = self.mlp.evaluate({name: value[e] for name, value in frozen.items()}, examples.features)
            losses[:, e] = np.array(loss(tensor(output), target)).mean(axis=1)
        order = np.random.default_rng((self._seed, count)).permutation(count)
        losses, runs = losses / max(losses.mean(), 1e-12), Runs(np.array([0]), np.array([count]))
        rows = self._rows("examples")[order]
        self._gate_data = BatchedSet.from_numpy(rows, losses[order], examples.weight[order], runs)

    # ------------------------------------------------------------------ fit

    def _step(self, total: int) -> bool:
        if self._idle >= self.preset.patience_rounds:
            return True
        self._round_steps = self._round_steps or max(total // self.preset.rounds, 2)
        for_experts = max(int(EXPERT_STEPS * self._round_steps), 1)
        if self._step_in_round < for_experts:
            if self._expert_data is None:
                self._arrange_experts()
            self._experts.step(self._expert_data, for_experts)
            self.state.samples_seen += self.preset.training.batch * self.preset.experts
        else:
            if self._gate_data is None:
                self._arrange_gate()
            self._gate.step(self._gate_data, self._round_steps - for_experts)
        self._step_in_round += 1
        if self._step_in_round >= self._round_steps:
            self._end_round()
        return False

    def _end_round(self) -> None:
        """Measure the error, reassign the samples by the gate, and begin another round from the current weights."""
        error = self._keep()
        self._idle = 0 if error < self._round_error else self._idle + 1
        self._round_error = min(error, self._round_error)
        experts, gate = self._experts.parameters, self._gate.parameters
        old = self.assignment()
        self._assigning = {name: value[0] for name, value in gate.items()}
        moved = float((self.assignment() != old).mean())
        self._round += 1
        self.facts["rounds"].append({"round": self._round, "error": round(error, 5), "moved": round(moved, 4)})
        self._step_in_round = 0
        self._experts = BatchedTrainer(self.mlp, self.preset.training, self._expert_seeds + self._round, experts)
        self._gate = self._gate_trainer(gate)
        self._expert_data = self._gate_data = None
        if error < self.state.best_error:
            self.state.best_error, self.state.best_step = error, self.state.step + 1

    def _keep(self) -> float:
        """Validation error of the current experts and gate; they are kept when it is the least so far."""
        kept = self._best, self.gate_weights
        self._best = self._experts.parameters
        self.gate_weights = {name: value[0] for name, value in self._gate.parameters.items()}
        error = self._validation_error()
        if error >= self.state.best_error:
            self._best, self.gate_weights = kept
        return error

    def _look(self) -> tuple[float, float]:
        error = self._keep()
        gate = {name: value[0] for name, value in self._gate.parameters.items()}
        self._describe(softmax(self.gate.evaluate(gate, self._rows("_validation"))))
        return error, error

    # ------------------------------------------------------------------ checkpoints

    _varying = ("assigning.",)

    def _arrays(self) -> Arrays:
        arrays = prefixed("best", self._best) | prefixed("gate", self.gate_weights)
        arrays |= prefixed("assigning", self._assigning or {})
        arrays |= prefixed("experts", self._experts.arrays()) | prefixed("gating", self._gate.arrays())
        counts = (self._round_steps, self._round, self._step_in_round, self._idle)
        return arrays | {"counts": np.array(counts), "round_error": np.array(self._round_error)}

    def _restore(self, arrays: Arrays) -> None:
        assigning = under("assigning", arrays) or None
        check_like(assigning or self.gate_weights, self.gate_weights)
        self._best, self.gate_weights, self._assigning = under("best", arrays), under("gate", arrays), assigning
        self._experts.restore(under("experts", arrays))
        self._gate.restore(under("gating", arrays))
        self._round_steps, self._round, self._step_in_round, self._idle = (int(n) for n in arrays["counts"])
        self._round_error = float(arrays["round_error"])


FIELD = SurfaceField("hard-mixture", PRESETS, HardMixtureFit)
