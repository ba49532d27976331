"""The training loop that all fits share: steps, evaluations, early stopping."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lightwell.files import Arrays
from lightwell.networks.optimisers import OPTIMISERS
from lightwell.networks.schedules import REPORT_TAU, SCHEDULES


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of a training."""

    loss: str = "relative2"
    optimiser: str = "adam"
    """'adam', 'adam_grid' (constants for hash grids) or 'sgd'."""
    rate: float = 3e-3
    schedule: str = "cosine"
    tau: float = REPORT_TAU
    """Epochs after which the schedule 'report' has halved the rate."""
    batch: int = 1 << 12
    decay: float = 0.0
    """L2 weight decay, added to the gradient of the weights (not of the biases)."""
    clip: float = 1.0
    """Largest Euclidean norm of the whole gradient; 0 turns clipping off."""
    evaluate_every: int = 200
    """Steps between two evaluations on the validation set."""
    patience: int = 10
    """Evaluations without improvement after which the training stops, at least a fifth of the schedule; 0 never stops.

    While the rate is high, longer times without improvement are normal."""
    initial_bias: float = 0.0


def learning_rate(settings: TrainingSettings, step: int, total: int, epoch: Any) -> Any:
    """Compute the learning rate of a step, with the bias correction of the optimiser.

    Args:
        settings: Rate, schedule and optimiser.
        step: Steps done.
        total: Steps of the whole schedule.
        epoch: Passes through the samples so far; a number or [E].

    Returns:
        The rate, a number; [E] where the schedule depends on an epoch that is an array.
    """
    rate = SCHEDULES[settings.schedule](settings.rate, step / max(total, 1), epoch, settings.tau)
    return OPTIMISERS[settings.optimiser][1](rate, step + 1)


# The 2013 report on mixtures of experts: relative L1, μ = 0.5 · 50 / (50 + epoch), decay 1e-4, biases 0.25. It gives no
# batch size.
REPORT_TRAINING = TrainingSettings(
    loss="relative",
    optimiser="sgd",
    rate=0.5,
    schedule="report",
    batch=128,
    decay=1e-4,
    initial_bias=0.25,
    evaluate_every=200,
)


@dataclass
class TrainingState:
    """The state that a resumed training needs besides the optimiser's arrays."""

    step: int = 0
    samples_seen: int = 0
    best_error: float = float("inf")
    best_step: int = 0
    history: list[tuple[int, float, float]] = field(default_factory=list)
    """(step, training loss since the last entry, validation error)."""
    stopped: int = 0
    """Step that was trained to when early stopping ended the training at the last entry; 0: it did not."""

    def arrays(self) -> Arrays:
        """Return the arrays of a checkpoint.

        Returns:
            Arrays by name: ``step`` [3], ``best_error`` scalar, ``history`` [K, 3]; after early stopping ``stopped``,
            scalar.
        """
        found = {
            "step": np.array([self.step, self.samples_seen, self.best_step], np.int64),
            "best_error": np.array(self.best_error),
            "history": np.array(self.history, np.float64).reshape(-1, 3),
        }
        return found | ({"stopped": np.array(self.stopped, np.int64)} if self.stopped else {})

    @staticmethod
    def of(arrays: Mapping[str, np.ndarray]) -> TrainingState:
        """Restore the state from the arrays of a checkpoint.

        Args:
            arrays: Arrays by name: ``step`` [3], ``best_error`` scalar, ``history`` [K, 3], and ``stopped`` scalar or
                missing. Another missing name is a ``KeyError``.

        Returns:
            The state.

        Raises:
            ValueError: An array has the wrong shape or holds impossible values.
        """
        steps, history, stopped = arrays["step"], arrays["history"], arrays.get("stopped", np.array(0))
        if stopped.shape != () or stopped.dtype.kind not in "iu" or stopped < 0:
            raise ValueError("'stopped' is not a count")
        if steps.shape != (3,) or steps.dtype.kind not in "iu" or (steps < 0).any():
            raise ValueError("'step' is not three counts")
        if history.ndim != 2 or history.shape[1] != 3 or not np.isfinite(history).all():
            raise ValueError("'history' is not rows of step, loss and error")
        step, seen, best_step = (int(v) for v in steps)
        best = float(arrays["best_error"])
        # Infinity before the first evaluation; afterwards an error.
        if not best >= 0 or (best_step and not math.isfinite(best)):
            raise ValueError(f"'best_error' is {best}, the best step {best_step}")
        rows = [(int(s), float(a), float(b)) for s, a, b in history]
        return TrainingState(step, seen, best, best_step, rows, int(stopped))


Progress = Callable[[TrainingState, int], None]


def run_steps(
    state: TrainingState,
    settings: TrainingSettings,
    until: int,
    total: int,
    step: Callable[[], bool],
    evaluate: Callable[[], tuple[float, float]],
    progress: Progress | None = None,
    checkpoint: Callable[[], None] | None = None,
) -> bool:
    """Train up to a step of a schedule, until nothing is left to do, or until early stopping.

    Args:
        state: State of the training; changed.
        settings: Intervals and patience.
        until: Step to stop at.
        total: Steps of the whole schedule, ≥ ``until``.
        step: Does one step; returns whether nothing is left to do.
        evaluate: Returns the training loss since the last evaluation and the validation error; it keeps the weights
            of an error below ``state.best_error``.
        progress: Called with (state, total) after each evaluation.
        checkpoint: Called after each evaluation.

    Returns:
        Whether the training ended before ``until``.

    Raises:
        RuntimeError: Loss or error is not finite.
    """
    if state.stopped and until <= state.stopped:
        return True  # It was resumed after early stopping had ended it.
    state.stopped = 0
    while state.step < until:
        before = state.step
        finished = step()
        if finished and state.history and state.history[-1][0] == before:
            return True  # Nothing has happened since the last evaluation: it was resumed after its end.
        state.step = before + 1
        if not finished and state.step % settings.evaluate_every and state.step != until:
            continue
        loss, error = evaluate()
        if not (np.isfinite(loss) and np.isfinite(error)):
            raise RuntimeError(
                f"train: loss {loss} and error {error} at step {state.step} are not finite; "
                f"lower the learning rate (now {settings.rate}) or look for broken targets"
            )
        state.history.append((state.step, loss, error))
        if error < state.best_error:
            state.best_error, state.best_step = error, state.step
        enough = max(settings.patience * settings.evaluate_every, total // 5)
        if settings.patience and state.step - state.best_step >= enough:
            state.stopped = until
        if progress:
            progress(state, total)
        if checkpoint:
            checkpoint()
        if finished or state.stopped:
            return True
    return False
