"""Training of many networks of one shape at once: thousands of networks are one launch instead of a Python loop.

Notation: E networks, B rows of a batch per network, F features. Parameters are those of ``Mlp`` with one more axis in
front: ``w0 [E, in, out], b0 [E, 1, out], …``. The networks share only the launch: each has its own rows, batches, rate,
gradient clipping and best weights, so that each ends with the weights of a training on its own.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, freeze, mi, upload_integers
from lightwell.files import Arrays, prefixed, under
from lightwell.networks.checkpoint import check_like
from lightwell.networks.device import tensor, tensors
from lightwell.networks.grouped import Runs
from lightwell.networks.loop import learning_rate
from lightwell.networks.losses import LOSSES
from lightwell.networks.mlp import Mlp
from lightwell.networks.optimisers import OPTIMISERS
from lightwell.networks.training import TrainingSettings

# Memory that one launch may take, bytes: more networks are trained in several launches per step.
MEMORY = 2 << 30
# Arrays of the size of a layer's output that forward and backward pass keep (measured).
COPIES = 6
# Up to this many networks are launched without padding; more are padded so that few sizes have to be compiled.
EXACT = 16


@dataclass(frozen=True)
class BatchedSet:
    """The rows of E networks on the device: those of network e are a contiguous run in random order."""

    features: Any
    """[N, F] tensor."""
    target: Any
    """[N, 3] tensor, unit S."""
    weight: Any
    """[N, 1] tensor, importance weights with mean 1 in every run."""
    runs: Runs

    @staticmethod
    def from_numpy(features: np.ndarray, target: np.ndarray, weight: np.ndarray, runs: Runs) -> BatchedSet:
        """Copy rows to the device.

        Args:
            features: [N, F] inputs, in the order of ``sort_into_runs``.
            target: [N, 3] targets in unit S.
            weight: [N] importance weights; scaled to mean 1 in every run.
            runs: Rows of each network.

        Returns:
            The rows on the device.
        """
        mean = np.nan_to_num(runs.mean(weight), nan=1.0)
        scaled = weight / np.maximum(mean, 1e-30)[runs.group]
        return BatchedSet(tensor(features), tensor(target), tensor(scaled[:, None]), runs)


def initial_batch(mlp: Mlp, seeds: Sequence[int] | np.ndarray, bias: float = 0.0) -> dict[str, np.ndarray]:
    """Draw initial weights of one network per seed, the same as ``mlp.initial`` of each.

    Args:
        mlp: Shape of the networks.
        seeds: [E] seeds.
        bias: Initial value of the biases.

    Returns:
        Stacked weights, [E, ...] each.
    """
    each = [mlp.initial(int(seed), bias) for seed in seeds]
    return {name: np.stack([weights[name] for weights in each]) for name in each[0]}


def _phase(seed: np.ndarray, epoch: np.ndarray) -> np.ndarray:
    """Hash (seed, epoch) to random 63-bit numbers (SplitMix64, Steele et al. 2014), [E] → [E]."""
    with np.errstate(over="ignore"):
        z = (seed.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
        z += (epoch.astype(np.uint64) + np.uint64(1)) * np.uint64(0xD1B54A32D192ED03)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((z ^ (z >> np.uint64(31))) >> np.uint64(1)).astype(np.int64)


class BatchedTrainer:
    """Trains E networks of the shape ``mlp``.

    A batch of network e is a run of ``settings.batch`` of its own rows, cyclic; a network without rows keeps its
    weights. ``best`` holds, for each network separately, the weights with the least error given to ``look``.
    """

    def __init__(
        self,
        mlp: Mlp,
        settings: TrainingSettings,
        seeds: Sequence[int] | np.ndarray,
        initial: Mapping[str, np.ndarray] | None = None,
        memory: int = MEMORY,
    ) -> None:
        """Prepare a training.

        Args:
            mlp: Shape of the networks.
            settings: Loss, optimiser, batches and rates.
            seeds: [E] seeds of the initial weights and batches of each network.
            initial: Weights to start from, [E, ...] arrays; None: random ones.
            memory: Bytes that one launch may take; more networks are trained in several launches per step.
        """
        self.mlp, self.settings, self.memory = mlp, settings, memory
        self.seeds = np.asarray(seeds, np.int64)
        self.steps = 0
        start = initial_batch(mlp, self.seeds, settings.initial_bias) if initial is None else initial
        self.best = {name: np.array(value, np.float32) for name, value in start.items()}
        self.best_error = np.full(len(self), np.inf)
        # Networks per launch, and the first network of each launch.
        self._size = min(padded(len(self)), self._most_at_once())
        self._begins = range(0, len(self), self._size)
        zeros = {name: np.zeros_like(value) for name, value in self.best.items()}
        self._values = [self._upload(self.best, begin) for begin in self._begins]
        self._moments = [tuple(self._upload(zeros, begin) for _ in range(2)) for begin in self._begins]

    def __len__(self) -> int:
        return len(self.seeds)

    def _most_at_once(self) -> int:
        """Compute how many networks fit into the memory of a launch."""
        per_row = COPIES * sum(self.mlp.sizes) * 4
        return max(self.memory // (per_row * self.settings.batch), 1)

    def _upload(self, arrays: Mapping[str, np.ndarray], begin: int) -> dict[str, Any]:
        """Upload the networks of one launch as tensors, padded with zeros."""
        return tensors({name: self._slice(value, begin) for name, value in arrays.items()})

    def _slice(self, values: np.ndarray, begin: int) -> np.ndarray:
        part = values[begin : begin + self._size]
        return np.concatenate([part, np.zeros((self._size - len(part), *part.shape[1:]), part.dtype)])

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Current weights, [E, ...] arrays."""
        return self._download(self._values)

    def _download(self, chunks: list[dict[str, Any]]) -> dict[str, np.ndarray]:
        return {name: np.concatenate([np.array(c[name]) for c in chunks])[: len(self)] for name in chunks[0]}

    # ------------------------------------------------------------------ one step

    @property
    def launches(self) -> int:
        """Launches of a step."""
        return len(self._begins)

    def starts(self, count: np.ndarray) -> np.ndarray:
        """Compute where the next batch of each network begins, from (seed, step, count) alone.

        An epoch reads its rows, which are in random order, from a random phase on.

        Args:
            count: [E] rows of each network.

        Returns:
            [E] places within each run.
        """
        batches = np.maximum(count // self.settings.batch, 1)
        epoch, position = np.divmod(self.steps, batches)
        return (_phase(self.seeds, epoch) + position * self.settings.batch) % np.maximum(count, 1)

    def _rates(self, count: np.ndarray, total: int) -> np.ndarray:
        """Compute the learning rate of each network, [E]: an epoch is one pass through its own rows."""
        epoch = self.steps * self.settings.batch / np.maximum(count, 1)
        return np.broadcast_to(learning_rate(self.settings, self.steps, total, epoch), count.shape)

    def step(self, data: BatchedSet, total: int) -> list[Any]:
        """Do one optimiser step of all networks.

        Args:
            data: Rows on the device.
            total: Steps of the whole schedule, ≥ 1.

        Returns:
            Losses of the networks, one array per launch, on the device; see ``losses``.
        """
        count = data.runs.count
        starts, rates = self.starts(count), self._rates(count, total)
        table = (data.features, data.target, data.weight)
        step = recorded_step(self.mlp, self.settings, self._size, data.features.shape[0])
        losses = []
        for k, begin in enumerate(self._begins):
            runs = tuple(upload_integers(self._slice(a, begin)) for a in (data.runs.first, count, starts))
            rate = tensor(self._slice(rates, begin)[:, None, None])
            self._values[k], self._moments[k], loss = step(self._values[k], self._moments[k], table, runs, rate)
            dr.eval(self._values[k], self._moments[k], loss)
            losses.append(loss)
        self.steps += 1
        return losses

    def losses(self, device: list[Any]) -> np.ndarray:
        """Copy the losses of a step to NumPy.

        Args:
            device: Result of ``step``.

        Returns:
            [E] losses.
        """
        return np.concatenate([np.array(loss) for loss in device])[: len(self)]

    def look(self, error: np.ndarray) -> np.ndarray:
        """Keep the current weights of the networks whose error is the least so far.

        Args:
            error: [E] validation errors.

        Returns:
            [E] bool, the networks that improved.
        """
        return keep_better(self.best, self.best_error, self.parameters, error)

    # ------------------------------------------------------------------ checkpoints

    def arrays(self) -> Arrays:
        """Collect the state that a resumed training needs.

        Returns:
            Named arrays.
        """
        arrays = {"steps": np.array(self.steps, np.int64), "seeds": self.seeds, "best_error": self.best_error}
        arrays |= prefixed("value", self.parameters) | prefixed("best", self.best)
        for k, name in enumerate(("first", "second")):
            arrays |= prefixed(name, self._download([moments[k] for moments in self._moments]))
        return arrays

    def restore(self, arrays: Arrays) -> None:
        """Restore the state of a training of the same shape and number of networks.

        Args:
            arrays: Result of ``arrays``.
        """
        check_like(arrays, self.arrays())
        values = under("value", arrays)
        self.steps, self.seeds = int(arrays["steps"]), arrays["seeds"]
        self.best, self.best_error = under("best", arrays), arrays["best_error"].copy()
        self._values = [self._upload(values, begin) for begin in self._begins]
        moments = [under(name, arrays) for name in ("first", "second")]
        self._moments = [tuple(self._upload(m, begin) for m in moments) for begin in self._begins]


def keep_better(
    best: dict[str, np.ndarray], best_error: np.ndarray, parameters: Mapping[str, np.ndarray], error: np.ndarray
) -> np.ndarray:
    """Replace the best weights and errors, in place, of the networks whose error is less.

    Args:
        best: Best weights so far, [E, ...] arrays; changed.
        best_error: [E] their errors; changed.
        parameters: Current weights, [E, ...] arrays.
        error: [E] their errors.

    Returns:
        [E] bool, the networks that improved.
    """
    better = np.asarray(error) < best_error
    for name, value in parameters.items():
        best[name][better] = value[better]
    best_error[better] = np.asarray(error)[better]
    return better


def padded(count: int) -> int:
    """Round up to the next of 16, 20, 24, 28, 32, 40, 48, …; small counts are not changed.

    Args:
        count: Number of networks, ≥ 0.

    Returns:
        Number of networks of a launch.
    """
    if count <= EXACT:
        return count
    step = 1 << (max((count - 1).bit_length() - 3, 0))
    return -(-count // step) * step


@functools.lru_cache(maxsize=256)
def recorded_step(mlp: Mlp, settings: TrainingSettings, networks: int, rows: int) -> Callable[..., Any]:
    """Record one optimiser step of several networks as a frozen function.

    Recordings are kept for the life of the process (see ``training.frozen_step``).

    Args:
        mlp: Shape of the networks.
        settings: Loss, optimiser and batch size.
        networks: Number of networks of one launch.
        rows: Length of the table; a recording serves one length only.

    Returns:
        Function of (values, moments, table, runs, rate) that returns new values, moments and losses.
    """
    batch = settings.batch

    def step(values: Any, moments: Any, table: Any, runs: Any, rate: Any) -> tuple[Any, Any, Any]:
        first, count, start = runs
        row, weight = _batch_rows(first, count, start, batch)
        x, y, w = (take_rows(a, row, (networks, batch)) for a in table)
        values = {name: mi.TensorXf(value) for name, value in values.items()}
        dr.enable_grad(values)
        # Networks without rows read placeholder rows of weight 0.
        part = LOSSES[settings.loss](mlp(values, x), y) * w * mi.TensorXf(weight, (networks, batch, 1))
        dr.backward(dr.sum(part.array) * (1 / (batch * mlp.sizes[-1])))
        gradients = {name: dr.grad(value) for name, value in values.items()}
        values = {name: dr.detach(value) for name, value in values.items()}
        update, _ = OPTIMISERS[settings.optimiser]
        values, moments = update(values, shaped(settings, gradients, values), moments, rate)
        return values, moments, dr.block_sum(dr.detach(part).array, batch * mlp.sizes[-1]) / (batch * mlp.sizes[-1])

    return freeze(step)


def _batch_rows(first: Any, count: Any, start: Any, batch: int) -> tuple[Any, Any]:
    """Compute [E·B] row numbers in the table, and [E·B] weights: 1, or 0 for networks without rows."""
    at = dr.arange(mi.UInt32, dr.width(first) * batch)
    network, k = at // batch, at % batch
    own = dr.gather(mi.UInt32, count, network)
    place = (dr.gather(mi.UInt32, start, network) + k) % dr.maximum(own, 1)
    row = dr.select(own > 0, dr.gather(mi.UInt32, first, network) + place, 0)
    return row, dr.select(own > 0, mi.Float(1), 0)


def take_rows(table: Any, row: Any, shape: tuple[int, ...]) -> Any:
    """Gather rows of a tensor.

    Args:
        table: [N, C] tensor.
        row: UInt32 row numbers, as many as ``shape`` has elements.
        shape: Shape of the result without its last axis.

    Returns:
        [*shape, C] tensor.
    """
    width = table.shape[1]
    at = dr.arange(mi.UInt32, dr.width(row) * width)
    source = dr.gather(mi.UInt32, row, at // width) * width + at % width
    return mi.TensorXf(dr.gather(mi.Float, table.array, source), (*shape, width))


def shaped(settings: TrainingSettings, gradients: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Apply weight decay and gradient clipping, for each network separately.

    Args:
        settings: Decay and clipping norm.
        gradients: Gradients by name, [E, ...] tensors.
        values: Weights by name, [E, ...] tensors.

    Returns:
        Gradients with weight decay added, scaled down to the clipping norm, without NaN.
    """
    if settings.decay:
        gradients = {k: g + settings.decay * values[k] if k.startswith("w") else g for k, g in gradients.items()}
    if not settings.clip:
        return gradients
    sizes = {name: g.shape[1] * g.shape[2] for name, g in gradients.items()}
    norm = dr.sqrt(sum(dr.block_sum(dr.square(g.array), sizes[name]) for name, g in gradients.items()))
    # A batch with a NaN or infinite gradient must not change the weights.
    scale = dr.select(dr.isfinite(norm), dr.minimum(1.0, settings.clip / (norm + 1e-12)), 0.0)
    out = {}
    for name, g in gradients.items():
        at = dr.arange(mi.UInt32, dr.width(g.array)) // sizes[name]
        finite = dr.select(dr.isfinite(g.array), g.array, 0)
        out[name] = mi.TensorXf(finite * dr.gather(mi.Float, scale, at), g.shape)
    return out
