"""An error budget works in rounds: it stops when the error is met, and gives up with a word when it is not."""

from dataclasses import replace

import pytest

from lightwell.core.progress import Progress
from lightwell.core.work import Work
from lightwell.fields.budget import Budget
from lightwell.fields.no_options import NoOptions
from lightwell.fields.protocol import Job
from lightwell.fields.registry import find_field
from lightwell.fields.request import Request
from lightwell.scenes import load

from .conftest import small

# A field without kernels.
FIELD = "tree"


class Heard(Progress):
    """Silent bars; keeps what was said."""

    def __init__(self):
        super().__init__(quiet=True)
        self.said = []

    def say(self, text):
        self.said.append(text)


@pytest.fixture(scope="module")
def sampled(tmp_path_factory):
    """A prepared scene and its samples."""
    scene, request = load("cornell"), Request(steps=20, shards=1, lights_per_shard=8, paths=4)
    work = Work(small(tmp_path_factory.mktemp("samples")), scene.digest)
    state = find_field(FIELD).prepare(Job(scene, request, NoOptions(), work, Progress(quiet=True)))
    return state, find_field(FIELD).sample(state, "indirect")


def fitted(sampled, budget, out):
    """(plan of the fit, what was said) of a fit with a budget."""
    (state, samples), heard = sampled, Heard()
    work = Work(small(out), state.scene.digest)
    job = replace(state.job, request=replace(state.job.request, budget=budget), work=work, progress=heard)
    return find_field(FIELD).fit(replace(state, job=job), "indirect", samples).plan, heard.said


@pytest.mark.slow
def test_a_goal_that_is_met_ends_after_the_first_round(sampled, tmp_path):
    plan, said = fitted(sampled, Budget(None, 50.0), tmp_path)
    assert plan["steps"] == 20 and not said


@pytest.mark.slow
def test_a_goal_that_is_not_met_takes_more_rounds_and_says_so(sampled, tmp_path):
    plan, said = fitted(sampled, Budget(None, 1e-6, rounds=2), tmp_path)
    assert plan["steps"] > 20
    assert any("asked for" in text for text in said)
