"""Rows that stay with their light."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.networks import Trainer, TrainingSettings
from lightwell.networks.factored import FactoredNetwork
from lightwell.networks.hashgrid import HashGrid
from lightwell.networks.light_major import LightMajorSet, light_runs

RUN, LIGHTS = 32, 40
NETWORK = FactoredNetwork(
    HashGrid(levels=2, base=4, entries_log2=9), pixel=2, frame=3, light_hidden=(16,), hidden=(12, 8)
)


@pytest.fixture
def data() -> LightMajorSet:
    rng = np.random.default_rng(0)
    rows = RUN * LIGHTS
    points, pixel, frame = rng.random((rows, 3)), rng.random((rows, 2)), rng.random((LIGHTS, 3))
    # Something that needs point and light together.
    target = 0.2 + (points * frame.repeat(RUN, axis=0)).sum(axis=1, keepdims=True) * np.array([[1.0, 0.5, 0.2]])
    return LightMajorSet.of(points, pixel, frame, target, np.ones((rows, 1)))


def test_runs_are_found():
    light = np.random.default_rng(0).random((LIGHTS, 3)).repeat(RUN, axis=0)
    assert light_runs(light) == RUN
    assert light_runs(light[:-1]) == 1
    light[5] += 1
    assert light_runs(light) == 1
    # Two neighbours that happen to share a light do not make longer runs.
    assert light_runs(np.array([0, 0, 0, 0, 1, 1])[:, None] * np.ones(3)) == 2


def test_a_batch_brings_the_lights_of_its_rows(data):
    frames = np.array(data.frame)
    start = (LIGHTS - 2) * RUN
    (points, _, frame), target, weight = data.rows(dr.opaque(mi.UInt32, start), 4 * RUN)
    wanted = [LIGHTS - 2, LIGHTS - 1, 0, 1]
    assert np.array_equal(np.array(frame), frames[wanted])
    rows = np.concatenate([np.arange(k * RUN, (k + 1) * RUN) for k in wanted])
    assert np.array_equal(np.array(points), np.array(data.points)[rows])
    assert np.array_equal(np.array(target), np.array(data.target)[rows])
    assert weight.shape == (4 * RUN, 1)


def test_a_network_of_the_light_learns_and_repeats_to_the_bit(data):
    settings = TrainingSettings(rate=2e-2, batch=8 * RUN, evaluate_every=100)
    inputs = (np.array(data.points), np.array(data.pixel), np.array(data.frame))
    truth = np.array(data.target)
    weights = []
    for _ in range(2):
        trainer = Trainer(NETWORK, settings, 3)
        error = lambda p: float(np.mean(np.abs(NETWORK.evaluate(p, inputs) - truth) / (truth + 0.01)))  # noqa: E731
        before = error(trainer.best)
        trainer.fit(data, error, 300, 300)
        assert trainer.state.best_error < 0.1 * before
        weights.append(trainer.parameters)
    assert all(np.array_equal(weights[0][name], weights[1][name]) for name in weights[0])
