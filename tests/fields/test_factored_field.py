"""The factored field: what it ships is what it learned, for every kind of light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lightwell.core.formats import ARRAYS
from lightwell.fields.base import FieldSetup, is_matte, query_inputs
from lightwell.fields.features import GRID_MARGIN, mirrored_point, open_builder
from lightwell.fields.surface import factored
from lightwell.graph import evaluate
from lightwell.networks.checkpoint import restore
from lightwell.scenes.scene import Material
from lightwell.transport.samples import Query, Samples, columns_of

SETUP = FieldSetup((0.0, 1.0, 0.0), 1.0, 0.5, "point", (2.0, 2.0, 2.0), False)
RUN = 64


def samples(kind: str = "point", lights: int = 32, seed: int = 0) -> Samples:
    """A cube whose light falls off with the distance to the lamp."""
    rng = np.random.default_rng(seed)
    rows = lights * RUN
    unit = lambda n: (v := rng.standard_normal((n, 3))) / np.linalg.norm(v, axis=1, keepdims=True)  # noqa: E731
    position = rng.uniform((-1, 0, -1), (1, 2, 1), (rows, 3))
    light = unit(lights) if kind == "sun" else rng.uniform((-0.8, 0.2, -0.8), (0.8, 1.8, 0.8), (lights, 3))
    light = light.repeat(RUN, axis=0)
    reflectance = rng.uniform(0.2, 0.8, (rows, 3))
    query = Query(
        *(np.asarray(a, np.float32) for a in (position, unit(rows), unit(rows), light, reflectance)),
        np.full((rows, 1), 0.5, np.float32),
        np.zeros((rows, 1), np.float32),
    )
    radiance = (reflectance / (0.3 + ((position - light) ** 2).sum(axis=1, keepdims=True))).astype(np.float32)
    return Samples(query, radiance, radiance, np.ones(rows, np.float32), np.zeros(rows, np.uint32))


def fitted(setup: FieldSetup = SETUP, steps: int = 200, lights: int = 32) -> factored.FactoredFit:
    preset = factored.PRESETS["default"]
    preset = replace(preset, training=replace(preset.training, batch=16 * RUN))
    fit = factored.FactoredFit(setup, preset, 0)
    fit.learn_from(samples(setup.light, lights))
    fit.validate_on(samples(setup.light, 8, seed=1))
    fit.train(steps, steps)
    return fit


@pytest.mark.parametrize(
    ("light", "matte"),
    [
        ("point", False),
        ("sun", True),
        ("static", False),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in (("point", True), ("sun", False), ("static", True))),
    ],
)
def test_the_graph_is_what_was_learned(light, matte):
    fit = fitted(replace(SETUP, light=light, matte=matte), steps=20)
    graph, query = fit.lower(), samples(light, 4, seed=2).query
    inputs = {name: value for name, value in query_inputs(query).items() if name in graph.inputs}
    found = evaluate(graph, inputs)["radiance"] * query.reflectance
    predicted = fit.predict(query)
    # Bytes for the grid and the emitted layer, halves for the rest.
    np.testing.assert_allclose(found, predicted, rtol=0.05, atol=0.01 * predicted.mean())
    # Dot products and lengths of directions are counted in the graph alone.
    assert 0 <= graph.macs - fit.macs <= 18


def test_learns_how_light_falls_off():
    fit = fitted(steps=600, lights=512)
    assert fit.state.best_error < 0.1


def test_a_resumed_fit_ends_with_the_same_bytes(tmp_path):
    whole = fitted(steps=200)
    half = fitted(steps=1)
    half.train(100, 200)
    ARRAYS.write(tmp_path / "fit.npz", half.arrays())
    again = factored.FactoredFit(SETUP, half.preset, 0)
    again.learn_from(samples())
    again.validate_on(samples(lights=8, seed=1))
    restore(again, ARRAYS.read(tmp_path / "fit.npz"))
    again.train(200, 200)
    found = again.arrays()
    for name, value in whole.arrays().items():
        if name.startswith("value."):
            assert np.array_equal(value, found[name]), name


def test_runs_of_rows_are_those_of_their_indices():
    whole, order = samples(), np.random.default_rng(3).permutation(32)
    found, expected = whole.in_runs(order, RUN), whole[(order[:, None] * RUN + np.arange(RUN)).ravel()]
    for name, values in columns_of(expected.query).items():
        np.testing.assert_array_equal(getattr(found.query, name), values)
    for name in ("half_a", "half_b", "weight", "shape"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_a_broken_target_is_left_out():
    broken = samples()
    broken.half_a[7] = np.nan
    fit = factored.FactoredFit(SETUP, factored.PRESETS["default"], 0)
    fit.learn_from(broken)
    fit.validate_on(samples(lights=8, seed=1))
    fit.train(20, 20)
    assert np.isfinite(fit.predict(samples().query)).all()


def test_a_mirrored_ray_leaves_the_box_of_the_scene_where_it_does():
    setup = FieldSetup((1.0, 2.0, 0.5), 3.0, 0.5, "static", (6.0, 3.0, 2.0), False)
    b = open_builder()
    graph = b.build(point=mirrored_point(b, setup)).only("point")
    rng, rows = np.random.default_rng(3), 500
    unit = lambda: (v := rng.standard_normal((rows, 3))) / np.linalg.norm(v, axis=1, keepdims=True)  # noqa: E731
    half, normal, view = np.array(setup.size) / 2, unit(), unit()
    position = np.array(setup.center) + 0.95 * half * rng.uniform(-1, 1, (rows, 3))
    values = {"position": position, "normal": normal, "view": view}
    found = evaluate(graph, {name: values[name].astype(np.float32) for name in graph.inputs})["point"]
    r = 2 * (normal * view).sum(axis=1, keepdims=True) * normal - view
    times = ((np.sign(r) * half - (position - setup.center)) / r).min(axis=1, keepdims=True)
    scale = 0.5 / (GRID_MARGIN * setup.half_extent)
    wanted = 0.5 + scale * (position + times * r - setup.center)
    assert np.abs(found - wanted).max() < 0.02 and np.abs(found - wanted).mean() < 1e-3


def bumpy(lights: int, seed: int) -> Samples:
    """Light from above on surfaces whose normal maps are random."""
    flat, random = samples(lights=lights, seed=seed), np.random.default_rng(seed + 5)
    bent = flat.query.normal + 0.5 * random.standard_normal(flat.query.normal.shape)
    bent = (bent / np.linalg.norm(bent, axis=1, keepdims=True)).astype(np.float32)
    radiance = (flat.query.reflectance * (0.5 + 0.4 * bent[:, 1:2])).astype(np.float32)
    return replace(flat, query=replace(flat.query, shading_normal=bent), half_a=radiance, half_b=radiance)


def test_learned_light_follows_the_normal_maps():
    errors = []
    for relief in (False, True):
        fit = factored.FactoredFit(replace(SETUP, relief=relief), factored.PRESETS["default"], 0)
        fit.learn_from(bumpy(256, 0))
        fit.validate_on(bumpy(16, 1))
        fit.train(200, 200)
        errors.append(fit.state.best_error)
        assert ("shading_normal" in fit.lower().inputs) == relief
    assert errors[1] < 0.5 * errors[0]


def test_default_costs_at_most_fifteen_hundred_multiply_adds():
    fit = factored.FactoredFit(replace(SETUP, matte=True), factored.PRESETS["default"], 0)
    assert fit.macs <= 1200
    assert factored.FactoredFit(SETUP, factored.PRESETS["default"], 0).macs <= 1500
    assert fit.lower().nbytes <= 300_000
    assert factored.FactoredFit(SETUP, factored.PRESETS["default"], 0).lower().nbytes <= 300_000


@pytest.mark.parametrize("matte", [False, True])
@pytest.mark.parametrize("light", ["point", "sun"])
def test_two_fields_cost_together_less_than_twice_one(matte, light):
    graphs = [
        factored.FactoredFit(replace(SETUP, matte=matte, light=kind), factored.TWO_FIELDS[role], 0).lower()
        for role, kind in (("indirect", light), ("static", "static"))
    ]
    assert sum(graph.macs for graph in graphs) <= 1950
    assert sum(graph.nbytes for graph in graphs) <= 300_000


@pytest.mark.parametrize(
    "changes, expected",
    [
        ({}, True),
        ({"ior": 1.5}, False),
        ({"metallic": 1.0}, False),
        ({"clearcoat": 0.5}, False),
        ({"delta": True}, False),
    ],
)
def test_only_lambertian_surfaces_look_the_same_from_everywhere(changes, expected):
    assert is_matte(Material("wall", **{"metallic": 0.0, "ior": 1.0} | changes)) == expected
