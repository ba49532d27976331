"""Experts and a softmax gate that are trained together: the two gates that the 2013 report tried and abandoned.

p_j(x) = softmax_j of the gate's outputs z, l_j = loss of expert j on a sample. ``joint`` minimises the expected loss

    L = Σ_j p_j l_j,     ∂L/∂θ_j = p_j ∂l_j/∂θ_j,     ∂L/∂z_j = p_j (l_j − L)

``multinomial`` draws one expert k ~ p per sample, trains that one, and estimates the gate's gradient by the score
function (Williams 1992): ∂L/∂z_j ≈ l_k ([j = k] − p_j). Both are implemented as one surrogate, linear in l and z, with
coefficients that carry no gradient. Notation: M experts, B rows of a batch.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from lightwell.backend import dr, freeze, mi
from lightwell.files import Arrays, prefixed, under
from lightwell.networks.batched import initial_batch, shaped, take_rows
from lightwell.networks.checkpoint import check_like
from lightwell.networks.device import tensor, tensors
from lightwell.networks.loop import learning_rate
from lightwell.networks.losses import LOSSES
from lightwell.networks.mlp import Mlp
from lightwell.networks.optimisers import OPTIMISERS
from lightwell.networks.training import TrainingSettings

Estimator = Literal["joint", "multinomial"]
GATE, EXPERTS = "gate", "experts"


@dataclass(frozen=True)
class MixtureSet:
    """N rows in random order on the device."""

    features: Any
    """[N, F] tensor, inputs of the experts."""
    gate_features: Any
    """[N, G] tensor, inputs of the gate."""
    target: Any
    """[N, 3] tensor, unit S."""
    weight: Any
    """[N, 1] tensor, mean 1."""

    @staticmethod
    def from_numpy(*columns: np.ndarray) -> MixtureSet:
        """Copy rows to the device.

        Args:
            *columns: Features [N, F], gate features [N, G], targets [N, 3] and weights [N], in this order.

        Returns:
            The rows on the device.
        """
        return MixtureSet(*(tensor(a.reshape(len(a), -1)) for a in columns))

    def __len__(self) -> int:
        return self.features.shape[0]


class MixtureTrainer:
    """Trains M experts of the shape ``expert`` and a gate whose last layer is linear, one output per expert."""

    def __init__(self, expert: Mlp, gate: Mlp, estimator: Estimator, settings: TrainingSettings, seed: int) -> None:
        """Prepare a training.

        Args:
            expert: Shape of each expert.
            gate: Shape of the gate; the width of its last layer is the number of experts.
            estimator: How the gradient of the gate is estimated.
            settings: Loss, optimiser, batches and rates.
            seed: Seed of weights, batches and draws.
        """
        self.expert, self.gate, self.estimator, self.settings, self.seed = expert, gate, estimator, settings, seed
        self.steps = 0
        experts = gate.sizes[-1]
        start = {
            EXPERTS: initial_batch(expert, [seed + 1 + e for e in range(experts)], settings.initial_bias),
            GATE: initial_batch(gate, [seed]),
        }
        self._values = {part: tensors(weights) for part, weights in start.items()}
        self._moments = {part: tuple(tensors(_zeros(w)) for _ in range(2)) for part, w in start.items()}
        # Sums of the gate's gradient and of its squared norm since the last ``gradient_variance``.
        self._sums, self._squares, self._counted = tensors(_zeros(start[GATE])), mi.Float(0), 0

    @property
    def parameters(self) -> dict[str, dict[str, np.ndarray]]:
        """Current weights of ``experts`` [M, ...] and ``gate`` [1, ...]."""
        return {part: {name: np.array(v) for name, v in values.items()} for part, values in self._values.items()}

    def step(self, data: MixtureSet, total: int) -> Any:
        """Do one optimiser step.

        Args:
            data: Rows on the device.
            total: Steps of the whole schedule, ≥ 1.

        Returns:
            The mean loss, on the device.
        """
        settings, rows = self.settings, len(data)
        batch = min(settings.batch, rows)
        epoch, position = divmod(self.steps, max(rows // batch, 1))
        phase = np.random.default_rng((self.seed, epoch)).integers(rows)
        rate = learning_rate(settings, self.steps, total, self.steps * batch / rows)
        self.steps += 1
        start = dr.opaque(mi.UInt32, int(phase + position * batch) % rows)
        table = (data.features, data.gate_features, data.target, data.weight)
        step = recorded_step(self.expert, self.gate, self.estimator, settings, batch, rows)
        self._values, self._moments, self._sums, self._squares, loss = step(
            self._values,
            self._moments,
            self._sums,
            self._squares,
            table,
            start,
            tensor(np.full((1, 1, 1), rate)),
            dr.opaque(mi.UInt32, self.steps),
        )
        dr.eval(self._values, self._moments, self._sums, self._squares, loss)
        self._counted += 1
        return loss

    def gradient_variance(self) -> float:
        """Compute the variance of the gate's gradient, E‖g‖² − ‖E g‖², over the steps since the last call.

        Returns:
            The variance; 0 without a step.
        """
        if not self._counted:
            return 0.0
        mean = sum(float((np.array(s, np.float64) ** 2).sum()) for s in self._sums.values()) / self._counted**2
        variance = max(float(self._squares[0]) / self._counted - mean, 0.0)
        self._sums, self._squares, self._counted = tensors(_zeros(self.parameters[GATE])), mi.Float(0), 0
        return variance

    # ------------------------------------------------------------------ checkpoints

    def arrays(self) -> Arrays:
        """Collect the state that a resumed training needs; call it when a window of ``gradient_variance`` starts.

        Returns:
            Named arrays.
        """
        arrays: Arrays = {"steps": np.array(self.steps, np.int64)}
        for part, values in self._values.items():
            arrays |= prefixed(f"value.{part}", {name: np.array(v) for name, v in values.items()})
            for name, moment in zip(("first", "second"), self._moments[part]):
                arrays |= prefixed(f"{name}.{part}", {n: np.array(v) for n, v in moment.items()})
        return arrays

    def restore(self, arrays: Arrays) -> None:
        """Restore the state of a training of the same shapes.

        Args:
            arrays: Result of ``arrays``.
        """
        check_like(arrays, self.arrays())
        self.steps = int(arrays["steps"])
        for part in self._values:
            self._values[part] = tensors(under(f"value.{part}", arrays))
            self._moments[part] = tuple(tensors(under(f"{name}.{part}", arrays)) for name in ("first", "second"))


def _zeros(weights: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: np.zeros_like(value) for name, value in weights.items()}


@functools.lru_cache(maxsize=64)
def recorded_step(
    expert: Mlp, gate: Mlp, estimator: Estimator, settings: TrainingSettings, batch: int, rows: int
) -> Callable[..., Any]:
    """Record one optimiser step as a frozen function.

    Recordings are kept for the life of the process (see ``training.frozen_step``).

    Args:
        expert: Shape of each expert.
        gate: Shape of the gate.
        estimator: How the gradient of the gate is estimated.
        settings: Loss and optimiser.
        batch: Rows of a batch.
        rows: Length of the table; a recording serves one length only.

    Returns:
        The recorded step.
    """
    experts, update = gate.sizes[-1], OPTIMISERS[settings.optimiser][0]

    def step(values: Any, moments: Any, sums: Any, squares: Any, table: Any, start: Any, rate: Any, stream: Any) -> Any:
        features, gate_features, target, weight = table
        own = _run(start, batch, rows)
        # Every expert evaluates the whole batch.
        each = _run(start, batch, rows, experts)
        x, y = take_rows(features, each, (experts, batch)), take_rows(target, each, (experts, batch))
        g, w = take_rows(gate_features, own, (1, batch)), take_rows(weight, own, (batch,)).array
        values = {part: {name: mi.TensorXf(v) for name, v in v_.items()} for part, v_ in values.items()}
        dr.enable_grad(values)
        losses = LOSSES[settings.loss](expert(values[EXPERTS], x), y).array
        z = gate(values[GATE], g).array
        of_expert, of_gate, mean = coefficients(estimator, dr.detach(losses), dr.detach(z), batch, experts, stream)
        # Sample b of expert e is element (e B + b) 3 + c of the losses and element b M + e of the gate's outputs.
        at = dr.arange(mi.UInt32, experts * batch * 3)
        at_sample = (at // 3) % batch
        weight_here = dr.gather(mi.Float, w, at_sample) / (3 * batch)
        part = losses * dr.gather(mi.Float, of_expert, at_sample * experts + at // (3 * batch)) * weight_here
        gate_at = dr.arange(mi.UInt32, experts * batch) // experts
        dr.backward(dr.sum(part) + dr.sum(z * of_gate * dr.gather(mi.Float, w, gate_at) / batch))
        gradients = {part: {name: dr.grad(v) for name, v in v_.items()} for part, v_ in values.items()}
        values = {part: {name: dr.detach(v) for name, v in v_.items()} for part, v_ in values.items()}
        sums = {name: s + gradients[GATE][name] for name, s in sums.items()}
        squares = squares + sum(dr.sum(dr.square(g.array)) for g in gradients[GATE].values())
        moved, after = {}, {}
        for part in values:
            gradient = shaped(settings, gradients[part], values[part])
            moved[part], after[part] = update(values[part], gradient, moments[part], rate)
        return moved, after, sums, squares, dr.sum(mean * w) / batch

    return freeze(step)


def _run(start: Any, batch: int, rows: int, repeat: int = 1) -> Any:
    """Compute the row numbers of a batch, cyclic, ``repeat`` times."""
    at = start + dr.arange(mi.UInt32, repeat * batch) % batch
    return dr.select(at < rows, at, at - rows)


def coefficients(
    estimator: Estimator, losses: Any, z: Any, batch: int, experts: int, stream: Any
) -> tuple[Any, Any, Any]:
    """Compute the factors of expert losses and of gate outputs in the surrogate.

    Args:
        estimator: How the gradient of the gate is estimated.
        losses: [M·B·3] losses without gradient.
        z: [B·M] outputs of the gate without gradient.
        batch: B.
        experts: M.
        stream: Number that selects the random draws.

    Returns:
        Factors of the losses and of the outputs, [B·M] each, and the expected loss [B].
    """
    at = dr.arange(mi.UInt32, batch * experts)
    sample, expert = at // experts, at % experts
    # Softmax, and the mean loss over channels, both at b M + j.
    largest = dr.block_reduce(dr.ReduceOp.Max, z, experts)
    e = dr.exp(z - dr.gather(mi.Float, largest, sample))
    p = e / dr.gather(mi.Float, dr.block_sum(e, experts), sample)
    l = dr.gather(mi.Float, dr.block_sum(losses, 3) / 3, expert * batch + sample)
    mean = dr.block_sum(p * l, experts)
    if estimator == "joint":
        return p, p * (l - dr.gather(mi.Float, mean, sample)), mean
    # One expert per sample: the one whose interval of [0, 1) contains the sample's random number.
    below = dr.block_prefix_sum(p, experts, exclusive=True)
    above = dr.select(expert + 1 < experts, dr.gather(mi.Float, below, dr.minimum(at + 1, batch * experts - 1)), 2)
    u = mi.Float(mi.sample_tea_32(stream, sample)[0] >> 8) * 2**-24
    chosen = dr.select((below <= u) & (u < above), mi.Float(1), 0)
    drawn = dr.gather(mi.Float, dr.block_sum(chosen * l, experts), sample)
    return chosen, drawn * (chosen - p), mean
