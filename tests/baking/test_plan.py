"""Budgets, plans and the work folder."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

from lightwell.baking.reference_budget import ReferenceBudget, reference_seconds
from lightwell.core.formats import JSON
from lightwell.core.options import parsed
from lightwell.core.store import Store
from lightwell.core.work import Work, WorkPart
from lightwell.fields.budget import QUALITY_SECONDS, Budget, estimate, learning_end, scoring_seconds
from lightwell.fields.registry import PRESETS, QUALITY_PRESETS, preset_of
from lightwell.fields.request import Request
from lightwell.fields.surface.clock import Clock
from lightwell.fields.surface.factored import PRESETS as FACTORED
from lightwell.fields.surface.plan import (
    FEWEST_GATHERED,
    FEWEST_SHARDS,
    FEWEST_STEPS,
    LEAST_TRAINING_SHARE,
    MOST_GATHERED,
    MOST_SHARDS,
    MOST_TIMES,
    PATHS_SHARE,
    TRACE_SHARE,
    LastPlan,
    SamplePlan,
    StepPlan,
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


@pytest.mark.parametrize(
    ("most", "expected"), [(None, (9, 3)), (13, (9, 3)), (12, (12, 0)), (4, (4, 0)), (1, (FEWEST_SHARDS, 0))]
)
def test_a_plan_has_no_more_shards_than_hold_something_new(most, expected):
    found = SamplePlan(9, 3).within(most)
    assert (found.shards, found.adaptive_shards) == expected


def test_a_plan_spends_the_time_that_is_left():
    samples = plan_samples(100, 2.0, 4.0, None, shared=False)
    traced = 2.0 * samples.shards + 4.0 * samples.adaptive_shards
    steps = plan_steps(100 - traced, 0.02, None)
    assert 0.85 * TRACE_SHARE * 100 <= traced <= TRACE_SHARE * 100 + 2 and 95 <= traced + 0.02 * steps.steps <= 101
    assert 0 < samples.adaptive_shards < samples.shards and 0 < steps.first_steps < steps.steps


def test_adaptive_shards_cost_what_they_cost_and_not_what_the_others_do():
    cheap, dear = (plan_samples(100, 0.5, cost, None, shared=False) for cost in (0.5, 4.0))
    assert dear.adaptive_shards < cheap.adaptive_shards
    assert 0.5 * dear.shards + 4.0 * dear.adaptive_shards <= TRACE_SHARE * 100 + 1


def test_a_slow_machine_still_gets_a_plan():
    samples = plan_samples(1, 60, 240, None, shared=False)
    assert samples.shards + samples.adaptive_shards == FEWEST_SHARDS and plan_steps(-119, 5, None).steps == FEWEST_STEPS
    assert plan_gather(1, 10, 1 << 14, 64) == FEWEST_GATHERED


def test_a_field_is_trained_however_long_its_samples_took():
    assert training_seconds(-20, 120) == training_seconds(1, 120) == LEAST_TRAINING_SHARE * 120
    assert training_seconds(40, 120) == 40


def test_a_fast_machine_is_bounded_by_memory():
    samples = plan_samples(10_000, 0.1, 0.4, None, shared=False)
    assert samples.shards + samples.adaptive_shards == MOST_SHARDS
    assert plan_gather(10_000, 1e7, 1 << 14, 64) == MOST_GATHERED


def test_samples_have_more_paths_where_shards_are_cheap():
    dear, fair, cheap = (plan_paths(100, cost) for cost in (2.0, 0.4, 0.001))
    assert (dear, fair, cheap) == (1, int(PATHS_SHARE * 100 / (MOST_SHARDS * 0.4)), MOST_TIMES)
    # They take a part of the time of tracing.
    assert MOST_SHARDS * 0.4 * fair <= PATHS_SHARE * 100 < TRACE_SHARE * 100 and plan_paths(-5, 1.0) == 1


def test_less_is_gathered_where_time_is_short():
    sizes = [plan_gather(seconds, 3e5, 1 << 14, 64) for seconds in (10, 30, 60, 120)]
    assert sizes == sorted(sizes) and sizes[0] < sizes[-1]
    assert all(size & (size - 1) == 0 for size in sizes)


def test_fixed_counts_are_kept_and_shared_samples_are_never_adaptive():
    assert plan_samples(1, 1, 2, 8, shared=False) == SamplePlan(8, 2, 1, 2)
    assert plan_samples(1, 1, 2, 8, shared=True) == SamplePlan(8, 0, 1, 2)
    assert plan_steps(1, 1, 50) == StepPlan(20, 50, 1)


def test_the_last_stage_is_planned_from_what_is_left():
    samples = SamplePlan(32, 4, 0.5, 4.0)
    on_time = plan_last(30, samples, 400, 0.02, 1.0)
    assert on_time.adaptive_shards == 3 and on_time.steps == 400 + int((30 - 12 - 1) / 0.02)
    late = plan_last(2, samples, 400, 0.02, 1.0)
    assert late.adaptive_shards == 0 and late.steps == 400 + FEWEST_STEPS
    # A first plan that was too short does not limit the rest.
    assert plan_last(1000, samples, 40, 0.02, 1.0) == LastPlan(4, 40 + int((1000 - 4 * 4 - 1) / 0.02))


@pytest.mark.parametrize(("quality", "seconds"), [("draft", 30), ("good", 180), ("best", 1200)])
def test_a_quality_sets_the_time_unless_a_budget_does(quality, seconds):
    assert Request(quality=quality).budget == Budget(seconds)
    assert Request(quality=quality, budget=Budget(7)).budget == Budget(7)
    assert Request(quality=quality, budget=Budget(None, 0.05)).budget == Budget(None, 0.05)


def test_the_shares_of_the_wall_time_add_up():
    for seconds in (20, 30, 180, 1200):
        assert 0 < learning_end(seconds, 0.0) < seconds
        assert learning_end(seconds, 0.0) + scoring_seconds(seconds) == pytest.approx(seconds)
    # Slow loading leaves a little to learn in, and delays the end.
    assert learning_end(20, 60.0) == 60 + 0.2 * 20


def test_the_estimate_names_the_stages():
    assert estimate(Budget(180)) == "about 3 min: 80 s tracing, 45 s training, 60 s scoring"
    assert estimate(Budget(1200)).startswith("about 20 min: ")
    assert estimate(Budget(None, 0.05)) == ""


def test_the_reference_takes_what_is_left():
    assert reference_seconds(45) == pytest.approx(31.2)
    assert reference_seconds(-100) == 4.0
    few, many = (ReferenceBudget.within(seconds, 3e5, 4 * 224 * 140) for seconds in (5, 50))
    assert few.pixel_paths < many.pixel_paths and few.point_paths < many.point_paths
    two = ReferenceBudget.within(50, 3e5, 4 * 224 * 140, roles=2)
    assert two.pixel_paths < many.pixel_paths


def test_pictures_have_fewer_paths_where_the_first_one_is_late():
    budget = ReferenceBudget(picture_spp=32, picture_seconds=16.0)
    assert [budget.further_spp(seconds, 4) for seconds in (1, 5, 8, 16, 400)] == [32, 32, 16, 8, 4]
    assert ReferenceBudget(picture_spp=32).further_spp(400, 4) == 32
    assert ReferenceBudget(picture_spp=2, picture_seconds=1.0).further_spp(400, 4) == 2


def test_every_quality_of_a_field_is_one_of_its_presets():
    for name, presets in QUALITY_PRESETS.items():
        assert set(presets) <= set(QUALITY_SECONDS) and set(presets.values()) <= set(PRESETS[name])
    assert preset_of("factored", "default", "best") == "best" and preset_of("factored", "default", "good") == "default"
    assert preset_of("factored", "small", "best") == "small" and preset_of("tree", "default", "best") == "default"


def test_qualities_keep_their_sizes():
    """Two fields, of the declared light and of the scene's own emitters, are within 100 and 1,000 kB."""
    for quality, most in (("draft", 100e3), ("best", 1000e3)):
        preset = FACTORED[quality]
        layer = (preset.grid.width + 1) * preset.hidden[0] * preset.light_hidden[-1]
        assert 2 * preset.grid.entries * preset.grid.channels + layer <= 0.95 * most


def test_a_round_more():
    samples, steps = SamplePlan(8, 2), StepPlan(400, 1000)
    assert samples.extended().adaptive_shards > samples.adaptive_shards and steps.extended().steps > steps.steps


def test_a_plan_survives_the_disk(tmp_path):
    part, plan = WorkPart(Store(tmp_path), {"role": "static"}), plan_samples(10, 0.5, 2.0, None, shared=False)
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
    assert again.seconds == first.seconds and again.elapsed > first.seconds["train"]
    again.close()
    assert not list(tmp_path.iterdir())


def test_the_wall_time_counts_loading_and_earlier_runs(tmp_path):
    first = Work(Asked(tmp_path), "scene", started=perf_counter() - 100)
    first.part()
    with first.timed("train"):
        pass
    again = Work(Asked(tmp_path, resume=True), "scene", started=perf_counter() - 10)
    again.part()
    assert 100 <= first.elapsed < 110 <= again.elapsed < 120


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


def test_a_step_is_timed_without_the_evaluations_that_end_timed_runs():
    step, evaluation, pause, done, now, runs = 0.004, 0.1, 3.0, 0, 0.0, 0

    def train(until: int, total: int) -> bool:
        nonlocal done, now, runs
        runs += 1
        # The machine pauses in one of the runs.
        now += step * (until - done) + evaluation + (pause if runs == 4 else 0.0)
        done = until
        return False

    assert timed_step(train, 100, lambda: now) == pytest.approx(step + evaluation / 100)


def test_a_training_that_ends_at_once_has_no_time_of_a_step():
    assert timed_step(lambda until, total: True, 100) == math.inf
