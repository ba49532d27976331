"""The mlp field: what it ships equals what it learned, costs what it says, and learns a light that is known."""

import numpy as np
import pytest

from lightwell.core.formats import ARRAYS
from lightwell.fields.base import FieldSetup, query_inputs
from lightwell.fields.registry import BUILT_IN, check_preset, find_field
from lightwell.fields.surface.mlp import PRESETS, MlpFit, MlpPreset
from lightwell.graph import evaluate
from lightwell.networks import TrainingSettings
from lightwell.networks.checkpoint import restore
from lightwell.transport.samples import Query, Samples

SETUP = FieldSetup((0.0, 0.0, 0.0), 1.0, 0.5, "point")


def _unit(v):
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def _samples(count: int, seed: int, noise: float = 0.0) -> Samples:
    """A smooth made-up indirect light: albedo times a fall-off with the distance to the light."""
    rng = np.random.default_rng(seed)
    position, light = rng.uniform(-1, 1, (2, count, 3))
    normal = _unit(rng.standard_normal((count, 3)))
    view = _unit(normal + 0.5 * _unit(rng.standard_normal((count, 3))))
    reflectance = rng.uniform(0.1, 0.9, (count, 3))
    light_field = 0.1 + 0.3 / (1 + ((light - position) ** 2).sum(1, keepdims=True))
    truth = reflectance * light_field
    a, b = (truth * rng.gamma(1 / noise, noise, (count, 1)) if noise else truth for _ in range(2))
    columns = [position, normal, view, light, reflectance, np.full((count, 1), 0.6), np.zeros((count, 1))]
    query = Query(*(np.asarray(c, np.float32) for c in columns))
    ones, zeros = np.ones(count, np.float32), np.zeros(count, np.uint32)
    return Samples(query, a.astype(np.float32), b.astype(np.float32), ones, zeros)


def _fit(preset: MlpPreset, steps: int = 150, setup: FieldSetup = SETUP, noise: float = 0.0) -> MlpFit:
    fit = MlpFit(setup, preset, 0)
    fit.learn_from(_samples(8192, 1, noise))
    fit.validate_on(_samples(512, 2))
    fit.train(steps, steps)
    return fit


QUICK = MlpPreset((16, 16), training=TrainingSettings(batch=1024, rate=1e-2, evaluate_every=50), storage="float32")


@pytest.fixture(scope="module")
def quick():
    return _fit(QUICK)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_what_ships_is_what_was_learned(name):
    """Untrained weights do: lowering must not depend on their values."""
    preset = PRESETS[name]
    fit = MlpFit(SETUP, preset, 3)
    query = _samples(64, 4).query
    shipped = evaluate(fit.lower(), query_inputs(query))["radiance"] * query.reflectance
    learned = fit.predict(query)
    # Half-precision weights (11 bits) over a few layers: 1 % of the value, or of the unit where it is small.
    np.testing.assert_allclose(shipped, learned, rtol=1e-2, atol=1e-2 * SETUP.unit)


def test_full_precision_ships_exactly(quick):
    query = _samples(256, 5).query
    shipped = evaluate(quick.lower(), query_inputs(query))["radiance"] * query.reflectance
    np.testing.assert_allclose(shipped, quick.predict(query), rtol=2e-4, atol=1e-5)


def test_it_learns(quick):
    test = _samples(2048, 6)
    f, y = quick.predict(test.query) / SETUP.unit, test.radiance / SETUP.unit
    assert np.mean(np.abs(f - y) / (y + 0.01)) < 0.1


def test_noisy_targets_do_not_darken_it():
    """One-sided noise of 100 %: the default loss keeps the energy, the report's loses it."""
    test = _samples(2048, 7)
    ratio = {}
    for loss in ("relative2", "relative"):
        training = TrainingSettings(loss=loss, batch=1024, rate=1e-2, evaluate_every=50)
        fit = _fit(MlpPreset((16, 16), training=training), 300, noise=2.0)
        ratio[loss] = fit.predict(test.query).mean() / test.radiance.mean()
    # Sampling error of 8,192 targets of standard deviation 1 is 1 %; the median of this noise is 0.7 of its mean.
    assert ratio["relative2"] == pytest.approx(1.0, abs=0.06)
    assert ratio["relative"] < 0.85


def test_macs_of_the_report():
    assert MlpFit(SETUP, PRESETS["report-20"], 0).macs == 470
    assert MlpFit(SETUP, PRESETS["report-200"], 0).macs == 22_700


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_the_graph_counts_the_same_macs(name):
    fit = MlpFit(SETUP, PRESETS[name], 0)
    graph = fit.lower()
    # The graph also counts the few products of its geometry (dot products, lengths).
    assert fit.macs <= graph.macs <= fit.macs + 40


def test_the_light_runs_once_per_frame():
    graph = MlpFit(SETUP, PRESETS["default"], 0).lower()
    assert graph.macs_per_frame > 0


@pytest.mark.parametrize("light", ["point", "sun", "static"])
def test_every_kind_of_light(light):
    fit = MlpFit(FieldSetup((0, 0, 0), 1.0, 1.0, light), QUICK, 0)
    query = _samples(8, 8).query
    assert fit.predict(query).shape == (8, 3)
    assert evaluate(fit.lower(), query_inputs(query))["radiance"].shape == (8, 3)


def test_resume(tmp_path, quick):
    whole = _fit(QUICK, 100)
    part = MlpFit(SETUP, QUICK, 0)
    part.learn_from(_samples(8192, 1))
    part.validate_on(_samples(512, 2))
    part.train(50, 100)
    ARRAYS.write(tmp_path / "fit.npz", part.arrays())
    again = MlpFit(SETUP, QUICK, 0)
    again.learn_from(_samples(8192, 1))
    again.validate_on(_samples(512, 2))
    restore(again, ARRAYS.read(tmp_path / "fit.npz"))
    again.train(100, 100)
    query = _samples(64, 9).query
    assert (whole.predict(query) == again.predict(query)).all()


def test_later_samples_replace_earlier_ones():
    fit = MlpFit(SETUP, QUICK, 0)
    fit.learn_from(_samples(100, 1))
    fit.learn_from(_samples(50, 2))
    fit.validate_on(_samples(50, 3))
    fit.train(1, 1)
    assert fit.state.samples_seen == 50


def test_unknown_names_say_what_exists():
    with pytest.raises(ValueError, match=r"unknown field 'mpl'; did you mean 'mlp'\?"):
        find_field("mpl")
    with pytest.raises(ValueError, match=r"has no preset 'best'; choose one of default"):
        check_preset("mlp", "best")
    assert all(find_field(name).name == name and "default" in find_field(name).presets for name in BUILT_IN)
