"""The training of a surface field: trace, train, trace where the error is large, continue training."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from time import perf_counter
from typing import Any, TypeAlias

from lightwell.core.formats import ARRAYS
from lightwell.core.progress import ProgressStage
from lightwell.core.work import WorkPart
from lightwell.fields.base import FieldSetup, Learner, around_samples, radiance_unit, to_learn
from lightwell.fields.protocol import GoodEnough, Role, State, Traced, Training
from lightwell.fields.surface.clock import Clock
from lightwell.fields.surface.plan import (
    FIRST_STEPS_SHARE,
    RAYS,
    SHARED_TRACE_SHARE,
    TIMED_SHARDS,
    LastPlan,
    SamplePlan,
    StartPlan,
    StepPlan,
    kept_plan,
    load_plan,
    plan_gather,
    plan_last,
    plan_paths,
    plan_samples,
    plan_steps,
    save_plan,
    timed_step,
    training_seconds,
)
from lightwell.fields.surface.poses import (
    gather_in_time,
    posed_maker,
    posed_validation,
    seconds_for_others,
    timed_pose,
    times_in_time,
)
from lightwell.fields.surface.roles import learning_time, looked_from, role_seconds
from lightwell.fields.surface.tracing import TracedShards, path_rate, trace_shards, validation_samples
from lightwell.networks.checkpoint import restore
from lightwell.networks.loop import Progress, TrainingState
from lightwell.scenes.variables import Turning
from lightwell.transport import Samples
from lightwell.transport.collect import join
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.own_light_shards import OwnLightShards
from lightwell.transport.posed_shards import PosedShards
from lightwell.transport.seen_shards import POINTS_PER_SHARD, GatherSize
from lightwell.transport.shards import Make, ShardSettings
from lightwell.transport.turned_light import TurnedShards

# Steps for each evaluation, about; after the first steps the plan is made anew with what they took.
EVALUATE_EVERY = 200
# Samples on which they are timed, at most: a step takes as long on all of them.
TIMED_SAMPLES = 1 << 18
# Where fields share their samples, a plan that turns out too long is cut off after this many times the budget, at one
# of this many places.
PATIENCE, PLACES = 1.25, 40
# Names of a stored checkpoint and, inside it, of the times of the steps.
CHECKPOINT, CLOCK = "fit.checkpoint", "clock"


Maker: TypeAlias = GatheredShards | OwnLightShards | PosedShards


@dataclass(frozen=True)
class SurfaceSamples:
    """Training and validation samples of one role."""

    training: Samples
    validation: Samples
    unit: float
    """Radiance unit S."""
    plan: SamplePlan
    end: float
    """Wall seconds of the bake at which the role should be learned."""
    traced: Traced
    make: Maker
    """Made the training samples, and makes adaptive ones."""


def surface_samples(state: State, role: Role) -> SurfaceSamples:
    """Trace the samples before the adaptive stage that the budget buys; those of an interrupted bake are read.

    Args:
        state: The prepared scene.
        role: The part of the light to sample.

    Returns:
        The samples.
    """
    part = state.job.work.part(role=role)
    with state.job.work.timed("plan"):
        start = kept_plan(part, StartPlan, partial(_start_plan, state, role))
    make = _maker(state, role, start)
    plan = kept_plan(part, SamplePlan, partial(_sample_plan, state, role, start, make))
    if isinstance(make, GatheredShards):
        make = make.with_paths(_shards(state, plan.times).paths)
    traced = _trace(state, role, "uniform", plan.shards, make, f"trace {role}", plan.times)
    validation = _validation(state, role, start)
    light = None if role == "static" else state.variable
    spent = Traced(traced.report.paths, traced.report.dropped, len(traced.samples), start.sustained, make.paths)
    unit = radiance_unit(traced.samples, light)
    return SurfaceSamples(to_learn(traced.samples, role, unit), validation, unit, plan, start.end, spent, make)


def _validation(state: State, role: Role, start: StartPlan) -> Samples:
    """The held-out samples of a role."""
    light, own = looked_from(state), role == "static"
    if state.scene.movers:
        return posed_validation(state, role, light, _shards(state), start.gathered)
    return validation_samples(state.scene, light, state.job.request.seed, own, looked=state.looked)


def _start_plan(state: State, role: Role) -> StartPlan:
    """The time of a role, the rate of its path tracer, and what is traced before the first gathered shard."""
    request, work = state.job.request, state.job.work
    # The rays of the first role serve the scene's own light too.
    first = load_plan(work.part(role=state.roles[0]), StartPlan) if role != state.roles[0] else None
    if first:
        return replace(first, end=sum(learning_time(state, role)))
    rate = path_rate(state.scene, state.variable, request.seed, role == "static", not request.shards)
    begin, seconds = learning_time(state, role)
    gathered, each = request.shards or plan_gather(seconds, rate.short, POINTS_PER_SHARD, RAYS[request.quality]), 0.0
    end = begin + seconds
    if state.scene.movers:
        prepare = partial(timed_pose, state, role, looked_from(state), _shards(state))
        gathered, each = gather_in_time(state, seconds, gathered, prepare)
        end += seconds_for_others(state, role, gathered, each)
    times = times_in_time(state, seconds, gathered, each)
    return StartPlan(end, rate.short, gathered, rate.sustained, each * times, times)


def _sample_plan(state: State, role: Role, start: StartPlan, make: Maker) -> SamplePlan:
    """The number of shards; where it is not fixed, by the time of the first ones."""
    request = state.job.request
    if request.shards:
        return plan_samples(0, 0, 0, request.shards, state.job.shared)
    # Without a plan shards must be timed, so that those of a bake that was killed are of no use.
    shutil.rmtree(state.job.work.samples(f"{role}-uniform"), ignore_errors=True)
    cost = max(_trace(state, role, "uniform", TIMED_SHARDS, make, f"time {role}").seconds_per_shard, 1e-3)
    left = start.end - state.job.work.elapsed
    times = plan_paths(left, cost) if isinstance(make, GatheredShards) and make.traces_first else 1
    if times == 1:
        # Those that were timed are there already.
        left += TIMED_SHARDS * cost
    else:
        shutil.rmtree(state.job.work.samples(f"{role}-uniform"), ignore_errors=True)
    # Adaptive shards are gathered as the others are.
    plan = plan_samples(left, times * cost, times * cost, None, state.job.shared)
    return replace(plan, times=times).within(make.most)


def _maker(state: State, role: Role, start: StartPlan) -> Maker:
    """Return the function that makes the shards of a role."""
    shards = _shards(state)
    if state.scene.movers:
        return posed_maker(state, role, looked_from(state), shards, start.gathered, start.pose_seconds, start.times)
    size = GatherSize.of(start.gathered, shards, RAYS[state.job.request.quality])
    moving = TurnedShards if isinstance(state.variable, Turning) else GatheredShards
    kind = OwnLightShards if role == "static" else moving
    return kind(state.scene, looked_from(state), shards, size, state.looked)


def _shards(state: State, times: int = 1) -> ShardSettings:
    request = state.job.request
    return ShardSettings(paths=times * request.paths, seed=request.seed, lights=request.lights_per_shard)


def _trace(state: State, role: Role, name: str, count: int, make: Make, title: str, times: int = 1) -> TracedShards:
    """Write the shards that are missing and read them all."""
    folder, shards = state.job.work.samples(f"{role}-{name}"), _shards(state, times)
    with state.job.work.timed("trace"), state.job.progress.stage(title, count, "shards") as stage:
        return trace_shards(state.scene, looked_from(state), shards, folder, count, make, stage)


class SurfaceTraining:
    """The training of one role of a surface field."""

    def __init__(
        self,
        state: State,
        role: Role,
        samples: SurfaceSamples,
        start: Callable[[FieldSetup, int], Learner],
        part: WorkPart | None = None,
    ) -> None:
        """Set up a training.

        Args:
            state: The prepared scene.
            role: The role.
            samples: Its samples.
            start: Makes an untrained learner from set-up and seed.
            part: Part of the bake that stores plan and checkpoints; None: that of the role.
        """
        self.state, self.role, self.samples = state, role, samples
        self._samples_part = state.job.work.part(role=role)
        self._part = (part or self._samples_part).part(shards=samples.plan.shards)
        self.cut = False
        """Whether the time ran out before the planned steps."""
        self.adaptive = Traced()
        """What the adaptive shards cost."""
        self._start, self._title = start, f"train {role}"
        self._sample_plan = samples.plan
        # Seconds in which the learner took up its samples, and seconds and number of the steps since then.
        self._preparing, self._stepping, self._stepped = 0.0, 0.0, 0

    def run(self) -> Learner:
        """Train, from the checkpoint where there is one.

        Returns:
            The trained learner.
        """
        self._plan = self._planned()
        learner = self._resumed()
        with contextlib.suppress(GoodEnough):
            if self.state.job.shared:
                self._within_time(learner)
            else:
                self._rounds(learner)
        self._seconds = self.clock.seconds
        return learner

    @property
    def plan(self) -> dict[str, Any]:
        """The plan as it was carried out."""
        return asdict(self._sample_plan) | asdict(self._plan)

    @property
    def traced(self) -> Traced:
        """Cost of all samples."""
        a, b = self.samples.traced, self.adaptive
        return replace(a, paths=a.paths + b.paths, dropped=a.dropped + b.dropped)

    def summary(self, learner: Learner) -> Training:
        """Summarise time, steps and errors of the training.

        Args:
            learner: The trained learner.

        Returns:
            The summary.
        """
        curve = [(self.clock.at(step), error) for step, _, error in learner.state.history]
        return Training(self._seconds, learner.state.step, curve, self.cut)

    def _resumed(self) -> Learner:
        """The learner with its samples, at the last checkpoint where there is one."""
        # The clock counts what a learner makes of the samples before it trains.
        self.clock = Clock()
        found = self._part.find(CHECKPOINT, ARRAYS)
        if found is None:
            return self._prepared()
        try:
            self.clock = Clock(found.pop(CLOCK, None))
            learner = self._prepared()
            restore(learner, found)
        except ValueError as error:
            self.state.job.progress.say(f"[yellow]{self.role}: trained anew:[/] {error}")
            self.clock = Clock()
            return self._prepared()
        return learner

    def _prepared(self, most: int | None = None) -> Learner:
        """An untrained learner that has taken up all samples, or the first ``most`` of them."""
        state, samples, begin = self.state, self.samples, perf_counter()
        light = "static" if self.role == "static" else looked_from(state).kind
        setup = FieldSetup.of(state.scene, samples.unit, light, state.variable)
        setup = around_samples(setup, samples.training)
        learner = self._start(setup, state.job.request.seed)
        learner.learn_from(samples.training[:most])
        learner.validate_on(samples.validation)
        self._preparing = perf_counter() - begin
        return learner

    # ------------------------------------------------------------------ plan

    def _planned(self) -> StepPlan:
        """The plan for the budget, measured once; fixed counts where the settings give them."""
        request = self.state.job.request

        def make() -> StepPlan:
            cost = 0.0 if request.steps else self._seconds_per_step()
            return plan_steps(self._seconds_left(), cost, request.steps)

        with self.state.job.work.timed("plan"):
            return kept_plan(self._part, StepPlan, make)

    def _seconds_left(self) -> float:
        """Seconds that tracing leaves for training."""
        if self.state.job.shared:
            return (1 - SHARED_TRACE_SHARE) * role_seconds(self.state, self.role)
        plan = self._sample_plan
        # The samples are taken up twice, and the learner of the plan had a part of them.
        share = len(self.samples.training) / min(len(self.samples.training), TIMED_SAMPLES)
        taken = self._preparing * share * (2 if plan.adaptive_shards else 1)
        taken += plan.adaptive_shards * plan.seconds_per_adaptive
        taken += self.samples.make.before_adaptive if plan.adaptive_shards else 0.0
        left = self.samples.end - self.state.job.work.elapsed - taken
        return training_seconds(left, role_seconds(self.state, self.role))

    def _seconds_per_step(self) -> float:
        """Time of a training step on a scratch learner, compilation excluded."""
        # The first one compiles kernels, whose time would be multiplied by the number of samples.
        self._prepared(TIMED_SAMPLES)
        scratch = self._prepared(TIMED_SAMPLES)
        return timed_step(scratch.train, EVALUATE_EVERY)

    def _plan_last(self, learner: Learner) -> None:
        """Plan the adaptive stage and the steps after it anew, unless the settings fix them."""
        request, step = self.state.job.request, learner.state.step
        if request.steps or request.shards or request.budget.error:
            return

        def make() -> LastPlan:
            left = self.samples.end - self.state.job.work.elapsed
            left -= self.samples.make.before_adaptive if self._sample_plan.adaptive_shards else 0.0
            rest = (1 - FIRST_STEPS_SHARE) * role_seconds(self.state, self.role)
            left = self._preparing + training_seconds(left - self._preparing, rest)
            return plan_last(left, self._sample_plan, step, self._step_cost, self._preparing)

        last = kept_plan(self._part, LastPlan, make)
        self._sample_plan = replace(self._sample_plan, adaptive_shards=last.adaptive_shards)
        self._plan = replace(self._plan, steps=last.steps)

    def _plan_rest(self, learner: Learner) -> None:
        """Plan the steps after the adaptive stage anew where its shards are fixed and the steps are not: nothing has
        told how long they take."""
        request, step = self.state.job.request, learner.state.step
        if request.steps or not request.shards or request.budget.error:
            return

        def make() -> LastPlan:
            left = self.samples.end - self.state.job.work.elapsed
            fixed = replace(self._sample_plan, adaptive_shards=0)
            return plan_last(left, fixed, step, self._step_cost, 0.0)

        self._plan = replace(self._plan, steps=kept_plan(self._part, LastPlan, make).steps)

    @property
    def _step_cost(self) -> float:
        """Seconds of a step, measured in the training so far where there was one."""
        return self._stepping / self._stepped if self._stepped else self._plan.seconds_per_step

    # ------------------------------------------------------------------ train

    def _rounds(self, learner: Learner) -> None:
        """Train to the adaptive stage and after it; with an error budget, in rounds until the error is reached."""
        budget = self.state.job.request.budget
        if not self._train(learner, self._plan.first_steps):
            self._plan_last(learner)
        for _ in range(budget.rounds if budget.error else 1):
            if self._sample_plan.adaptive_shards:
                learner.learn_from(join([self.samples.training, self._adaptive(learner)]))
                self._plan_rest(learner)
            self._train(learner, self._plan.steps)
            if budget.error is None or learner.state.best_error <= budget.error:
                return
            self._sample_plan, self._plan = self._sample_plan.extended(), self._plan.extended()
            save_plan(self._samples_part, self._sample_plan)
            save_plan(self._part, self._plan)
        self.state.job.progress.say(
            f"[yellow]{self.role}: {learner.state.best_error:.1%} after {budget.rounds} rounds, "
            f"asked for {budget.error:.1%}"
        )

    def _adaptive(self, learner: Learner) -> Samples:
        """Samples where the squared residual of the fit so far is large."""
        make = self.samples.make.adaptive(self.samples.training, learner.predict)
        count, title = self._sample_plan.adaptive_shards, f"trace {self.role}, adaptive"
        traced = _trace(self.state, self.role, "adaptive", count, make, title, self._sample_plan.times)
        self.adaptive = Traced(traced.report.paths, traced.report.dropped)
        return to_learn(traced.samples, self.role, self.samples.unit)

    def _train(self, learner: Learner, until: int) -> bool:
        if learner.state.step >= until:
            return False
        job = self.state.job
        with job.work.timed("train"), job.progress.stage(self._title, until, "steps") as stage:
            look, save = self._watch(learner, stage)
            begin, before = perf_counter(), learner.state.step
            stopped = learner.train(until, self._plan.steps, look, checkpoint=save)
            self._stepping += perf_counter() - begin
            self._stepped += learner.state.step - before
            return stopped

    def _within_time(self, learner: Learner) -> None:
        """Train to the planned steps, to the learner's own end, or until the time has run out."""
        steps, timed = self._plan.steps, not self.state.job.request.steps
        if learner.state.stopped:
            return  # It was resumed after early stopping had ended it.
        deadline = PATIENCE * self._seconds_left()
        place = max(-(-steps // PLACES), 1) if timed else steps
        with self.state.job.progress.stage(self._title, steps, "steps") as stage:
            look, save = self._watch(learner, stage)
            while learner.state.step < steps:
                # Something is learned however slow the machine is.
                self.cut = timed and learner.state.step > 0 and self.clock.seconds > deadline
                if self.cut:
                    return
                before = learner.state.step
                until = min((before // place + 1) * place, steps)
                stopped = learner.train(until, steps, look, checkpoint=save)
                save()
                if stopped or learner.state.step == before:
                    return

    def _watch(self, learner: Learner, stage: ProgressStage) -> tuple[Progress, Callable[[], None]]:
        """Return the callbacks of a training for each evaluation and for checkpoints."""

        def look(state: TrainingState, _: int) -> None:
            self.clock.mark(state.step)
            stage.move_to(state.step, f"error {state.best_error:.1%}")
            self._observed(learner)

        def save() -> None:
            self._part.put(CHECKPOINT, {**learner.arrays(), CLOCK: self.clock.array()}, ARRAYS)

        return look, save

    def _observed(self, learner: Learner) -> None:
        """Tell the observer of the bake; time in which it pauses the training does not count."""
        job = self.state.job
        if job.observer is not None:
            seconds = job.observer.evaluated(self.role, learner)
            self.clock.skip(seconds)
            job.work.skip(seconds)
