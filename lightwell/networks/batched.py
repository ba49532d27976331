"""Many networks of one shape, trained at once: thousands of leaves or experts are one launch, never a Python loop.

Notation: E networks, B rows of a batch per network, F features. Parameters are those of ``Mlp`` with one more axis in
front: ``w0 [E, in, out], b0 [E, 1, out], …``. The networks share nothing but the launch: each has its own rows,
batches, rate, gradient clipping and best weights, so that E of them end as E trained alone.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, freeze, mi
from lightwell.networks.checkpoint import Arrays, check_like, prefixed, under
from lightwell.networks.device import integers, tensor, tensors
from lightwell.networks.grouped import Runs
from lightwell.networks.losses import LOSSES
from lightwell.networks.mlp import Mlp
from lightwell.networks.optimisers import OPTIMISERS
from lightwell.networks.schedules import SCHEDULES
from lightwell.networks.training import TrainingSettings

# Memory that one launch may take, bytes: more networks are trained in several launches per step.
MEMORY = 2 << 30
# Arrays of the size of a layer's output that forward and backward pass keep, by measurement.
COPIES = 6
# Up to this many networks are launched as they are; more are padded so that few sizes have to be compiled.
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
        """Copy rows that ``sort_into_runs`` has ordered to the device, once."""
        mean = np.nan_to_num(runs.mean(weight), nan=1.0)
        scaled = weight / np.maximum(mean, 1e-30)[runs.group]
        return BatchedSet(tensor(features), tensor(target), tensor(scaled[:, None]), runs)


def initial_batch(mlp: Mlp, seeds: Sequence[int], bias: float = 0.0) -> dict[str, np.ndarray]:
    """Initial weights of one network per seed, stacked: the same as ``mlp.initial`` of each."""
    each = [mlp.initial(int(seed), bias) for seed in seeds]
    return {name: np.stack([weights[name] for weights in each]) for name in each[0]}


def _phase(seed: np.ndarray, epoch: np.ndarray) -> np.ndarray:
    """Random 63-bit numbers from (seed, epoch) without state (SplitMix64, Steele et al. 2014). [E] → [E]."""
    with np.errstate(over="ignore"):
        z = (seed.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
        z += (epoch.astype(np.uint64) + np.uint64(1)) * np.uint64(0xD1B54A32D192ED03)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((z ^ (z >> np.uint64(31))) >> np.uint64(1)).astype(np.int64)


class BatchedTrainer:
    """Trains E networks of the shape ``mlp``; ``seeds`` [E] decide initial weights and batches of each.

    A batch of network e is a run of ``settings.batch`` rows of its own, round the end; a network without rows stays as
    it is. ``best`` keeps, for each network apart, the weights with the least error given to ``look``.
    """

    def __init__(
        self,
        mlp: Mlp,
        settings: TrainingSettings,
        seeds: Sequence[int],
        initial: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """initial: weights to start from instead of random ones, [E, …] arrays."""
        self.mlp, self.settings = mlp, settings
        self.seeds = np.asarray(seeds, np.int64)
        self.steps = 0
        start = initial_batch(mlp, self.seeds, settings.initial_bias) if initial is None else initial
        self.best = {name: np.array(value, np.float32) for name, value in start.items()}
        self.best_error = np.full(len(self), np.inf)
        # Networks per launch, and the first network of each launch.
        self._size = min(_padded(len(self)), self._most_at_once())
        self._begins = range(0, len(self), self._size)
        zeros = {name: np.zeros_like(value) for name, value in self.best.items()}
        self._values = [self._upload(self.best, begin) for begin in self._begins]
        self._moments = [tuple(self._upload(zeros, begin) for _ in range(2)) for begin in self._begins]

    def __len__(self) -> int:
        return len(self.seeds)

    def _most_at_once(self) -> int:
        """How many networks fit into ``MEMORY``."""
        per_row = COPIES * sum(self.mlp.sizes) * 4
        return max(MEMORY // (per_row * self.settings.batch), 1)

    def _upload(self, arrays: Mapping[str, np.ndarray], begin: int) -> dict[str, Any]:
        """The networks of one launch as tensors, padded with zeros."""
        return tensors({name: self._slice(value, begin) for name, value in arrays.items()})

    def _slice(self, values: np.ndarray, begin: int) -> np.ndarray:
        part = values[begin : begin + self._size]
        return np.concatenate([part, np.zeros((self._size - len(part), *part.shape[1:]), part.dtype)])

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Current weights, [E, …] arrays."""
        return self._download(self._values)

    def _download(self, chunks: list[dict[str, Any]]) -> dict[str, np.ndarray]:
        return {name: np.concatenate([np.array(c[name]) for c in chunks])[: len(self)] for name in chunks[0]}

    # ------------------------------------------------------------------ one step

    def _starts(self, count: np.ndarray) -> np.ndarray:
        """[E] place of the next batch within each run; depends on (seed, step, count) alone.

        An epoch runs through its rows, which are in random order, from a random phase on.
        """
        batches = np.maximum(count // self.settings.batch, 1)
        epoch, position = np.divmod(self.steps, batches)
        return (_phase(self.seeds, epoch) + position * self.settings.batch) % np.maximum(count, 1)

    def _rates(self, count: np.ndarray, total: int) -> np.ndarray:
        """[E] learning rate of each network: an epoch is one pass through *its* rows."""
        settings = self.settings
        epoch = self.steps * settings.batch / np.maximum(count, 1)
        rate = SCHEDULES[settings.schedule](settings.rate, self.steps / max(total, 1), epoch, settings.tau)
        _, corrected = OPTIMISERS[settings.optimiser]
        return corrected(np.broadcast_to(rate, count.shape), self.steps + 1)

    def step(self, data: BatchedSet, total: int) -> list[Any]:
        """One optimiser step of ``total`` for all networks; returns their losses, left on the device."""
        count = data.runs.count
        starts, rates = self._starts(count), self._rates(count, total)
        table = (data.features, data.target, data.weight)
        step = recorded_step(self.mlp, self.settings, self._size, data.features.shape[0])
        losses = []
        for k, begin in enumerate(self._begins):
            runs = tuple(integers(self._slice(a, begin)) for a in (data.runs.first, count, starts))
            rate = tensor(self._slice(rates, begin)[:, None, None])
            self._values[k], self._moments[k], loss = step(self._values[k], self._moments[k], table, runs, rate)
            dr.eval(self._values[k], self._moments[k], loss)
            losses.append(loss)
        self.steps += 1
        return losses

    def losses(self, device: list[Any]) -> np.ndarray:
        """[E] losses of a step as NumPy."""
        return np.concatenate([np.array(loss) for loss in device])[: len(self)]

    def look(self, error: np.ndarray) -> np.ndarray:
        """Keep the weights of the networks whose error [E] is the least yet; returns which they are."""
        return keep_better(self.best, self.best_error, self.parameters, error)

    # ------------------------------------------------------------------ checkpoints

    def arrays(self) -> Arrays:
        """Everything that a resumed training needs."""
        arrays = {"steps": np.array(self.steps, np.int64), "seeds": self.seeds, "best_error": self.best_error}
        arrays |= prefixed("value", self.parameters) | prefixed("best", self.best)
        for k, name in enumerate(("first", "second")):
            arrays |= prefixed(name, self._download([moments[k] for moments in self._moments]))
        return arrays

    def restore(self, arrays: Arrays) -> None:
        """Take up what ``arrays`` gave; the shape and the number of networks must be the same."""
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
    """Replace the best weights and errors [E] of the networks whose error is less, in place; returns which they are."""
    better = np.asarray(error) < best_error
    for name, value in parameters.items():
        best[name][better] = value[better]
    best_error[better] = np.asarray(error)[better]
    return better


def _padded(count: int) -> int:
    """The least of 16, 20, 24, 28, 32, 40, 48, … that is not below ``count``; small counts as they are."""
    if count <= EXACT:
        return count
    step = 1 << (max((count - 1).bit_length() - 3, 0))
    return -(-count // step) * step


@functools.lru_cache(maxsize=256)
def recorded_step(mlp: Mlp, settings: TrainingSettings, networks: int, rows: int) -> Callable[..., Any]:
    """One optimiser step of ``networks`` networks as a frozen function (see ``training.frozen_step``, why it is kept).

    ``rows``, the length of the table, is part of the key, because a recording serves one length only.
    """
    batch = settings.batch

    def step(values: Any, moments: Any, table: Any, runs: Any, rate: Any) -> tuple[Any, Any, Any]:
        row, weight = _batch_rows(*runs, batch)
        x, y, w = (take_rows(a, row, (networks, batch)) for a in table)
        values = {name: mi.TensorXf(value) for name, value in values.items()}
        dr.enable_grad(values)
        # Rows of networks that have none weigh nothing.
        part = LOSSES[settings.loss](mlp(values, x), y) * w * mi.TensorXf(weight, (networks, batch, 1))
        dr.backward(dr.sum(part.array) * (1 / (batch * mlp.sizes[-1])))
        gradients = {name: dr.grad(value) for name, value in values.items()}
        values = {name: dr.detach(value) for name, value in values.items()}
        update, _ = OPTIMISERS[settings.optimiser]
        values, moments = update(values, shaped(settings, gradients, values), moments, rate)
        return values, moments, dr.block_sum(dr.detach(part).array, batch * mlp.sizes[-1]) / (batch * mlp.sizes[-1])

    return freeze(step)


def _batch_rows(first: Any, count: Any, start: Any, batch: int) -> tuple[Any, Any]:
    """([E·B] row numbers in the table, [E·B] 1 or, for networks without rows, 0)."""
    at = dr.arange(mi.UInt32, dr.width(first) * batch)
    network, k = at // batch, at % batch
    own = dr.gather(mi.UInt32, count, network)
    place = (dr.gather(mi.UInt32, start, network) + k) % dr.maximum(own, 1)
    row = dr.select(own > 0, dr.gather(mi.UInt32, first, network) + place, 0)
    return row, dr.select(own > 0, mi.Float(1), 0)


def take_rows(table: Any, row: Any, shape: tuple[int, ...]) -> Any:
    """Rows of a tensor [N, C] as a tensor [*shape, C]; row: UInt32 of prod(shape)."""
    width = table.shape[1]
    at = dr.arange(mi.UInt32, dr.width(row) * width)
    source = dr.gather(mi.UInt32, row, at // width) * width + at % width
    return mi.TensorXf(dr.gather(mi.Float, table.array, source), (*shape, width))


def shaped(settings: TrainingSettings, gradients: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Gradients with weight decay added, each network's scaled down to the clipping norm and free of NaN."""
    if settings.decay:
        gradients = {k: g + settings.decay * values[k] if k.startswith("w") else g for k, g in gradients.items()}
    if not settings.clip:
        return gradients
    sizes = {name: g.shape[1] * g.shape[2] for name, g in gradients.items()}
    norm = dr.sqrt(sum(dr.block_sum(dr.square(g.array), sizes[name]) for name, g in gradients.items()))
    # A poisoned batch (NaN or infinite gradient) must not reach the weights.
    scale = dr.select(dr.isfinite(norm), dr.minimum(1.0, settings.clip / (norm + 1e-12)), 0.0)
    out = {}
    for name, g in gradients.items():
        at = dr.arange(mi.UInt32, dr.width(g.array)) // sizes[name]
        finite = dr.select(dr.isfinite(g.array), g.array, 0)
        out[name] = mi.TensorXf(finite * dr.gather(mi.Float, scale, at), g.shape)
    return out
