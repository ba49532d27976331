"""Budgets, plans and the work folder."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from lightwell.core.formats import JSON
from lightwell.core.options import parsed
from lightwell.core.store import Store
from lightwell.core.work import Work, WorkPart
from lightwell.fields.budget import Budget
from lightwell.fields.surface.clock import Clock
from lightwell.fields.surface.plan import (
    FEWEST_SHARDS,
    FEWEST_STEPS,
    MOST_SHARDS,
    SamplePlan,
    StepPlan,
    load_plan,
    plan_samples,
    plan_steps,
    save_plan,
)


@pytest.mark.parametrize(
    ("text", "seconds", "error"),
    [("60s", 60, None), ("90", 90, None), ("5m", 300, None), ("1.5h", 5400, None), ("5%", None, 0.05)],
)
def test_budgets_are_read(text, seconds, error):
    assert Budget.parse(text) == Budget(seconds, error)


@pytest.mark.parametrize("text", ["", "fast", "-5s", "0s", "0%", "5 parsecs", "1e3s", "nan"])
def test_nonsense_budgets_name_the_cure(text):
    with pytest.raises(ValueError, match=r"--budget .* write 60s, 5m, 1h or 5%"):
        parsed("bake", "--budget", text, Budget.parse)


def test_a_plan_spends_the_budget():
    samples = plan_samples(100, 2.0, None, shared=False)
    traced = 2.0 * (samples.shards + samples.adaptive_shards)
    steps = plan_steps(100 - traced, 0.02, None)
    assert 95 <= traced + 0.02 * steps.steps <= 101
    assert 0 < steps.first_steps < steps.steps


def test_a_slow_machine_still_gets_a_plan():
    samples = plan_samples(1, 60, None, shared=False)
    assert samples.shards + samples.adaptive_shards == FEWEST_SHARDS and plan_steps(-119, 5, None).steps == FEWEST_STEPS


def test_a_fast_machine_is_bounded_by_memory():
    samples = plan_samples(10_000, 0.1, None, shared=False)
    assert samples.shards + samples.adaptive_shards == MOST_SHARDS


def test_fixed_counts_are_kept_and_shared_samples_are_never_adaptive():
    assert plan_samples(1, 1, 8, shared=False) == SamplePlan(8, 2, 1)
    assert plan_samples(1, 1, 8, shared=True) == SamplePlan(8, 0, 1)
    assert plan_steps(1, 1, 50) == StepPlan(20, 50, 1)


def test_a_round_more():
    samples, steps = SamplePlan(8, 2), StepPlan(400, 1000)
    assert samples.extended().adaptive_shards > samples.adaptive_shards and steps.extended().steps > steps.steps


def test_a_plan_survives_the_disk(tmp_path):
    part, plan = WorkPart(Store(tmp_path), {"role": "static"}), plan_samples(10, 0.5, None, shared=False)
    assert load_plan(part, SamplePlan) is None
    save_plan(part, plan)
    assert load_plan(part, SamplePlan) == plan and load_plan(part, StepPlan) is None
    assert load_plan(part.part(field="mlp"), SamplePlan) is None


@dataclass(frozen=True)
class Asked:
    out: Path
    resume: bool = False
    keep: bool = True
    seed: int = 0


@pytest.mark.parametrize("harm", [b"", b"[]", b'{"signature"', b"\xff"])
def test_a_damaged_manifest_begins_anew_with_a_note(tmp_path, caplog, harm):
    Work(Asked(tmp_path), "scene").part(role="static").put("fit", [1], JSON)
    resumed = lambda: Work(Asked(tmp_path, resume=True), "scene").part(role="static").find("fit", JSON)  # noqa: E731
    assert resumed() == [1]
    (tmp_path / ".lightwell" / "bake.json").write_bytes(harm)
    assert resumed() is None
    assert "bake.json' is damaged; the bake begins anew" in caplog.text


def test_work_of_another_version_is_refused(tmp_path):
    Work(Asked(tmp_path), "scene").part()
    manifest = tmp_path / ".lightwell" / "bake.json"
    found = json.loads(manifest.read_text())
    manifest.write_text(json.dumps(found | {"lightwell": "0.0.1", "signature": "0"}))
    with pytest.raises(ValueError, match=r"another lightwell \(0.0.1, this is .*\); .* without --resume"):
        Work(Asked(tmp_path, resume=True), "scene").part()


def test_seconds_add_up_over_runs_and_an_unused_folder_is_not_made(tmp_path):
    with Work(Asked(tmp_path), "scene").timed("train"):
        pass
    assert not list(tmp_path.iterdir())
    first = Work(Asked(tmp_path), "scene")
    first.part()
    with first.timed("train"):
        pass
    again = Work(Asked(tmp_path, resume=True, keep=False), "scene")
    again.part()
    assert again.seconds == first.seconds
    again.close()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("harm", [b"", b"[]", b'{"check": "", "value": {}}'])
def test_a_damaged_plan_is_made_again_with_a_note(tmp_path, caplog, harm):
    part = WorkPart(Store(tmp_path), {})
    save_plan(part, StepPlan(3, 4))
    (entry,) = part.store.entries()
    entry.path.write_bytes(harm)
    assert load_plan(part, StepPlan) is None and "is damaged and is made again" in caplog.text


@pytest.mark.parametrize("marks", [np.zeros(3), np.zeros((0, 2)), np.full((1, 2), np.nan)])
def test_a_clock_of_something_else_is_refused(marks):
    with pytest.raises(ValueError, match="not rows of step and seconds"):
        Clock(marks)
