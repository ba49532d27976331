"""The training loop: seeded batches, schedules, gradient clipping, early stopping, checkpoints that resume exactly."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from lightwell.backend import dr, freeze, mi, upload_floats
from lightwell.files import Arrays
from lightwell.networks.checkpoint import check_like
from lightwell.networks.device import tensor, tensors
from lightwell.networks.loop import Progress as Progress
from lightwell.networks.loop import TrainingSettings as TrainingSettings
from lightwell.networks.loop import TrainingState as TrainingState
from lightwell.networks.loop import learning_rate, run_steps
from lightwell.networks.losses import LOSSES
from lightwell.networks.optimisers import OPTIMISERS


@dataclass(frozen=True)
class TrainingSet:
    """N rows on the device, in random order.

    A batch is a run of neighbouring rows, because gathering scattered rows takes three times as long as reading a run.
    """

    features: Any
    """[N, F] tensor."""
    target: Any
    """[N, 3] tensor, unit S."""
    weight: Any
    """[N] float, importance weights with mean 1."""

    @staticmethod
    def from_numpy(features: np.ndarray, target: np.ndarray, weight: np.ndarray) -> TrainingSet:
        """Copy rows that are in random order to the device.

        Args:
            features: [N, F] inputs.
            target: [N, 3] targets in unit S.
            weight: [N] importance weights.

        Returns:
            The rows on the device.
        """
        return TrainingSet(tensor(features), tensor(target), upload_floats(weight))

    def __len__(self) -> int:
        return self.features.shape[0]

    @property
    def grain(self) -> int:
        """Rows that stay together in batches."""
        return 1

    def rows(self, start: Any, count: int) -> tuple[Any, Any, Any]:
        """Read a batch of neighbouring rows, cyclic.

        Args:
            start: First row; UInt32 of width 1.
            count: Number of rows B.

        Returns:
            Inputs [B, F], targets [B, 3] and weights [B, 1].
        """
        weight = mi.TensorXf(self.weight, (len(self), 1))
        return tuple(rows_from(table, start, count) for table in (self.features, self.target, weight))


def rows_from(table: Any, start: Any, count: int) -> Any:
    """Read neighbouring rows of a table, cyclic.

    Args:
        table: [N, F] tensor.
        start: First row; UInt32 of width 1.
        count: Number of rows, ≤ N.

    Returns:
        [count, F] tensor.
    """
    rows, width = table.shape
    source = dr.arange(mi.UInt32, count * width) + start * width
    end = rows * width
    source = dr.select(source < end, source, source - end)
    return mi.TensorXf(dr.gather(mi.Float, table.array, source), (count, width))


class Network(Protocol):
    """A network that can be trained; hashable, because recorded steps are kept by network."""

    def __hash__(self) -> int:
        """Hash by value."""

    def initial(self, seed: int, bias: float) -> dict[str, np.ndarray]:
        """Draw initial parameters.

        Args:
            seed: Seed of the parameters.
            bias: Initial value of the biases.

        Returns:
            Parameters by name.
        """

    def __call__(self, parameters: Mapping[str, Any], inputs: Any, /) -> Any:
        """Map the inputs of a batch, as ``TrainingData.rows`` returns them, to a tensor [B, 3]."""


N = TypeVar("N", bound=Network)


class TrainingData(Protocol):
    """Rows on the device in random order, such as ``TrainingSet``."""

    @property
    def grain(self) -> int:
        """Rows that stay together: batches start and end at multiples of it, and it divides the number of rows."""

    def rows(self, start: Any, count: int) -> tuple[Any, Any, Any]:
        """Read a batch of neighbouring rows, cyclic.

        Args:
            start: First row; UInt32 of width 1.
            count: Number of rows B.

        Returns:
            Inputs of the network, targets [B, 3] and weights [B, 1].
        """

    def __len__(self) -> int:
        """Number of rows."""


class Trainer(Generic[N]):
    """Fits a network to rows such as a ``TrainingSet``; the same seed and plan give the same weights.

    The parameters with the smallest validation error so far are kept in ``best``.
    """

    def __init__(self, network: N, settings: TrainingSettings, seed: int) -> None:
        """Prepare a training.

        Args:
            network: Network to train.
            settings: Loss, optimiser, batches and rates.
            seed: Seed of weights and batches.
        """
        self.network, self.settings, self.seed = network, settings, seed
        self.state = TrainingState()
        self.best = network.initial(seed, settings.initial_bias)
        # Weights and Adam's two moments on the device.
        self._values = tensors(self.best)
        self._moments = tuple(tensors({k: np.zeros_like(v) for k, v in self.best.items()}) for _ in range(2))
        # First rows of the current epoch's batches, and which epoch and set length they belong to.
        self._starts = np.zeros(0, np.int64)
        self._starts_key: tuple[int, int] = (-1, -1)

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Current weights as NumPy arrays."""
        return {name: np.array(value) for name, value in self._values.items()}

    def adopt(self, parameters: Mapping[str, np.ndarray], keep_moments: bool = True) -> None:
        """Continue from other weights.

        Args:
            parameters: New weights [...] by name.
            keep_moments: Keep the moments of Adam; otherwise they start at zero, and names and shapes may differ.
        """
        self._values = tensors(dict(parameters))
        if not keep_moments:
            zeros = {name: np.zeros_like(value) for name, value in parameters.items()}
            self._moments = tuple(tensors(zeros) for _ in range(2))

    # ------------------------------------------------------------------ one step

    def _batch(self, data: TrainingData) -> int:
        return max(min(self.settings.batch, len(data)) // data.grain, 1) * data.grain

    def next_start(self, data: TrainingData) -> int:
        """Choose the first row of the next batch from (seed, step, rows) alone: a resumed training repeats it.

        Args:
            data: Training set of N rows.

        Returns:
            Row in [0, N).
        """
        batch, rows = self._batch(data), len(data)
        per_epoch = max(rows // batch, 1)
        epoch, position = divmod(self.state.step, per_epoch)
        if self._starts_key != (epoch, rows):
            rng = np.random.default_rng((self.seed, epoch, rows))
            # A random phase gives every epoch different batches, although neighbouring rows stay together.
            self._starts = (rng.permutation(per_epoch) * batch + data.grain * rng.integers(rows // data.grain)) % rows
            self._starts_key = (epoch, rows)
        return int(self._starts[position])

    def step(self, data: TrainingData, total: int) -> Any:
        """Do one optimiser step.

        Args:
            data: Rows on the device.
            total: Steps of the whole schedule, ≥ 1.

        Returns:
            The loss, an array of width 1 on the device.
        """
        rate = learning_rate(self.settings, self.state.step, total, self.state.samples_seen / len(data))
        start = dr.opaque(mi.UInt32, self.next_start(data))
        self.state.step += 1
        step = frozen_step(self.network, self.settings, self._batch(data), len(data))
        rate = dr.opaque(mi.Float, rate)
        self._values, self._moments, loss = step(self._values, self._moments, data, start, rate)
        dr.eval(self._values, self._moments, loss)
        self.state.samples_seen += self._batch(data)
        return loss

    # ------------------------------------------------------------------ training loop

    def fit(
        self,
        data: TrainingData,
        error: Callable[[dict[str, np.ndarray]], float],
        until: int,
        total: int,
        progress: Progress | None = None,
        checkpoint: Callable[[], None] | None = None,
    ) -> bool:
        """Train up to a step of a schedule, or until early stopping.

        Args:
            data: Rows on the device.
            error: Computes the validation error of parameters, [...] arrays by name.
            until: Step to stop at.
            total: Steps of the whole schedule, ≥ ``until``.
            progress: Called with (state, total) after each evaluation.
            checkpoint: Called after each evaluation.

        Returns:
            Whether early stopping ended the training.
        """
        losses: list[Any] = []

        def step() -> bool:
            losses.append(self.step(data, total))
            return False

        def evaluate() -> tuple[float, float]:
            loss, parameters = float(np.mean([loss.numpy() for loss in losses])), self.parameters
            losses.clear()
            found = error(parameters)
            if found < self.state.best_error:
                self.best = parameters
            return loss, found

        return run_steps(self.state, self.settings, until, total, step, evaluate, progress, checkpoint)

    # ------------------------------------------------------------------ checkpoints

    def arrays(self) -> Arrays:
        """Return the state that a resumed training needs.

        Returns:
            Arrays [...] by name.
        """
        arrays = self.state.arrays()
        for name, value in self._values.items():
            arrays[f"value.{name}"], arrays[f"best.{name}"] = np.array(value), self.best[name]
            arrays[f"first.{name}"], arrays[f"second.{name}"] = (np.array(m[name]) for m in self._moments)
        return arrays

    def restore(self, arrays: Arrays) -> None:
        """Resume a training of the same network and settings.

        Args:
            arrays: Result of ``arrays``; see ``checkpoint.restore``.
        """
        check_like(arrays, self.arrays(), ("history",))
        self.state, names = TrainingState.of(arrays), list(self._values)
        self._values = tensors({name: arrays[f"value.{name}"] for name in names})
        self._moments = tuple(tensors({name: arrays[f"{m}.{name}"] for name in names}) for m in ("first", "second"))
        self.best = {name: arrays[f"best.{name}"] for name in names}


@functools.lru_cache(maxsize=256)
def frozen_step(
    network: Network, settings: TrainingSettings, batch: int, rows: int
) -> Callable[..., tuple[Any, Any, Any]]:
    """Record one optimiser step as a frozen function, whose kernels are launched again without being traced again.

    Recordings are kept for the life of the process, because Dr.Jit 1.5 crashes when a frozen function is
    garbage-collected while another one records.

    Args:
        network: Network to train.
        settings: Loss and optimiser.
        batch: Rows of a batch.
        rows: Length of the training set; a recording serves one length only.

    Returns:
        Function of (values, moments, data, start, rate) that returns new values, moments and the loss.
    """

    def step(values: Any, moments: Any, data: TrainingData, start: Any, rate: Any) -> tuple[Any, Any, Any]:
        x, y, w = data.rows(start, batch)
        values = {name: mi.TensorXf(value) for name, value in values.items()}
        dr.enable_grad(values)
        loss = dr.mean(LOSSES[settings.loss](network(values, x), y) * w, axis=None)
        dr.backward(loss)
        gradients = {name: dr.grad(value) for name, value in values.items()}
        values = {name: dr.detach(value) for name, value in values.items()}
        gradients = _shaped(settings, gradients, values)
        if hasattr(network, "decayed"):
            gradients = network.decayed(values, gradients)
        update, _ = OPTIMISERS[settings.optimiser]
        values, moments = update(values, gradients, moments, rate)
        return values, moments, dr.detach(loss)

    return freeze(step)


def _shaped(settings: TrainingSettings, gradients: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Gradients with weight decay added, scaled down to the clipping norm, free of NaN."""
    if settings.decay:
        gradients = {k: g + settings.decay * values[k] if k.startswith("w") else g for k, g in gradients.items()}
    if not settings.clip:
        return gradients
    norm = dr.sqrt(sum(dr.sum(dr.square(g.array)) for g in gradients.values()))
    # A batch with a NaN or infinite gradient must not change the weights.
    scale = dr.select(dr.isfinite(norm), dr.minimum(1.0, settings.clip / (norm + 1e-12)), 0.0)
    return {
        name: mi.TensorXf(dr.select(dr.isfinite(g.array), g.array, 0) * scale, g.shape) for name, g in gradients.items()
    }
