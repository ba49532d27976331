"""The field of the scene's own lamps: shares add, are never negative; their number changes no pixel's cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_up import make_samples

from lightwell.fields.base import WHITE, FieldSetup, query_inputs, to_learn, usual_level
from lightwell.fields.surface import lamps
from lightwell.fields.surface.lamp_samples import LampSamples
from lightwell.graph import evaluate
from lightwell.networks.hashgrid import HashGrid
from lightwell.transport.samples import Query

SETUP = FieldSetup((0.0, 1.0, 0.0), 1.0, 0.5, "static", (2.0, 2.0, 2.0), False)
PRESET = replace(
    lamps.PRESETS["draft"],
    grid=HashGrid(levels=2, base=4, growth=2, entries_log2=10),
    hidden=(16, 24),
    training=replace(lamps.PRESETS["draft"].training, batch=512),
)


def samples(groups: int, rows: int = 2048, seed: int = 0) -> LampSamples:
    """A cube with lamps at random places; the last one is a thousand times as dim as the first."""
    rng = np.random.default_rng(seed)
    unit = (v := rng.standard_normal((rows, 3))) / np.linalg.norm(v, axis=1, keepdims=True)
    position = rng.uniform((-1, 0, -1), (1, 2, 1), (rows, 3))
    reflectance = rng.uniform(0.2, 0.8, (rows, 3))
    columns = (position, unit, unit, np.zeros((rows, 3)), reflectance)
    query = Query(
        *(np.asarray(a, np.float32) for a in columns),
        np.full((rows, 1), 0.5, np.float32),
        np.zeros((rows, 1), np.float32),
    )
    places = np.random.default_rng(9).uniform((-1, 0, -1), (1, 2, 1), (groups, 3))
    power = np.geomspace(1, 1e-3, groups)[:, None] if groups > 1 else np.ones((1, 1))
    distance = ((position[:, None] - places) ** 2).sum(axis=2, keepdims=True)
    light = (power * reflectance[:, None] / (0.3 + distance)).astype(np.float32)
    return LampSamples(query, light, light, np.zeros(rows, np.uint32))


def fitted(groups: int, steps: int = 250) -> lamps.LampsFit:
    fit = lamps.LampsFit(SETUP, PRESET, tuple(f"lamp {k}" for k in range(groups)), 0)
    fit.learn_from(samples(groups))
    fit.validate_on(samples(groups, 512, seed=1))
    fit.train(steps, steps)
    return fit


@pytest.fixture(scope="module")
def three() -> lamps.LampsFit:
    return fitted(3)


def radiance(graph, query: Query, dimmers: np.ndarray) -> np.ndarray:
    """[N, 3] for dimmers [K, 3]."""
    inputs = {name: value for name, value in query_inputs(query).items() if name in graph.inputs}
    inputs["lamps"] = np.tile(np.asarray(dimmers, np.float32).T.reshape(1, -1), (len(query), 1))
    return evaluate(graph, inputs)["radiance"]


def test_light_of_lamps_adds_up_and_is_never_negative(three):
    graph, query = three.lower(), samples(3, 64, seed=2).query
    alone = [radiance(graph, query, np.eye(3)[k][:, None] * np.ones(3)) for k in range(3)]
    assert min(a.min() for a in alone) >= 0
    tint = np.array([[1.0, 0.5, 0.0], [0.3, 0.3, 0.3], [0.0, 2.0, 1.0]])
    together = radiance(graph, query, tint)
    np.testing.assert_allclose(together, sum(a * t for a, t in zip(alone, tint)), rtol=1e-4, atol=1e-7)


def test_every_lamp_is_learned_also_a_dim_one(three):
    graph, held_out = three.lower(), samples(3, 512, seed=2)
    for k in range(3):
        share = radiance(graph, held_out.query, np.eye(3)[k][:, None] * np.ones(3)) * held_out.query.reflectance
        wanted = held_out.radiance[:, k]
        assert np.mean(np.abs(share - wanted)) < 0.25 * wanted.mean(), f"lamp {k}"


def test_a_pixel_costs_the_same_for_any_number_of_lamps(three):
    one, sixteen = fitted(1, 2).lower(), fitted(16, 2).lower()
    assert one.macs == three.lower().macs == sixteen.macs
    # The layers of fifteen more lamps, and nothing else.
    assert sixteen.nbytes - one.nbytes < 15 * 1000


def test_facts_name_the_error_of_each_lamp(three):
    facts = three.facts
    assert list(facts["error_of_each_lamp"]) == ["lamp 0", "lamp 1", "lamp 2"]
    assert 0 < facts["error_of_random_lamps"] < 1


def test_the_same_seed_gives_the_same_graph():
    first, second = fitted(2, 8).lower(), fitted(2, 8).lower()
    assert all(np.array_equal(first.buffers[name].array, second.buffers[name].array) for name in first.buffers)


def test_the_usual_level_is_that_of_the_room_not_of_the_wall_beside_the_lamp():
    room = np.random.default_rng(0).lognormal(0, 0.5, 10_000)
    with_spot = np.where(np.arange(10_000) < 10, 20_000, room)
    level, other = usual_level(room), usual_level(with_spot)
    assert with_spot.mean() > 15 * room.mean() and other < 2 * level and level == pytest.approx(1.1, rel=0.2)
    # A lamp that lights a twentieth of the scene is looked at where it shines.
    local = np.where(np.arange(10_000) < 500, room, 0)
    assert usual_level(local) == pytest.approx(level, rel=0.2) and usual_level(np.zeros(4)) == 0
    both = usual_level(np.stack([room, local], axis=1), np.ones(10_000))
    assert np.allclose(both, [level, usual_level(local)], rtol=1e-6)


def test_no_more_of_own_light_is_learned_than_is_white():
    samples = replace(make_samples(2, 1), half_a=np.float32([[1, 2, 3], [500, 5, 1000]]))
    limited = to_learn(samples, "static", 2.0)
    assert limited.half_a.tolist() == [[1, 2, 3], [2 * WHITE, 5, 2 * WHITE]]
    assert np.array_equal(limited.half_b, np.minimum(samples.half_b, 2 * WHITE))
    assert to_learn(samples, "indirect", 2.0) is samples
