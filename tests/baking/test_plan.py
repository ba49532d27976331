"""Budgets, plans and the work folder."""

import pytest

from lightwell.core.options import parsed
from lightwell.fields.budget import Budget
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
    plan = plan_samples(10, 0.5, None, shared=False)
    save_plan(tmp_path / "plan.json", plan)
    assert load_plan(tmp_path / "plan.json", SamplePlan) == plan
    assert [p.name for p in tmp_path.iterdir()] == ["plan.json"]
