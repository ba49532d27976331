"""Shards of the scene's own light have the mean of whole paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lightwell.scenes.variables import declare
from lightwell.transport import static
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.own_light_shards import OwnLightShards
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings
from tests.transport.rooms import WHITE, box, build, diffuse, quad, room_walls


@pytest.fixture(scope="module")
def shards():
    white, shine = diffuse(WHITE), {"type": "area", "radiance": {"type": "rgb", "value": [20.0, 18.0, 15.0]}}
    walls = [*room_walls(), quad("front", (-1, 0, 1), (2, 0, 0), (0, 2, 0))]
    meshes = [
        *walls,
        box("tall", (-0.6, 0, -0.6), (0, 1.2, 0)),
        quad("lamp", (-0.2, 1.98, 0.2), (0.4, 0, 0), (0, 0, 0.4)),
    ]
    scene = build("own light", meshes, [white] * len(meshes), [*[None] * (len(meshes) - 1), shine])
    variable = declare((), scene)
    settings = ShardSettings(lights=8, points_per_light=64, floor=1)
    return scene, variable, settings, OwnLightShards(scene, variable, settings, GatherSize(1024, 1024, 64, 256))


def test_the_mean_is_that_of_whole_paths(shards):
    scene, variable, settings, make = shards
    columns, counts = make(scene, variable, None, settings, 0)
    truth = 0.5 * sum(static(scene, make.points[np.arange(settings.size)], 512, 7))
    found = 0.5 * (columns["half_a"] + columns["half_b"])
    assert found.mean() == pytest.approx(truth.mean(), rel=0.04)
    assert counts["paths"]["paths"] == settings.size * 64 + 1024 * 256


def test_later_shards_have_other_points_and_more_of_them_other_rays(shards):
    scene, variable, settings, make = shards
    first, second = (make(scene, variable, None, settings, k)[0] for k in (0, 1))
    assert not np.array_equal(first["position"], second["position"])
    # 1,024 points are two shards: the third one has the points of the first.
    third = make(scene, variable, None, settings, 2)[0]
    assert np.array_equal(first["position"], third["position"]) and not np.array_equal(first["half_a"], third["half_a"])
    more = make.adaptive(None, None)(scene, variable, None, settings, 0)[0]
    assert not np.array_equal(first["half_a"], more["half_a"])


def test_points_and_rays_are_traced_once_for_both_parts_of_the_light(shards):
    scene, variable, settings, make = shards
    moving = GatheredShards(scene, variable, settings, GatherSize(1024, 1024, 64, 256))
    assert moving.seen is make.seen
    other = GatheredShards(scene, variable, replace(settings, seed=1), GatherSize(1024, 1024, 64, 256))
    assert not np.array_equal(other.points.barycentric, moving.points.barycentric)


def test_shards_end_where_all_points_were_used(shards):
    *_, make = shards
    assert make.most == 2
