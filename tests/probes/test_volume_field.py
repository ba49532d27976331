"""The field ``volume``: its graph means its prediction, light scales, and it leaks less than trilinear weights."""

from dataclasses import replace

import numpy as np
import pytest
from leak_scenes import two_rooms

from lightwell.fields.base import FieldSetup
from lightwell.fields.volume.fit import PRESETS, VolumeFit, solved
from lightwell.graph import evaluate
from lightwell.probes import sh
from lightwell.probes.samples import ProbeSampling
from lightwell.probes.split.volume import query
from lightwell.probes.trace import air_light
from lightwell.scenes import load
from lightwell.scenes.variables import declare
from lightwell.transport.samples import Query, Samples

TINY = replace(
    PRESETS["draft"], states=6, rank=3, sampling=ProbeSampling(4, 16, 16), static_sampling=ProbeSampling(8, 64, 64)
)
SPACING = 0.6


@pytest.fixture(scope="module")
def moving():
    scene = load("two-rooms")
    variable = declare((), scene)
    setup = FieldSetup.of(scene, 2.0, variable.kind, variable)
    fit = VolumeFit(setup, TINY, 3, solved(setup, TINY, 3, SPACING))
    fit.learn_from(even_light())
    fit.validate_on(even_light())
    fit.train(40, 40)
    return fit


@pytest.fixture(scope="module")
def lit():
    """S1: two rooms of contrast 1000 without a door, under their own lamps."""
    setup = FieldSetup.of(two_rooms(0.05).scene, 1.0, "static")
    return setup, VolumeFit(setup, TINY, 3, solved(setup, TINY, 3, SPACING))


def even_light(count: int = 300) -> Samples:
    """Samples of a light that is the same everywhere: the network of the factors has something to learn."""
    (x, n), rng = places(count), np.random.default_rng(4)
    light = rng.uniform([-2, 1, -1], [2, 2, 1], (count, 3)).astype(np.float32)
    one = np.ones((count, 3), np.float32)
    query = Query(x, n, n, light, one, one[:, :1], 0 * one[:, :1])
    return Samples(query, 0.1 * one, 0.1 * one, one[:, 0], np.zeros(count, np.uint32))


def places(count: int = 300):
    rng = np.random.default_rng(0)
    n = rng.standard_normal((count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    x = rng.uniform([-2.5, 0.3, -1.5], [2.5, 2.2, 1.5], (count, 3))
    return x.astype(np.float32), n.astype(np.float32)


def test_the_graph_means_the_prediction(moving):
    asked = even_light().query
    inputs = {"position": asked.position, "normal": asked.normal, "light": asked.light}
    found, expected = evaluate(moving.lower(), inputs)["radiance"], moving.predict(asked)
    assert expected.max() > 0 and np.abs(found - expected).max() < 0.02 * expected.max()


def test_the_report_tells_of_the_volume(moving):
    facts = moving.facts
    assert facts["bases"] == 3 and facts["features"] == 24 and 0 < facts["error_in_the_air"] < 0.5
    assert facts["bytes"]["features"] == facts["nodes"] * 26 and facts["cells_with_a_wall"] > 0


def test_the_same_seed_gives_the_same_bytes(moving):
    made = moving.volume
    assert solved(moving.setup, TINY, 3, SPACING)[0] is made
    other = solved(replace(moving.setup, scene=load("two-rooms")), TINY, 3, SPACING)[0]
    assert other is not made and np.array_equal(other.features, made.features)
    assert np.array_equal(other.decoder, made.decoder)


def test_a_dark_room_stays_dark_beside_a_bright_one(lit):
    """Behind the wall of a room a thousand times brighter, light is that of the dark room to a tenth."""
    setup, fit = lit
    rng = np.random.default_rng(1)
    x = rng.uniform([0.03, 0.2, 0.2], [0.25, 2.4, 2.8], (60, 3)).astype(np.float32)
    n = np.tile(np.float32([1, 0, 0]), (len(x), 1))
    truth = np.maximum(sh.evaluate(air_light(setup.scene, x, 512, 9).sh, n), 0)
    found = query(fit.volume.in_air(), x, n)
    assert abs(found.sum() / truth.sum() - 1) < 0.1
    assert (found.sum(axis=1) < 2 * truth.sum(axis=1)).all()


def test_a_scene_is_needed():
    setup = FieldSetup((0.0, 0.0, 0.0), 1.0, 0.5, "static")
    with pytest.raises(ValueError, match=r"volume: the set-up has no scene; .* make it with FieldSetup.of"):
        solved(setup, TINY, 0)
