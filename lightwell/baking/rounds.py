"""One learned field from nothing to its shading graph: trace, train, trace where the error is, train on."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter

from lightwell.baking.plan import FEWEST_SHARDS, Plan, load_plan, make_plan, save_plan
from lightwell.baking.progress import Progress, Stage
from lightwell.baking.settings import MOST_ROUNDS, BakeSettings
from lightwell.baking.tracing import trace_shards, validation_samples
from lightwell.baking.work import Work
from lightwell.fields import FieldSetup, Fit, radiance_unit, starter
from lightwell.networks.training import TrainingState
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport import PathReport, Samples
from lightwell.transport.adaptive_shards import AdaptiveShards
from lightwell.transport.collect import join
from lightwell.transport.shards import ShardSettings, make_shard

# Steps that are timed to make a plan; the first ones compile kernels.
WARM_UP_STEPS, TIMED_STEPS = 5, 15
# Length of the schedule that they belong to: long, so that they hold no change of levels or rounds.
NOMINAL_STEPS = 1 << 16


@dataclass
class Rounds:
    """The work of one role: 'indirect' (a declared light) or 'static' (the scene's own emitters)."""

    scene: Scene
    variable: Variable
    role: str
    settings: BakeSettings
    work: Work
    progress: Progress
    seconds: float
    """Budget of the first round."""
    # What each kind of shard cost.
    _traced: dict[str, PathReport] = field(default_factory=dict, init=False)

    @property
    def paths(self) -> int:
        """Light paths traced for training."""
        return sum(report.paths for report in self._traced.values())

    @property
    def path_rate(self) -> float:
        """Light paths per second as the plan measured them, without finding surface points."""
        plan = load_plan(self.folder / "plan.json")
        return self._shards.size * self.settings.paths / max(plan.seconds_per_shard, 1e-3)

    @property
    def dropped(self) -> int:
        """... of which were NaN or infinite and left out."""
        return sum(report.dropped for report in self._traced.values())

    @property
    def folder(self) -> Path:
        """Where checkpoints, plan and samples of this role live."""
        return self.work.part(self.role)

    @property
    def _shards(self) -> ShardSettings:
        # Both roles share the seed but not the numbers.
        return ShardSettings(
            paths=self.settings.paths,
            seed=2 * self.settings.seed + (self.role == "static"),
            lights=self.settings.lights_per_shard,
        )

    # ------------------------------------------------------------------ the whole

    def run(self) -> tuple[Fit, float]:
        """Fit; returns the fit and the radiance unit S."""
        first_shards = self._first_shards()
        samples = self._uniform(first_shards)
        fit, unit = self._start(samples)
        plan = self._plan(samples)
        if plan.shards > first_shards:
            samples = self._uniform(plan.shards)
            fit, unit = self._start(samples)
        checkpoint = self.folder / "fit.npz"
        if checkpoint.exists():
            fit.load(checkpoint)
        self._rounds(fit, samples, plan, checkpoint)
        return fit, unit

    def _rounds(self, fit: Fit, uniform: Samples, plan: Plan, checkpoint: Path) -> None:
        """Train to the adaptive stage and on; with an error budget, round after round until the goal is met."""
        goal = self.settings.budget.error
        self._train(fit, plan.first_steps, plan.steps, checkpoint)
        for _ in range(MOST_ROUNDS if goal else 1):
            if plan.adaptive_shards:
                fit.learn_from(join([uniform, self._adaptive(fit, uniform, plan.adaptive_shards)]))
            self._train(fit, plan.steps, plan.steps, checkpoint)
            if goal is None or fit.state.best_error <= goal:
                return
            plan = plan.extended()
            save_plan(self.folder / "plan.json", plan)
        self.progress.say(
            f"[yellow]{self.role}: {fit.state.best_error:.1%} after {MOST_ROUNDS} rounds, asked for {goal:.1%}"
        )

    def _start(self, samples: Samples) -> tuple[Fit, float]:
        unit = radiance_unit(samples)
        light = "static" if self.role == "static" else self.variable.kind
        setup = FieldSetup.of(self.scene, unit, light, self.variable, self.settings.spacing)
        fit = starter(self.settings.field, self.settings.preset)(setup, self.settings.seed)
        fit.learn_from(samples)
        fit.validate_on(self._validation())
        return fit, unit

    def plan_json(self) -> dict:
        """The plan as it was carried out."""
        return asdict(load_plan(self.folder / "plan.json"))

    # ------------------------------------------------------------------ plan

    def _first_shards(self) -> int:
        path = self.folder / "plan.json"
        if path.exists():
            return load_plan(path).shards
        # Without a plan the shards must be timed, so that those of a bake that was killed are of no use.
        shutil.rmtree(self.folder / "uniform", ignore_errors=True)
        return self.settings.shards or FEWEST_SHARDS

    def _plan(self, samples: Samples) -> Plan:
        """What the budget buys, measured once; fixed counts where the settings give them."""
        path = self.folder / "plan.json"
        if path.exists():
            return load_plan(path)
        start = perf_counter()
        plan = make_plan(self.seconds, self._seconds_per_shard, self._seconds_per_step(samples))
        if self.settings.shards:
            plan = replace(plan, shards=self.settings.shards, adaptive_shards=max(self.settings.shards // 4, 1))
        if self.settings.steps:
            first = max(int(0.4 * self.settings.steps), 1)
            plan = replace(plan, first_steps=first, steps=self.settings.steps)
        save_plan(path, plan)
        self.work.seconds["plan"] = self.work.seconds.get("plan", 0.0) + perf_counter() - start
        return plan

    def _seconds_per_step(self, samples: Samples) -> float:
        """Time of a training step on a scratch fit, compilation excluded."""
        scratch, _ = self._start(samples)
        scratch.train(WARM_UP_STEPS, NOMINAL_STEPS)
        start = perf_counter()
        scratch.train(WARM_UP_STEPS + TIMED_STEPS, NOMINAL_STEPS)
        return (perf_counter() - start) / TIMED_STEPS

    # ------------------------------------------------------------------ trace

    def _generate(self, name: str, count: int, make: Callable, title: str) -> Samples:
        """Write the shards that are missing and read them all; the last shard's time is kept for the plan."""
        with self.work.timed("trace"), self.progress.stage(title, count, "shards") as stage:
            traced = trace_shards(self.scene, self.variable, self._shards, self.folder / name, count, make, stage)
        self._traced[name], self._seconds_per_shard = traced.report, traced.seconds_per_shard
        return traced.samples

    def _uniform(self, count: int) -> Samples:
        make = partial(make_shard, own_light=self.role == "static")
        return self._generate("uniform", count, make, f"trace {self.role}")

    def _adaptive(self, fit: Fit, uniform: Samples, count: int) -> Samples:
        """Samples where the squared residual of the fit so far is large."""
        make = AdaptiveShards(self.scene, uniform, fit.predict, own_light=self.role == "static")
        return self._generate("adaptive", count, make, f"trace {self.role}, adaptive")

    def _validation(self) -> Samples:
        return validation_samples(self.scene, self.variable, self.settings.seed, own_light=self.role == "static")

    # ------------------------------------------------------------------ train

    def _train(self, fit: Fit, until: int, total: int, checkpoint: Path) -> bool:
        if fit.state.step >= until:
            return False
        with self.work.timed("train"), self.progress.stage(f"train {self.role}", until, "steps") as stage:
            stopped = fit.train(
                until, total, lambda state, _: _show(stage, state), checkpoint=lambda: fit.save(checkpoint)
            )
        return stopped


def _show(stage: Stage, state: TrainingState) -> None:
    stage.move_to(state.step, f"error {state.best_error:.1%}")
