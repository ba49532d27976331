"""The kd-tree's rule on functions whose leaves are known, its caps, and its partition."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import SETUP, make_query, make_samples

from lightwell.fields.surface.kd_level import is_trained
from lightwell.fields.surface.kdtree import PRESETS, KdFit, KdPreset
from lightwell.fields.surface.partition import Partition
from lightwell.graph import Builder, evaluate
from lightwell.networks import TrainingSettings

# Leaves that are linear functions, solved by least squares: exact where the truth is linear.
LINEAR = KdPreset(
    TrainingSettings(evaluate_every=1, patience=0),
    "raw",
    hidden=(),
    demodulated=False,
    output="identity",
    optimiser="lm",
    goal=0.01,
    rule="raw",
    samples_per_weight=2.0,
)


def folded(query):
    """Linear in x < 0; in x ≥ 0 bent where y = 0. The bend at x = 0 is the stronger one."""
    x, y = query.position[:, :1], query.position[:, 1:2]
    return (0.5 + np.where(x < 0, -0.4 * x, 0.4 * x + 0.2 * np.abs(y))) * np.ones((1, 3))


def _fit(preset, radiance=folded, count=6000, steps=40, noise=0.0):
    fit = KdFit(SETUP, preset, 0)
    fit.learn_from(make_samples(count, 1, radiance, noise))
    fit.validate_on(make_samples(500, 2, radiance))
    fit.train(steps, steps)
    return fit


def test_a_separable_function_gives_the_known_leaves():
    fit = _fit(LINEAR)
    assert fit.partition.nodes[:, :2].tolist() == [[0, 0], [1, 0]]
    boxes = {(*low, *high) for low, high in zip(fit.partition.low.tolist(), fit.partition.high.tolist())}
    assert boxes == {(-1, -1, -1, 0, 1, 1), (0, -1, -1, 1, 0, 1), (0, 0, -1, 1, 1, 1)}
    assert fit.facts["leaves_by_status"] == {"met": 3}
    assert fit.facts["leaves_by_depth"] == {"1": 1, "2": 2}


def test_cycling_takes_x_then_y_then_z():
    """The same bends; the left half meets the goal after the cut in x, the right one after that in y."""
    fit = _fit(replace(LINEAR, axes="cycle"))
    assert fit.partition.nodes[:, :2].tolist() == [[0, 0], [1, 0]]


def test_a_linear_function_is_one_leaf():
    fit = _fit(LINEAR, lambda q: 0.5 + 0.2 * q.position)
    assert len(fit.partition) == 1 and fit.facts["leaves_by_status"] == {"met": 1}


def test_noise_forces_splits_under_the_raw_rule_only():
    """Targets with 30 % noise: the raw rule splits down to the fewest samples, the corrected one only at the bends."""
    leaves = {}
    for rule in ("raw", "corrected"):
        fit = _fit(replace(LINEAR, rule=rule, goal=0.05, axes="cycle"), count=6000, noise=0.3, steps=100)
        leaves[rule] = len(fit.partition)
    assert leaves["corrected"] <= 4
    assert leaves["raw"] > 30


@pytest.mark.parametrize("changes, reason", [({"leaves": 5}, "no room"), ({"depth": 2}, "deep")])
def test_caps_are_kept_and_named(changes, reason):
    fit = _fit(replace(LINEAR, goal=0.0, **changes), steps=60)
    assert len(fit.partition) <= changes.get("leaves", 4)
    assert fit.partition.depth.max() <= changes.get("depth", 20)
    assert fit.facts["leaves_by_status"][reason] > 0


def test_leaves_with_few_samples_are_not_split():
    fit = _fit(replace(LINEAR, goal=0.0), count=3000, steps=100)
    count = np.bincount(fit.segment(fit.examples.query)[is_trained(fit.examples)])
    # A leaf that was split had twice the least samples per weight; its halves may have fewer.
    weights = sum(a * b + b for a, b in zip(fit.mlp.sizes, fit.mlp.sizes[1:]))
    fewest = int(fit.preset.samples_per_weight * weights)
    assert (count < fewest).all() and fit.facts["leaves_by_status"].keys() <= {"few samples", "met"}


def test_halves_of_default_are_given_up_when_they_are_no_better():
    """A constant needs no split, however strict the goal."""
    training = TrainingSettings(rate=1e-2, batch=64, evaluate_every=5, patience=0)
    preset = replace(PRESETS["default"], goal=0.0, training=training)
    fit = _fit(preset, lambda q: 0.4 * q.reflectance, count=20_000, steps=100, noise=1.0)
    assert len(fit.partition) <= 4 and fit.facts["leaves_by_status"].get("no gain", 0) > 0


def test_held_out_samples_stay_held_out_when_more_come():
    few, many = KdFit(SETUP, LINEAR, 0), KdFit(SETUP, LINEAR, 0)
    few.learn_from(make_samples(500, 1))
    many.learn_from(make_samples(2000, 1))
    trained = is_trained(few.examples)
    assert (trained == is_trained(many.examples)[:500]).all()
    # A fifth of 500; binomial deviation 9.
    assert abs(trained.sum() - 400) < 36


def test_locate_is_the_op_of_the_graph():
    partition = Partition.of_box(-np.ones(3), np.ones(3))
    rng = np.random.default_rng(0)
    for _ in range(40):
        partition.split(int(rng.integers(len(partition))), int(rng.integers(3)))
    position = make_query(3000, 3).position
    b = Builder(position=3)
    leaf = b.tree("position", partition.rows, partition.levels)
    found = evaluate(b.build(segment=leaf), {"position": position})["segment"][:, 0]
    assert (found == partition.locate(position)).all()
    inside = (position >= partition.low[found.astype(int)]) & (position < partition.high[found.astype(int)])
    assert inside.all() and partition.depth.max() == partition.levels


def test_published_sizes():
    report, ren = (KdFit(SETUP, PRESETS[name], 0) for name in ("report", "ren"))
    assert (report.mlp.sizes, report.macs) == ((12, 20, 10, 3), 470)
    assert (ren.mlp.sizes, ren.macs) == ((15, 20, 10, 3), 530)
    assert sum(v.size for v in report.weights.values()) == 503 and sum(v.size for v in ren.weights.values()) == 563
