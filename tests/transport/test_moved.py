"""Samples of a scene with a mover: each knows its pose, and where its surface is at rest."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.scenes import load
from lightwell.scenes.movers import pose_nodes
from lightwell.scenes.posing import declared_movers, posed, with_movers
from lightwell.scenes.variables import PointLight
from lightwell.transport import draw_surface, static
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.moved import at_pose
from lightwell.transport.own_light_shards import OwnLightShards
from lightwell.transport.posed_shards import PosedShards, next_poses
from lightwell.transport.queries import make_query
from lightwell.transport.samples import Query, Samples, SurfacePoints
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings

LIGHT = PointLight((-2.2, 0.4, -1.0), (2.2, 2.0, 1.0), 0.1)
SMALL = ShardSettings(paths=2, lights=16, points_per_light=32, floor=1)
SLIDERS = [0.0, 1.0]


@pytest.fixture(scope="module")
def scene():
    plain = load("doorway")
    return with_movers(plain, declared_movers(["node:Door.rotation=y:0..90"], plain))


def joined(parts):
    names = ("shape", "triangle", "barycentric", "view", "pose")
    return SurfacePoints(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def test_queries_are_those_of_each_pose_and_know_where_the_surface_rests(scene):
    drawn = [at_pose(draw_surface(posed(scene, (t,)), 256, 1, floor=32).points, (t,)) for t in (0.0, 0.5)]
    points = joined(drawn)[np.random.default_rng(0).permutation(512)]
    query, door = make_query(scene, points, np.zeros(3)), np.isin(points.shape, scene.movers[0].moving_meshes)
    for t in (0.0, 0.5):
        rows = np.flatnonzero(points.pose[:, 0] == t)
        alone = make_query(posed(scene, (t,)), points[rows], np.zeros(3))
        assert np.array_equal(query.position[rows], alone.position) and np.array_equal(query.normal[rows], alone.normal)
    assert np.array_equal(query.pose, points.pose)
    assert np.array_equal(query.rest_position[~door], query.position[~door])
    # At rest the leaf is 4 cm thick on the wall of the dark room.
    assert door.sum() > 15 and np.ptp(query.position[door, 0]) > 0.3
    assert np.all((query.rest_position[door, 0] > 0.049) & (query.rest_position[door, 0] < 0.091))
    assert np.allclose(np.linalg.norm(query.rest_normal, axis=1), 1, atol=1e-5)


def test_light_is_traced_in_the_pose_of_each_point(scene):
    dark = draw_surface(posed(scene, (0.5,)), 2048, 3, floor=0).points
    rows = np.flatnonzero(make_query(posed(scene, (0.5,)), dark, np.zeros(3)).position[:, 0] > 0.2)
    still = dark[rows][np.flatnonzero(~np.isin(dark.shape[rows], scene.movers[0].moving_meshes))][np.arange(128)]
    a, b = static(scene, joined([at_pose(still, (0.0,)), at_pose(still, (1.0,))]), 16, 5)
    shut, opened = (a + b)[:128].mean(), (a + b)[128:].mean()
    assert shut < 1e-3 * opened and opened > 0.01


@pytest.fixture(scope="module", params=[OwnLightShards, GatheredShards])
def shards(request, scene):
    """(what makes the shards of two poses, columns and counts of the first shard)."""
    size = lambda own: GatherSize(1 << 11, 1024, 64, rays=8)  # noqa: E731
    make = PosedShards(scene, LIGHT, SMALL, size, request.param, [(t,) for t in SLIDERS])
    return request.param, make, *make(scene, LIGHT, None, SMALL, 0)


def test_added_poses_take_as_long_as_a_pose_whose_rays_are_not_known(scene):
    # A second light finds the rays of the first poses; of eight poses two more are added.
    size = lambda own: GatherSize(1 << 11, 1024, 64, rays=8)  # noqa: E731
    sliders = [(t,) for t in pose_nodes(8)[:, 0]]
    maker = PosedShards(scene, LIGHT, SMALL, size, GatheredShards, sliders, pose_seconds=7.0)
    assert maker.before_adaptive == 14.0


def test_shards_have_as_many_rows_of_every_pose(scene, shards):
    kind, _, columns, counts = shards
    pose, half = columns["pose"][:, 0], SMALL.size // 2
    assert np.array_equal(pose, np.repeat(np.float32(SLIDERS), half)) and counts["paths"]["paths"] > 0
    door = np.isin(columns["shape"], scene.movers[0].moving_meshes)
    assert np.allclose(columns["rest_position"][~door], columns["position"][~door])
    assert (columns["rest_position"][door, 0] < 0.091).all()
    if kind is OwnLightShards:
        beyond = columns["position"][:, 0] > 0.3
        shut, opened = (columns["half_a"][beyond & (pose == t)].mean() for t in SLIDERS)
        # Few bins are large ones, some of which lie in both rooms.
        assert shut < 0.1 * opened


def test_poses_must_divide_the_lights(scene):
    with pytest.raises(ValueError, match="16 lights of a shard cannot be divided among 3 poses"):
        PosedShards(scene, LIGHT, SMALL, lambda own: GatherSize.of(1, own), OwnLightShards, [(0.0,), (0.5,), (1.0,)])


def test_poses_are_added_between_those_with_large_errors():
    known, errors = pose_nodes(8), np.full(8, 0.01)
    errors[3:5] = 1.0
    first, second, _ = (pose[0] for pose in next_poses(known, errors, 3))
    assert known[3, 0] < first < known[4, 0]
    assert known[2, 0] < second < known[5, 0] and abs(second - first) > 0.05
    # With one error for all, the widest gaps are filled.
    even = next_poses(known, np.ones(8), 2)
    assert all(known[2, 0] < pose[0] < known[5, 0] for pose in even)
    plane, errors = pose_nodes(16, 2), np.zeros(16)
    errors[np.argmin(np.linalg.norm(plane - [0.9, 0.1], axis=1))] = 1.0
    (found,) = next_poses(plane, errors, 1)
    assert np.linalg.norm(np.subtract(found, [0.9, 0.1])) < 0.35 and len(found) == 2


def test_adaptive_shards_have_poses_that_are_new(scene, shards):
    kind, maker, columns, _ = shards
    query = Query(**{name: columns[name] for name in Query.__dataclass_fields__ if name in columns})
    known = Samples(query, *(columns[name] for name in ("half_a", "half_b", "weight", "shape")))
    assert maker.before_adaptive > 0
    more, _ = maker.adaptive(known, lambda q: np.zeros((len(q), 3)))(scene, LIGHT, None, SMALL, 0)
    poses = np.unique(more["pose"])
    new = np.setdiff1d(poses, np.float32(SLIDERS))
    assert len(new) == 1 and len(more["pose"]) == SMALL.size
    # Of the known poses one goes for each that is new.
    assert len(poses) == (1 if kind is OwnLightShards else len(SLIDERS))
