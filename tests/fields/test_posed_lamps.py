"""The field of the lamps where something moves: shares add and are never negative in any pose, at the price of one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lightwell.fields.surface.lamp_samples import LampSamples
from lightwell.fields.surface.pose_basis import MOST_BASES, pose_basis
from lightwell.fields.surface.posed_lamps import PosedLampsFit, pose_order
from lightwell.graph import Builder, evaluate
from lightwell.scenes.movers import pose_nodes
from tests.fields.test_lamps_field import PRESET, SETUP, fitted, radiance, samples

POSES = pose_nodes(5)


def moving(groups: int, poses: np.ndarray = POSES, seed: int = 0) -> LampSamples:
    """The cube of lamps, pose by pose; the slider dims the first lamp to nothing."""
    rows = 320 * len(poses)
    still, pose = samples(groups, rows, seed), np.repeat(poses, 320, axis=0).astype(np.float32)
    light = still.half_a.copy()
    light[:, 0] *= pose[:, :1]
    query = replace(still.query, pose=pose, rest_position=still.query.position, rest_normal=still.query.normal)
    return replace(still, query=query, half_a=light, half_b=light)


def learned(groups: int, steps: int, poses: np.ndarray = POSES, setup=SETUP) -> PosedLampsFit:
    fit = PosedLampsFit(replace(setup, movers=poses.shape[1]), PRESET, tuple(f"lamp {k}" for k in range(groups)), 0)
    fit.learn_from(moving(groups, poses))
    fit.validate_on(moving(groups, poses, seed=1))
    fit.train(steps, steps)
    return fit


@pytest.fixture(scope="module")
def three() -> PosedLampsFit:
    return learned(3, 300)


def at(query, pose):
    """The query in one pose."""
    return replace(query, pose=np.full_like(query.pose, pose))


def alone(k: int, groups: int = 3) -> np.ndarray:
    return np.eye(groups)[k][:, None] * np.ones(3)


def test_shares_add_and_are_never_negative_in_any_pose(three):
    graph, query = three.lower(), moving(3, seed=2).query[::29]
    tint = np.array([[1.0, 0.5, 0.0], [0.3, 0.3, 0.3], [0.0, 2.0, 1.0]])
    for pose in np.random.default_rng(4).random(6):
        shares = [radiance(graph, at(query, pose), alone(k)) for k in range(3)]
        assert min(share.min() for share in shares) >= 0
        together = radiance(graph, at(query, pose), tint)
        np.testing.assert_allclose(together, sum(a * t for a, t in zip(shares, tint)), rtol=1e-4, atol=1e-7)


def test_the_graph_is_the_network_at_poses_and_dimmers(three):
    graph, query = three.lower(), moving(3, seed=2).query[:320]
    for pose, dimmers in ((0.0, (1, 0, 0)), (0.23, (0.5, 1, 2)), (0.8, (0, 0, 3)), (1.0, (1, 1, 1))):
        rows = three.rows(at(query, pose))
        states = np.kron((np.array([dimmers]) * three.units).T, np.eye(3)).astype(np.float32)
        network = three.network.evaluate(three.trainer.best, (*rows, states))
        shown = radiance(graph, at(query, pose), np.array(dimmers)[:, None] * np.ones(3))
        # Weights are stored as 8 and 16 bits.
        assert np.abs(shown - network).max() < 0.03 * network.max(), pose


def test_a_lamp_that_the_slider_shuts_is_dark_and_the_others_are_not(three):
    graph, held_out = three.lower(), moving(3, seed=2)
    light = lambda k, pose: radiance(graph, at(held_out.query[::7], pose), alone(k)).mean()  # noqa: E731
    assert light(0, 0.0) < 0.03 * light(0, 1.0)
    assert abs(light(0, 0.5) / light(0, 1.0) - 0.5) < 0.1
    assert abs(light(1, 0.0) / light(1, 1.0) - 1) < 0.1
    facts = three.facts
    assert facts["pose_bases"] == 5 and max(facts["error_of_each_lamp"].values()) < 0.3


def test_a_pixel_costs_what_it_costs_without_a_mover():
    still, one, more = fitted(3, 2).lower(), learned(1, 2), learned(9, 2)
    assert still.macs == one.lower().macs == more.lower().macs
    # A lamp more is a layer of 24 features in each base, and nothing else.
    assert more.lower().nbytes - one.lower().nbytes == 8 * 5 * 24 * 3 * 2


def test_rows_are_trained_in_runs_of_one_pose():
    pose = np.repeat([[0.0], [0.5], [1.0]], [200, 130, 70], axis=0)
    order = pose_order(pose, 1)
    assert len(order) == 192 + 128 + 64 and len(set(order)) == len(order)
    assert (pose[order].reshape(-1, 64) == pose[order].reshape(-1, 64)[:, :1]).all()


@pytest.mark.parametrize("poses, bases", [(8, 8), (16, 16), (32, 16)])
def test_one_mover_has_a_base_for_each_traced_pose_up_to_sixteen(poses, bases):
    assert pose_basis(pose_nodes(poses)).count == bases <= MOST_BASES


@pytest.mark.parametrize("movers, poses, bases", [(1, 8, 8), (2, 8, 4), (2, 32, 16), (3, 12, 8), (3, 96, 8)])
def test_bases_are_never_negative_and_sum_to_one(movers, poses, bases):
    basis, b = pose_basis(pose_nodes(poses, movers)), Builder(pose=movers)
    graph = b.build(basis=basis.add(b))
    pose = np.concatenate([np.random.default_rng(3).random((500, movers)), pose_nodes(poses, movers)])
    found = evaluate(graph, {"pose": pose.astype(np.float32)})["basis"]
    assert found.shape[1] == basis.count == bases and found.min() >= 0
    np.testing.assert_allclose(found.sum(axis=1), 1, atol=1e-5)
    # The first one at the first end stops, the last one at the last.
    stops = evaluate(graph, {"pose": np.array([[0.0] * movers, [1.0] * movers], np.float32)})["basis"]
    np.testing.assert_allclose(stops, np.eye(bases)[[0, -1]], atol=1e-6)


def test_two_movers_are_learned():
    fit = learned(2, 20, pose_nodes(8, 2))
    query = moving(2, pose_nodes(8, 2), seed=2).query[:64]
    assert np.isfinite(radiance(fit.lower(), query, np.ones((2, 3)))).all()


def test_the_same_seed_gives_the_same_graph():
    first, second = learned(2, 8).lower(), learned(2, 8).lower()
    assert all(np.array_equal(first.buffers[name].array, second.buffers[name].array) for name in first.buffers)
