"""What every field of segments promises: what ships is what was learned, seeds repeat, kills are survived."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import SETUP, make_query, make_samples, relative_error

from lightwell.core.formats import ARRAYS
from lightwell.fields.base import FieldSetup, query_inputs
from lightwell.fields.registry import BUILT_IN, find_field
from lightwell.graph import evaluate, graph_from_json, graph_to_json
from lightwell.networks.checkpoint import restore
from lightwell.transport.samples import Samples

NAMES = [name for name in ("tree", "kdtree", "experts", "hard-mixture") if name in BUILT_IN]
# One preset of every kind of gate; the others differ in numbers.
KINDS = {"default", "report-code"}
CASES = [
    pytest.param((name, preset), id=f"{name}-{preset}", marks=() if preset in KINDS else pytest.mark.slow)
    for name in NAMES
    for preset in find_field(name).presets
]
STEPS = 24


def _quick(fit):
    """Looks at the validation set often, so that tests of few steps meet checkpoints."""
    if hasattr(fit.preset, "training"):
        fit.preset = replace(fit.preset, training=replace(fit.preset.training, evaluate_every=4))
    return fit


def _begin(name, preset, seed=0, count=3000, setup=SETUP):
    fit = _quick(find_field(name).start(setup, preset, seed))
    fit.learn_from(make_samples(count, 1))
    fit.validate_on(make_samples(500, 2))
    return fit


class Fits(dict):
    """(field, preset) → a fit, trained when it is first asked for."""

    def __missing__(self, case):
        self[case] = _begin(*case)
        self[case].train(STEPS, STEPS)
        return self[case]


@pytest.fixture(scope="module")
def fitted():
    return Fits()


@pytest.mark.parametrize("case", CASES)
def test_what_ships_is_what_was_learned(fitted, case):
    fit, query = fitted[case], make_query(2000, 4)
    graph = fit.lower()
    out = evaluate(graph, query_inputs(query))
    shipped, learned = out["radiance"] * query.reflectance, fit.predict(query)
    # Half-precision weights (11 bits) over a few layers; a gate that is rounded may choose another expert where two
    # are nearly equal.
    close = np.isclose(shipped, learned, rtol=2e-2, atol=1e-2 * SETUP.unit).all(axis=1)
    assert close.mean() > (0.98 if "experts" in case or "hard-mixture" in case else 0.999)
    assert graph.outputs.keys() == {"radiance", "segment"}
    # Only the geometry of the inputs is not in the field's own count.
    assert fit.macs <= graph.macs <= fit.macs + 40


@pytest.mark.parametrize("case", CASES)
def test_full_precision_ships_exactly(fitted, case):
    fit, query = fitted[case], make_query(2000, 5)
    half, fit.preset = fit.preset, replace(fit.preset, storage="float32")
    out = evaluate(fit.lower(), query_inputs(query))
    fit.preset = half
    shipped, learned = out["radiance"] * query.reflectance, fit.predict(query)
    close = np.isclose(shipped, learned, rtol=1e-3, atol=1e-4 * SETUP.unit).all(axis=1)
    # Inputs are computed by NumPy here and by Dr.Jit there: the last bit may carry a point over a border.
    assert close.mean() > 0.995


@pytest.mark.parametrize("case", CASES)
def test_the_file_holds_it(fitted, case):
    graph = fitted[case].lower()
    document, arrays = graph_to_json(graph)
    again = graph_from_json(document, arrays)
    query = query_inputs(make_query(100, 6))
    assert (evaluate(again, query)["radiance"] == evaluate(graph, query)["radiance"]).all()


@pytest.mark.parametrize("case", CASES)
def test_killed_and_resumed_ends_with_the_same_bits(fitted, case, tmp_path):
    path, part = tmp_path / "fit.npz", _begin(*case)
    kept = {}

    def checkpoint():
        # The process dies after the third checkpoint.
        if len(kept) < 3:
            ARRAYS.write(path, part.arrays())
            kept[part.state.step] = True

    part.train(STEPS, STEPS, checkpoint=checkpoint)
    again = _begin(*case)
    restore(again, ARRAYS.read(path))
    assert again.state.step == list(kept)[-1] or case[0] == "tree"
    if again.state.step < STEPS:
        again.train(STEPS, STEPS)
    query = make_query(500, 7)
    assert (again.predict(query) == fitted[case].predict(query)).all()
    assert again.facts == fitted[case].facts
    assert again.state == fitted[case].state


@pytest.mark.parametrize("name", [NAMES[0], *(pytest.param(name, marks=pytest.mark.slow) for name in NAMES[1:])])
def test_it_learns(name):
    fit = find_field(name).start(SETUP, "default", 0)
    fit.learn_from(make_samples(20_000, 1, noise=0.3))
    fit.validate_on(make_samples(500, 2))
    test = make_samples(1000, 3)
    fit.train(300, 300)
    # The mean as a constant scores 0.5.
    assert relative_error(fit, test) < (0.25 if name == "tree" else 0.08)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("light", ["sun", "static"])
def test_every_kind_of_light(name, light):
    fit = _begin(name, "default", setup=FieldSetup((0, 0, 0), 1.0, 0.5, light), count=600)
    fit.train(4, 4)
    query = make_query(8, 8)
    assert np.isfinite(fit.predict(query)).all()
    assert evaluate(fit.lower(), query_inputs(query))["radiance"].shape == (8, 3)


@pytest.mark.parametrize("name", NAMES)
def test_more_samples_can_come(name):
    """As the bake does it: train a part, replace the samples by more of them, train on."""
    fit = _begin(name, "default")
    fit.train(8, STEPS)
    more = make_samples(6000, 9)
    fit.learn_from(more)
    fit.train(STEPS, STEPS)
    assert fit.state.step == STEPS
    assert np.isfinite(fit.predict(make_query(10, 1))).all()


@pytest.mark.parametrize("name", NAMES)
def test_broken_targets_are_dropped_and_counted(name):
    samples = make_samples(3000, 1)
    samples.half_a[5] = np.nan
    samples.half_b[7, 1] = np.inf
    fit = _begin(name, "default")
    fit.learn_from(samples)
    fit.train(4, 4)
    assert fit.facts["dropped_samples"] == 2
    assert np.isfinite(fit.predict(make_query(100, 1))).all()


@pytest.mark.parametrize("name", NAMES)
def test_nothing_but_broken_targets_is_refused(name):
    samples = make_samples(10, 1)
    samples.half_a[:] = np.nan
    with pytest.raises(ValueError, match="none of 10 samples has a finite target"):
        find_field(name).start(SETUP, "default", 0).learn_from(samples)


@pytest.mark.parametrize("name", NAMES)
def test_few_samples_do(name):
    """Fewer samples than experts, batches or weights: nothing fails."""
    fit = _begin(name, "default", count=7)
    fit.train(8, 8)
    assert np.isfinite(fit.predict(make_query(100, 1))).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_checkpoint_of_another_fit_is_refused(name):
    fit = _begin(name, "default", count=50)
    broken = fit.arrays() | {"step": np.zeros(2)}
    with pytest.raises(ValueError, match=r"the checkpoint does not fit .*'step'"):
        restore(fit, broken)


@pytest.mark.parametrize("name", NAMES)
def test_samples_of_weight_zero_do_not_count(name):
    good, bad = make_samples(3000, 1), make_samples(3000, 1, lambda q: np.full((len(q), 3), 9.0))
    both = Samples(
        type(good.query)(*(a if a is None else np.concatenate([a, a]) for a in vars(good.query).values())),
        np.concatenate([good.half_a, bad.half_a]),
        np.concatenate([good.half_b, bad.half_b]),
        np.repeat(np.float32([1, 0]), 3000),
        np.zeros(6000, np.uint32),
    )
    fit = _begin(name, "default")
    fit.learn_from(both)
    fit.train(STEPS, STEPS)
    assert fit.predict(make_query(500, 3)).mean() < 1.0
