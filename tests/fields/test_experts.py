"""Experts behind a gate: published sizes, shares, curves, borders, and what a hard mixture's loop promises."""

import json
from dataclasses import replace

import numpy as np
import pytest
from made_up import SETUP, make_query, make_samples

from lightwell.fields.surface import gate
from lightwell.fields.surface.experts import BORDER_SHARE, FIELD, PRESETS
from lightwell.fields.surface.hard_mixture import PRESETS as HARD_PRESETS
from lightwell.fields.surface.hard_mixture import HardMixtureFit
from lightwell.networks.autoencoder import GateTraining


def _fit(preset, steps=40, count=4000, **changes):
    fit = FIELD.start(SETUP, preset, 0)
    quick = GateTraining(epochs=2, most_updates=400)
    training = replace(fit.preset.training, evaluate_every=10)
    fit.preset = replace(fit.preset, training=training, gate_training=quick, **changes)
    fit.learn_from(make_samples(count, 1))
    fit.validate_on(make_samples(500, 2))
    fit.train(steps, steps)
    return fit


def test_published_sizes():
    fit = FIELD.start(SETUP, "report", 0)
    assert fit.mlp.macs == 470 and fit.gate.macs == 840 and fit.macs == 1310
    assert sum(v.size for v in fit.weights.values()) == 5030
    assert sum(v.size for v in fit.gate_weights.values()) == 890


def test_presets_of_the_report():
    text, code = PRESETS["report"], PRESETS["report-code"]
    assert (text.training.rate, text.training.tau, text.training.decay, text.training.loss) == (
        0.5,
        50,
        1e-4,
        "relative",
    )
    assert (code.training.rate, code.training.tau, code.training.decay, code.training.batch) == (0.5, 50, 1e-6, 16)
    assert (text.activation, code.activation, text.output) == ("tanh", "relu", "sigmoid")
    assert GateTraining().rate == 1.0 and GateTraining().tau == 30.0 and GateTraining().batch == 16


@pytest.mark.parametrize("preset", ["report", "report-joint", "report-multinomial"])
def test_facts_are_curves_that_json_holds(preset):
    facts = json.loads(json.dumps(_fit(preset).facts))
    curves = facts["curves"]
    assert curves["step"] == [10, 20, 30, 40]
    assert all(sum(share) == pytest.approx(1, abs=1e-2) for share in curves["share"])
    assert all(0 <= e <= np.log(10) + 1e-6 for e in curves["entropy"])
    assert ("gate_gradient_variance" in curves) == (preset != "report")
    assert sum(facts["share"]) == pytest.approx(1, abs=1e-2)


def test_no_expert_is_called_dead_that_has_samples():
    """The least share that is alive is a single sample of few; no sample at all is dead."""
    segment = np.repeat(np.arange(10), 100)
    assert gate.share_facts(segment, 10)["dead"] == []
    assert gate.share_facts(np.append(segment, 10), 11)["dead"] == []
    assert gate.share_facts(segment, 12)["dead"] == [10, 11]


def test_an_expert_without_samples_is_reported_and_harmless():
    fit = _fit("report", steps=0)
    # A gate that never chooses expert 3.
    fit.learn_gate()
    last = max(int(name[1:]) for name in fit.gate_weights)
    fit.gate_weights[f"b{last}"][0, 3] = -100.0
    fit.train(20, 20)
    assert 3 in fit.facts["dead"] and fit.facts["share"][3] == 0
    assert np.isfinite(fit.predict(make_query(500, 3))).all()


def test_the_gate_is_frozen_when_more_samples_come():
    fit = _fit("report", steps=10)
    before = {k: v.copy() for k, v in fit.gate_weights.items()}
    fit.learn_from(make_samples(6000, 5))
    fit.train(20, 20)
    assert all((fit.gate_weights[k] == v).all() for k, v in before.items())


def test_the_gate_of_default_sees_place_alone():
    fit, query = _fit("default"), make_query(500, 3)
    moved = replace(query, light=-query.light, view=query.view[::-1])
    assert (fit.segment(query) == fit.segment(moved)).all()


def test_borders_weigh_double():
    fit = _fit("report-border-boost", steps=1)
    rows = fit.gate_inputs.rows(fit.examples.query)
    border = fit.at_border(rows)
    assert border.mean() == pytest.approx(BORDER_SHARE, abs=0.01)
    weight = np.array(fit.training_set.weight).ravel()
    # Every run has mean 1, so that border and interior differ by two within it.
    first, count = fit.training_set.runs.first[0], fit.training_set.runs.count[0]
    levels = np.unique(np.round(weight[first : first + count], 5))
    assert len(levels) == 1 or levels[-1] / levels[0] == pytest.approx(2.0, rel=1e-3)
    assert np.array(_fit("report", steps=1).training_set.weight) == pytest.approx(1.0)


# --------------------------------------------------------------------- hard mixture


def _hard(steps=60, rounds=3, **changes):
    fit = HardMixtureFit(SETUP, replace(HARD_PRESETS["default"], rounds=rounds, **changes), 0)
    fit.learn_from(make_samples(3000, 1))
    fit.validate_on(make_samples(500, 2))
    fit.train(steps, steps)
    return fit


def test_the_first_split_is_even_and_random():
    fit = _hard(steps=0)
    assert np.bincount(fit.assignment()).tolist() == [300] * 10


def test_reassignment_keeps_the_cap():
    fit = _hard(margin=0.1)
    assert len(fit.facts["rounds"]) == 3
    assert np.bincount(fit.assignment(), minlength=10).max() <= 330
    assert fit.facts["rounds"][0]["moved"] > 0.5


def test_it_stops_when_rounds_no_longer_help():
    fit = HardMixtureFit(SETUP, replace(HARD_PRESETS["default"], rounds=100, patience_rounds=1), 0)
    noise = make_samples(1000, 1, lambda q: np.random.default_rng(len(q)).exponential(0.3, (len(q), 3)))
    fit.learn_from(noise)
    fit.validate_on(make_samples(300, 2))
    assert fit.train(600, 600) and fit.state.step < 600


def test_the_gate_prefers_the_better_expert():
    """Two frozen experts, one right on the left and one on the right: the gate finds the border."""
    frozen = replace(HARD_PRESETS["default"].training, rate=0.0)
    preset = replace(HARD_PRESETS["default"], experts=2, gate_inputs="place", rounds=1, training=frozen)
    fit = HardMixtureFit(SETUP, preset, 0)
    arrays = fit.arrays()
    for name, value in arrays.items():
        if name.startswith("field.experts.value."):
            value[:] = 0
        if name == f"field.experts.value.b{fit.mlp.layers - 1}":
            # The output is e^bias: 0.2 and 0.8 of the unit.
            value[0], value[1] = np.log(0.2), np.log(0.8)
    left = lambda q: SETUP.unit * q.reflectance * np.where(q.position[:, :1] < 0, 0.2, 0.8)  # noqa: E731
    fit.learn_from(make_samples(4000, 1, left))
    fit.validate_on(make_samples(300, 2, left))
    fit.restore(arrays)
    # One round: two thirds of the steps are the experts', 150 the gate's.
    fit.train(450, 450)
    weights = fit.gate_weights
    query = make_query(2000, 3)
    chosen = gate.choose(fit.gate, weights, fit.gate_inputs.rows(query))
    # 150 steps of a gate with 20 soft units: the border is not yet straight.
    assert (chosen == (query.position[:, 0] >= 0)).mean() > 0.9
