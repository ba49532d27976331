"""A bake of fixed shards and a time: what the adaptive shards take is left out of the training."""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np
from made_up import make_samples

from lightwell.baking.settings import BakeSettings
from lightwell.core.progress import Progress
from lightwell.core.work import Work
from lightwell.fields.no_options import NoOptions
from lightwell.fields.protocol import Job, State, Traced
from lightwell.fields.request import Request
from lightwell.fields.surface.plan import StepPlan, load_plan, plan_samples
from lightwell.fields.surface.training import SurfaceSamples, SurfaceTraining
from lightwell.networks.loop import TrainingState
from lightwell.scenes import load
from lightwell.scenes.variables import default_variable
from lightwell.transport.samples import columns_of
from lightwell.transport.seen_shards import path_counts

SECONDS, STEP, ADAPTIVE = 3.0, 2e-3, 1.5


class Slow:
    """A learner whose steps take a known time."""

    def __init__(self):
        self.state = TrainingState()

    def learn_from(self, samples):
        pass

    def validate_on(self, samples):
        pass

    def predict(self, query):
        return np.zeros((len(query), 3), np.float32)

    def train(self, until, total, progress=None, checkpoint=None):
        time.sleep(STEP * max(until - self.state.step, 0))
        self.state.step = max(until, self.state.step)
        return False


def shard(scene, variable, lights, settings, index):
    """Made-up samples, which took their time."""
    time.sleep(ADAPTIVE)
    samples = make_samples(64, index)
    columns = columns_of(samples.query) | {name: getattr(samples, name) for name in ("half_a", "half_b", "weight")}
    return columns | {"shape": samples.shape}, path_counts(64)


def test_steps_are_planned_anew_when_the_adaptive_shards_are_there(tmp_path):
    scene, request = load("cornell"), Request(shards=2)
    work = Work(BakeSettings(scene="cornell", out=tmp_path / "out"), scene.digest)
    job = Job(scene, request, NoOptions(), work, Progress(quiet=True))
    state = State(job, scene, default_variable(scene), ("indirect",))
    samples, make = make_samples(256, 1), SimpleNamespace(before_adaptive=0.0, adaptive=lambda known, predict: shard)
    plan = plan_samples(0, 0, 0, request.shards, False)
    given = SurfaceSamples(samples, samples, 1.0, plan, work.elapsed + SECONDS, Traced(), make)
    training = SurfaceTraining(state, "indirect", given, lambda setup, seed: Slow())
    learner = training.run()
    first = load_plan(work.part(role="indirect").part(shards=2), StepPlan)
    # Two fifths of the steps, then the shard; what is left is a tenth of the time.
    assert learner.state.step == training.plan["steps"] < 0.8 * first.steps
    assert training.plan["adaptive_shards"] == 1
