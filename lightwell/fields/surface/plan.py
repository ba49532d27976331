"""Plans: how many shards and steps a time budget buys on this machine.

A plan is measured once and stored before the work that it plans; everything after it depends on the plan and the seed
alone, so that an interrupted and resumed bake ends with the same bytes. Each plan is made when its stage starts, from
the time that is left then.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from time import perf_counter
from typing import TypeVar

import numpy as np

from lightwell.core.formats import JSON
from lightwell.core.work import WorkPart

# Share of the time left that the shared samples of several fields are traced in; each then trains as long as they took.
SHARED_TRACE_SHARE = 0.5
# Share of a role's time for what is traced before the first gathered shard, and of what is left then for shards: more
# of them are worth more than steps (drake-living-room, dB: 12 shards and 4,300 steps 30.2, 17 and 3,000 31.5, 22 and
# 1,650 31.9, 32 and 3,000 32.4, 32 and 6,000 32.5), as long as there are 1,500 steps.
GATHER_SHARE, TRACE_SHARE = 0.4, 0.7
# Most of that time that more paths of a sample may take: steps are worth more than these (bevy-cornell, 32 shards, dB:
# 64 paths and 3,000 steps 35.9, 128 paths and 1,500 steps 34.9).
PATHS_SHARE = 0.5
# Share of the shards' time, and most of their number, that the adaptive stage places where the error is.
ADAPTIVE_SHARE = 0.25
# Rays of a point whose light is gathered, by quality.
RAYS = {"draft": 64, "good": 128, "best": 256}
# What is traced before the first gathered shard costs as much as so many paths per ray, all else included (four scenes,
# 2 cores, 128 rays: 20 s for 2^18 points where 0.4 M paths are traced in a second). Fewer points have fewer bins,
# which are too bright in dim rooms.
PATHS_PER_RAY = 0.25
# Points of a gathered shard that are its own, and bounds of the points in shards of them.
FEWEST_GATHERED, MOST_GATHERED = 1, 16
# Share of a role's time that it trains at least, however long its samples took: a field of 200 steps is of no use
# (pyraxia-hallway on a slow machine), and a bake may take a little longer.
LEAST_TRAINING_SHARE = 0.1
# Share of the steps before the adaptive stage.
FIRST_STEPS_SHARE = 0.4
# A fit on fewer shards or steps than this is not worth starting.
FEWEST_SHARDS, FEWEST_STEPS = 2, 100
# Shards that are traced to time one: after the first, which also pays for what is traced before it, the faster of two,
# so that a pause of the machine does not count.
TIMED_SHARDS = 3
# Steps that compile kernels, then steps of short and long runs that are timed, and pairs of them.
WARM_UP_STEPS, TIMED_RUNS, TIMED_PAIRS = 5, (5, 25), 3
# Length of the schedule that they belong to: long, so that they hold no change of levels or rounds.
NOMINAL_STEPS = 1 << 16
# More shards than these hold little that is new (24 to 72: +0.1 dB at equal steps), and the time in which they are
# taken up is worth more steps; with 90 features 64 of them are 1.5 GB.
MOST_SHARDS = 32
# Where so many shards take less than their time, samples have up to so many times the paths.
MOST_TIMES = 8
# Most of the time left after the first steps that adaptive shards may take.
LAST_TRACE_SHARE = 0.5


@dataclass(frozen=True)
class StartPlan:
    """What is known before the first sample of a role."""

    end: float
    """Wall seconds of the bake at which the role should be learned."""
    paths_per_second: float
    """Measured rate of path-traced samples in short launches."""
    gathered: int
    """Shards that the gather before the first one is made for."""
    sustained: float
    """The same in long launches, such as those of the reference."""
    pose_seconds: float = 0.0
    """Measured time of a pose; 0: nothing moves, or counts are fixed."""
    times: int = 1
    """As many times the points of each pose as there are else."""


@dataclass(frozen=True)
class SamplePlan:
    """Counts of samples."""

    shards: int
    """Shards before the adaptive stage."""
    adaptive_shards: int
    seconds_per_shard: float = 0.0
    seconds_per_adaptive: float = 0.0
    times: int = 1
    """As many times the paths of a sample as it is asked to have."""

    def within(self, most: int | None) -> SamplePlan:
        """Return the plan with at most so many shards, of which none is adaptive where the limit is reached.

        Args:
            most: Shards that hold all that there is; None: no limit.

        Returns:
            The plan.
        """
        if most is None or self.shards + self.adaptive_shards < most:
            return self
        return replace(self, shards=max(most, FEWEST_SHARDS), adaptive_shards=0)

    def extended(self) -> SamplePlan:
        """Return the plan of the next round: half as many shards again, all of them adaptive.

        Returns:
            The plan.
        """
        more = min(max(self.shards // 2, 1), max(MOST_SHARDS - self.shards - self.adaptive_shards, 0))
        return replace(self, adaptive_shards=self.adaptive_shards + more)


@dataclass(frozen=True)
class StepPlan:
    """Counts of training steps."""

    first_steps: int
    """Steps before the adaptive stage."""
    steps: int
    """Steps in all."""
    seconds_per_step: float = 0.0

    def extended(self) -> StepPlan:
        """Return the plan of the next round: as many steps again.

        Returns:
            The plan.
        """
        return replace(self, steps=self.steps + 2 * max(self.steps - self.first_steps, FEWEST_STEPS))


@dataclass(frozen=True)
class LastPlan:
    """Counts of the adaptive stage and of the steps after it, planned when it starts."""

    adaptive_shards: int
    steps: int
    """Steps in all."""


def plan_gather(seconds: float, paths_per_second: float, points_per_shard: int, rays: int) -> int:
    """Plan how much is traced before the first gathered shard.

    Args:
        seconds: Time of the role.
        paths_per_second: Measured rate of path-traced samples.
        points_per_shard: Points of a shard that are its own.
        rays: Rays of a point.

    Returns:
        Shards that the gather is made for: the nearest power of two.
    """
    points = GATHER_SHARE * seconds * paths_per_second / (PATHS_PER_RAY * rays)
    shards = min(max(points / points_per_shard, FEWEST_GATHERED), MOST_GATHERED)
    return 1 << round(math.log2(shards))


def plan_samples(
    seconds: float, seconds_per_shard: float, seconds_per_adaptive: float, fixed: int | None, shared: bool
) -> SamplePlan:
    """Plan the number of shards.

    Args:
        seconds: Time left for tracing and training.
        seconds_per_shard: Measured time of a shard.
        seconds_per_adaptive: Measured time of an adaptive shard.
        fixed: Number of shards before the adaptive stage, instead of the time; None: by the time.
        shared: Whether several fields use the samples; then no shard is adaptive.

    Returns:
        The plan.
    """
    costs = {"seconds_per_shard": seconds_per_shard, "seconds_per_adaptive": seconds_per_adaptive}
    if fixed:
        return SamplePlan(fixed, 0 if shared else max(fixed // 4, 1), **costs)
    tracing = (SHARED_TRACE_SHARE if shared else TRACE_SHARE) * max(seconds, 0)
    share = 0.0 if shared else ADAPTIVE_SHARE
    adaptive = min(int(share * tracing / max(seconds_per_adaptive, 1e-6)), int(share * MOST_SHARDS))
    shards = int((tracing - adaptive * seconds_per_adaptive) / max(seconds_per_shard, 1e-6))
    shards = min(max(shards, FEWEST_SHARDS), MOST_SHARDS - adaptive)
    # Few shards do not deserve an adaptive stage of their own size.
    return SamplePlan(shards, min(adaptive, shards), **costs)


def plan_paths(seconds: float, seconds_per_shard: float) -> int:
    """Plan the paths of a sample where the time buys more shards than hold something new.

    Args:
        seconds: Time left for tracing and training.
        seconds_per_shard: Measured time of a shard whose samples have as many paths as they are asked to have.

    Returns:
        How many times as many they get.
    """
    affordable = PATHS_SHARE * seconds / max(MOST_SHARDS * seconds_per_shard, 1e-6)
    return int(np.clip(affordable, 1, MOST_TIMES))


def timed_step(
    train: Callable[[int, int], bool], evaluate_every: int, clock: Callable[[], float] = perf_counter
) -> float:
    """Measure the time of a training step, with its share of the evaluations.

    A call ends with an evaluation, which takes as long as many steps: short and long runs tell them apart. Medians,
    because a pause of the machine is as long as many steps, too.

    Args:
        train: Trains until so many steps are done in all, of a schedule of so many, and evaluates; returns whether it
            has ended before.
        evaluate_every: Steps for each evaluation of the training that is planned.
        clock: Returns the time, seconds.

    Returns:
        Seconds; infinity where it ended.
    """
    if train(WARM_UP_STEPS, NOMINAL_STEPS):
        return math.inf
    done, seconds = WARM_UP_STEPS, []
    for run in TIMED_RUNS * TIMED_PAIRS:
        start, done = clock(), done + run
        train(done, NOMINAL_STEPS)
        seconds.append(clock() - start)
    short, long = np.median(np.reshape(seconds, (TIMED_PAIRS, 2)), axis=0)
    step = max(long - short, 0.0) / (TIMED_RUNS[1] - TIMED_RUNS[0])
    return float(step + max(short - TIMED_RUNS[0] * step, 0.0) / evaluate_every)


def training_seconds(left: float, role: float) -> float:
    """Compute how long a role trains.

    Args:
        left: Seconds that its samples leave; negative where they took too long.
        role: Seconds of the role, samples included.

    Returns:
        Seconds, > 0.
    """
    return max(left, LEAST_TRAINING_SHARE * role)


def plan_steps(seconds: float, seconds_per_step: float, fixed: int | None) -> StepPlan:
    """Plan the number of training steps.

    Args:
        seconds: Time budget of the training.
        seconds_per_step: Measured time of a step.
        fixed: Number of steps, instead of the budget; None: by the budget.

    Returns:
        The plan.
    """
    steps = fixed or max(int(seconds / max(seconds_per_step, 1e-6)), FEWEST_STEPS)
    return StepPlan(max(int(FIRST_STEPS_SHARE * steps), 1), steps, seconds_per_step)


def plan_last(seconds: float, samples: SamplePlan, step: int, seconds_per_step: float, preparing: float) -> LastPlan:
    """Plan the adaptive stage and the steps after it, from the time that is left when it starts.

    Args:
        seconds: Time left.
        samples: Plan of the samples.
        step: Steps that were done.
        seconds_per_step: Measured time of a step.
        preparing: Seconds in which the learner takes up all samples.

    Returns:
        At most the planned shards, and at least ``FEWEST_STEPS`` further steps.
    """
    cost = max(samples.seconds_per_adaptive, 1e-6)
    adaptive = min(max(int(LAST_TRACE_SHARE * (seconds - preparing) / cost), 0), samples.adaptive_shards)
    left = seconds - adaptive * cost - (preparing if adaptive else 0)
    further = int(left / max(seconds_per_step, 1e-6))
    return LastPlan(adaptive, step + max(further, FEWEST_STEPS))


TrainingPlan = TypeVar("TrainingPlan", StartPlan, SamplePlan, StepPlan, LastPlan)
# Names of the stored plans.
_NAMES = {StartPlan: "plan.start", SamplePlan: "plan.samples", StepPlan: "plan.steps", LastPlan: "plan.last"}


def kept_plan(part: WorkPart, kind: type[TrainingPlan], make: Callable[[], TrainingPlan]) -> TrainingPlan:
    """Read a stored plan, or make and store it.

    Args:
        part: Part of the bake that it belongs to.
        kind: Class of the plan.
        make: Makes the plan.

    Returns:
        The plan.
    """
    plan = load_plan(part, kind)
    if plan is None:
        plan = make()
        save_plan(part, plan)
    return plan


def save_plan(part: WorkPart, plan: StartPlan | SamplePlan | StepPlan | LastPlan) -> None:
    """Store a plan in place of the present one.

    Args:
        part: Part of the bake that it belongs to.
        plan: The plan.
    """
    part.put(_NAMES[type(plan)], asdict(plan), JSON)


def load_plan(part: WorkPart, kind: type[TrainingPlan]) -> TrainingPlan | None:
    """Read the stored plan.

    Args:
        part: Part of the bake that it belongs to.
        kind: Class of the plan.

    Returns:
        The plan; None where there is none or it is damaged, which the log notes.
    """
    found = part.find(_NAMES[kind], JSON)
    return None if found is None else kind(**found)
