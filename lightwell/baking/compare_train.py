"""Training one field of a comparison: on shared samples, for as long as every other field."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from lightwell.baking.compare_samples import SharedSamples
from lightwell.baking.compare_settings import CompareSettings, FieldChoice
from lightwell.baking.plan import FEWEST_STEPS
from lightwell.baking.progress import Progress, Stage
from lightwell.baking.work import write_json
from lightwell.fields import Fit, starter
from lightwell.networks.training import TrainingState

# Steps that are timed to make a plan; the first ones compile kernels.
WARM_UP_STEPS, TIMED_STEPS = 5, 15
# Length of the schedule that the timed steps belong to: long, so that they hold no change of levels or rounds.
NOMINAL_STEPS = 1 << 16
# A plan that turns out too long is cut off after this many times the budget, at one of this many places.
PATIENCE, PLACES = 1.25, 40


@dataclass(frozen=True)
class Trained:
    """A field whose training has ended."""

    fit: Fit
    seconds: float
    """Wall time of preparing the samples for the field and of training it."""
    steps: int
    curve: list[tuple[float, float]]
    """(seconds, validation error) of every look at the validation samples."""
    cut: bool
    """Whether the time ran out before the planned steps."""


class Clock:
    """Seconds of training at each step, over all runs; on disk beside the checkpoint where it has a path."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        known = path is not None and path.exists()
        stored = json.loads(path.read_text()) if known else [(0, 0.0)]
        self.marks: list[tuple[int, float]] = [(step, seconds) for step, seconds in stored]
        self._start = perf_counter() - self.marks[-1][1]

    @property
    def seconds(self) -> float:
        """Up to now."""
        return perf_counter() - self._start

    def mark(self, step: int) -> None:
        """Note the time of a step."""
        self.marks.append((step, round(self.seconds, 4)))

    def save(self) -> None:
        """Write the marks."""
        if self._path:
            write_json(self._path, self.marks)

    def at(self, step: float) -> float:
        """Seconds at a step, between its neighbours on a straight line."""
        before = max((mark for mark in self.marks if mark[0] <= step), default=self.marks[0])
        after = min((mark for mark in self.marks if mark[0] >= step), default=self.marks[-1])
        span = after[0] - before[0]
        return before[1] if span <= 0 else before[1] + (after[1] - before[1]) * (step - before[0]) / span


def train_field(
    choice: FieldChoice,
    shared: SharedSamples,
    settings: CompareSettings,
    seconds: float,
    folder: Path,
    progress: Progress,
) -> Trained:
    """Train ``choice`` for about ``seconds``, or for ``settings.steps``; goes on from the checkpoint in ``folder``."""
    plan = folder / "plan.json"
    if not settings.steps and not plan.exists():
        timed = _timed(choice, shared, settings)
        if timed.ended:
            return Trained(timed.fit, timed.seconds, timed.fit.state.step, _curve(timed.fit, timed.clock), False)
        write_json(plan, {"steps": max(int(seconds / timed.seconds_per_step), FEWEST_STEPS)})
    steps = settings.steps or json.loads(plan.read_text())["steps"]
    checkpoint, clock_path = folder / "fit.npz", folder / "clock.json"
    if not checkpoint.exists():
        clock_path.unlink(missing_ok=True)
    clock = Clock(clock_path)
    fit = _start(choice, shared, settings)
    if checkpoint.exists():
        fit.load(checkpoint)
    deadline = None if settings.steps else PATIENCE * seconds
    with progress.stage(f"train {choice.name}", steps, "steps") as stage:
        cut = _train(fit, steps, deadline, clock, checkpoint, stage)
    return Trained(fit, clock.seconds, fit.state.step, _curve(fit, clock), cut)


def _curve(fit: Fit, clock: Clock) -> list[tuple[float, float]]:
    return [(clock.at(step), error) for step, _, error in fit.state.history]


def _start(choice: FieldChoice, shared: SharedSamples, settings: CompareSettings) -> Fit:
    fit = starter(choice.field, choice.preset)(shared.setup, settings.seed)
    fit.learn_from(shared.training)
    fit.validate_on(shared.validation)
    return fit


def _train(fit: Fit, steps: int, deadline: float | None, clock: Clock, checkpoint: Path, stage: Stage) -> bool:
    """Train to ``steps``, to the fit's own end, or to the deadline; returns whether the deadline ended it."""

    def look(state: TrainingState, _: int) -> None:
        clock.mark(state.step)
        stage.move_to(state.step, f"error {state.best_error:.1%}")

    def save() -> None:
        fit.save(checkpoint)
        clock.save()

    place = max(-(-steps // PLACES), 1) if deadline else steps
    while fit.state.step < steps:
        if deadline and clock.seconds > deadline:
            return True
        before = fit.state.step
        stopped = fit.train(min((before // place + 1) * place, steps), steps, look, save)
        save()
        if stopped or fit.state.step == before:
            return False
    return False


@dataclass(frozen=True)
class _Timed:
    """A scratch fit after a few steps."""

    fit: Fit
    clock: Clock
    seconds: float
    """From its start on."""
    seconds_per_step: float
    """Compilation excluded."""
    ended: bool
    """Whether it ended before it could be timed: it learns in one go and is no scratch fit at all."""


def _timed(choice: FieldChoice, shared: SharedSamples, settings: CompareSettings) -> _Timed:
    """Take a few steps, to find out what the time buys."""
    clock = Clock(None)
    fit = _start(choice, shared, settings)
    ended = fit.train(WARM_UP_STEPS, NOMINAL_STEPS, lambda state, _: clock.mark(state.step))
    start = clock.seconds
    if not ended:
        fit.train(WARM_UP_STEPS + TIMED_STEPS, NOMINAL_STEPS)
    cost = max((clock.seconds - start) / TIMED_STEPS, 1e-6)
    return _Timed(fit, clock, clock.seconds, cost, ended)
