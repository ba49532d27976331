"""Budgets, plans and the work folder."""

import pytest

from lightwell.baking.plan import FEWEST_SHARDS, FEWEST_STEPS, MOST_SHARDS, Plan, load_plan, make_plan, save_plan
from lightwell.baking.settings import Budget


@pytest.mark.parametrize(
    ("text", "seconds", "error"),
    [("60s", 60, None), ("90", 90, None), ("5m", 300, None), ("1.5h", 5400, None), ("5%", None, 0.05)],
)
def test_budgets_are_read(text, seconds, error):
    assert Budget.parse(text) == Budget(seconds, error)


@pytest.mark.parametrize("text", ["", "fast", "-5s", "0s", "0%", "5 parsecs", "1e3s", "nan"])
def test_nonsense_budgets_name_the_cure(text):
    with pytest.raises(ValueError, match=r"--budget .* write 60s, 5m, 1h or 5%"):
        Budget.parse(text)


def test_a_plan_spends_the_budget():
    plan = make_plan(100, seconds_per_shard=2.0, seconds_per_step=0.02)
    spent = 2.0 * (plan.shards + plan.adaptive_shards) + 0.02 * plan.steps
    assert 95 <= spent <= 101
    assert 0 < plan.first_steps < plan.steps


def test_a_slow_machine_still_gets_a_plan():
    plan = make_plan(1, seconds_per_shard=60, seconds_per_step=5)
    assert plan.shards + plan.adaptive_shards == FEWEST_SHARDS and plan.steps == FEWEST_STEPS


def test_a_fast_machine_is_bounded_by_memory():
    plan = make_plan(10_000, seconds_per_shard=0.1, seconds_per_step=0.02)
    assert plan.shards + plan.adaptive_shards == MOST_SHARDS


def test_a_round_more():
    plan = Plan(8, 2, 400, 1000)
    more = plan.extended()
    assert more.adaptive_shards > plan.adaptive_shards and more.steps > plan.steps


def test_a_plan_survives_the_disk(tmp_path):
    plan = make_plan(10, 0.5, 0.01)
    save_plan(tmp_path / "plan.json", plan)
    assert load_plan(tmp_path / "plan.json") == plan
    assert [p.name for p in tmp_path.iterdir()] == ["plan.json"]
