"""Plans: how many shards and steps a time budget buys on this machine.

A plan is measured once and stored; everything after it depends on the plan and the seed alone, so that an interrupted
and resumed bake ends with the same bytes.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TypeVar

from lightwell.core.formats import JSON
from lightwell.core.work import WorkPart

# Share of a round's seconds that goes into tracing; the rest trains. Small networks are short of samples, not of steps:
# four times the samples lower the error by a fifth, twice the steps change nothing (Cornell box). Where several fields
# share the samples, each trains as long as they took.
TRACE_SHARE, SHARED_TRACE_SHARE = 0.65, 0.5
# Share of the shards that the adaptive stage places where the error is.
ADAPTIVE_SHARE = 0.25
# Share of the steps before the adaptive stage.
FIRST_STEPS_SHARE = 0.4
# A fit on fewer shards or steps than this is not worth starting.
FEWEST_SHARDS, FEWEST_STEPS = 2, 100
# Memory bound: 128 shards of 2^16 samples with 90 features are 3 GB.
MOST_SHARDS = 128


@dataclass(frozen=True)
class SamplePlan:
    """Counts of samples."""

    shards: int
    """Area-uniform shards."""
    adaptive_shards: int
    seconds_per_shard: float = 0.0

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


def plan_samples(seconds: float, seconds_per_shard: float, fixed: int | None, shared: bool) -> SamplePlan:
    """Plan the number of shards.

    Args:
        seconds: Time budget; a share of it is for tracing.
        seconds_per_shard: Measured time of a shard.
        fixed: Number of area-uniform shards, instead of the budget; None: by the budget.
        shared: Whether several fields use the samples; then no shard is adaptive.

    Returns:
        The plan.
    """
    share = SHARED_TRACE_SHARE if shared else TRACE_SHARE
    total = min(max(int(share * seconds / max(seconds_per_shard, 1e-6)), FEWEST_SHARDS), MOST_SHARDS)
    adaptive = int(ADAPTIVE_SHARE * total)
    if fixed:
        total, adaptive = fixed + max(fixed // 4, 1), max(fixed // 4, 1)
    if shared:
        return SamplePlan(fixed or total, 0, seconds_per_shard)
    return SamplePlan(total - adaptive, adaptive, seconds_per_shard)


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


TrainingPlan = TypeVar("TrainingPlan", SamplePlan, StepPlan)
# Names of the stored plans.
_NAMES = {SamplePlan: "plan.samples", StepPlan: "plan.steps"}


def save_plan(part: WorkPart, plan: SamplePlan | StepPlan) -> None:
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
