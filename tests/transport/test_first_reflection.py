"""Once reflected light, traced for each sample, and what the bins hold beside it."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import PointLight, to_json
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.light_vertices import SharedLamps
from lightwell.transport.path_settings import PathSettings
from lightwell.transport.paths import FIRST_DEPTH, RR_DEPTH
from lightwell.transport.queries import frames
from lightwell.transport.radiance import begin_first_reflection, indirect, radiance_rows
from lightwell.transport.radiosity import Radiosity
from lightwell.transport.samples import columns_of
from lightwell.transport.seen_shards import SPIKE, SPIKE_LEVEL, GatherSize, without_spikes
from lightwell.transport.shards import ShardSettings
from lightwell.transport.surface import draw_surface

from . import rooms
from .zscores import of_groups, z_test

LIGHT = PointLight((-0.8, 0.2, -0.8), (0.8, 1.8, 0.8), 0.05)
NEAR_A_WALL = (-0.9, 1.0, 0.0)


def estimate(traced, points, groups: int = 32):
    """Means and variances of points by groups of paths."""
    rows = np.repeat(np.arange(len(points)), groups)
    a, b = traced(points[rows])
    return of_groups(np.stack([a, b], axis=1).reshape(len(points), 2 * groups, 3))


def test_without_mirrors_it_is_the_light_of_paths_of_two_segments(cornell):
    points = draw_surface(cornell, 32, 1, floor=2).points
    place = np.tile(np.float32([NEAR_A_WALL]), (32 * len(points), 1))
    found = estimate(lambda p: begin_first_reflection(cornell, p, place, LIGHT, 128, 3)(), points)
    truth = estimate(lambda p: indirect(cornell, p, place, LIGHT, 128, 4, max_depth=3), points)
    passed, text = z_test(found - truth)
    assert passed, text


def by_shared_rays(scene, points, place, groups: int, seed: int, moved: float = 0.0):
    """Means and variances of points by groups of paths; each group has a lamp of its own in the same place."""
    index = np.tile(np.arange(groups), len(points))
    lamps = SharedLamps(np.tile(np.float32([place]) + np.float32(moved), (groups, 1)), index, seed)
    light = np.tile(np.float32([place]), (len(index), 1))
    return estimate(lambda p: begin_first_reflection(scene, p, light, LIGHT, 64, seed, lamps)(), points, groups)


def with_pane(_: Scene) -> Scene:
    """The room with a pane of glass before the lamp."""
    glass = {"type": "thindielectric"}
    walls = [*rooms.room_walls(), rooms.quad("pane", (-0.6, 0.6, -0.5), (0, 0.8, 0), (0, 0, 0.9))]
    return rooms.build("pane", walls, [rooms.diffuse(rooms.WHITE)] * 5 + [glass])


@pytest.mark.parametrize("scene_of", [lambda cornell: cornell, with_pane], ids=["room", "pane"])
def test_shared_light_rays_bring_the_same_light(cornell, scene_of):
    scene = scene_of(cornell)
    points = draw_surface(scene, 48, 1, floor=2).points
    found = by_shared_rays(scene, points, NEAR_A_WALL, 32, 3)
    place = np.tile(np.float32([NEAR_A_WALL]), (32 * len(points), 1))
    truth = estimate(lambda p: begin_first_reflection(scene, p, place, LIGHT, 256, 4)(), points)
    passed, text = z_test(found - truth)
    assert passed, text
    # Light rays of another place are caught.
    assert not z_test(by_shared_rays(scene, points, NEAR_A_WALL, 32, 3, moved=0.1) - truth)[0]


def test_shared_light_rays_find_what_others_do_not():
    # A lamp high above the ground: of its own light rays hardly any meets the box that lights the ground beside it.
    ground = rooms.quad("ground", (-20, 0, -20), (0, 0, 40), (40, 0, 0))
    box = [rooms.quad(f"box {x}", (x, 0, 0), (0, 0, 1), (0, 1, 0)) for x in (-9.0, 0.0, 9.0)]
    scene = rooms.build("open", [ground, *box], [rooms.diffuse(rooms.WHITE)] * 4)
    points = draw_surface(scene, 4096, 1).points
    points = points[np.flatnonzero(points.shape == 0)[:512]]
    place = np.float32([0.5, 3.0, 0.5])
    light, index = np.tile(place, (len(points), 1)), np.arange(len(points))
    lamps = SharedLamps(light, index, 5)
    truth = np.mean(begin_first_reflection(scene, points, light, LIGHT, 4096, 6)(), axis=0)
    error = lambda pair: float(np.mean((np.mean(pair, axis=0) - truth) ** 2))  # noqa: E731
    own = error(begin_first_reflection(scene, points, light, LIGHT, 32, 7)())
    # Five seeds: 0.24 to 0.46.
    assert error(begin_first_reflection(scene, points, light, LIGHT, 32, 7, lamps)()) < 0.6 * own


def test_rows_of_shared_lamps_do_not_depend_on_how_work_is_divided(cornell):
    points = draw_surface(cornell, 64, 1).points
    places = np.float32([NEAR_A_WALL, (0.3, 1.2, 0.1)])
    index = np.arange(len(points)) % 2
    whole = begin_first_reflection(cornell, points, places[index], LIGHT, 8, 3, SharedLamps(places, index, 9))()
    settings = {"limits": asdict(PathSettings(8, 3, FIRST_DEPTH, RR_DEPTH, False, 1, past_mirrors=True))}
    settings |= {"variable": to_json(LIGHT), "lamp_seed": 9}
    part = slice(20, 50)
    columns = columns_of(points[part]) | {"light": places[index[part]], "lamp": index[part]}
    found = radiance_rows(cornell, settings, columns, 20, {"places": places})["means"]
    np.testing.assert_array_equal(found[:, 0], whole[0][part])
    np.testing.assert_array_equal(found[:, 1], whole[1][part])


@pytest.mark.parametrize("alpha", [0.0, 0.05])
def test_mirrors_show_what_the_light_reaches(alpha):
    # A wall that mirrors: the light of the room behind the glass is that of an image of the room.
    mirror = {"type": "conductor"} if alpha == 0 else {"type": "roughconductor", "alpha": alpha}
    walls = rooms.room_walls()
    bsdfs = [rooms.diffuse(rooms.WHITE)] * 4 + [{"type": "twosided", "bsdf": mirror}]
    scene = rooms.build("mirrored", walls, bsdfs)
    points = draw_surface(scene, 4096, 1, floor=64).points
    points = points[np.flatnonzero(points.shape == 0)][:256]
    place = np.tile(np.float32([[0.2, 1.0, 0.1]]), (len(points), 1))
    mean = lambda pair: float(np.mean(pair))  # noqa: E731
    straight = mean(indirect(scene, points, place, LIGHT, 256, 5, max_depth=3))
    mirrored = mean(indirect(scene, points, place, LIGHT, 1024, 6, max_depth=4))
    found = mean(begin_first_reflection(scene, points, place, LIGHT, 256, 7)())
    # More than what is seen directly, less than all light of two reflections.
    assert straight * 1.02 < found < mirrored


def test_samples_beside_a_wall_are_right(cornell):
    # A lamp 10 cm beside a wall, in bins of 30 cm.
    light = PointLight((-0.9, 0.6, -0.3), (-0.9, 1.4, 0.3), 0.02)
    settings = ShardSettings(paths=4, lights=64, points_per_light=32)
    size = GatherSize(8192, 512, 64, 64)
    shards, table = (GatheredShards(cornell, light, settings, s) for s in (size, replace(size, paths=0)))
    columns, counts = shards(cornell, light, None, settings, 0)
    bare = table(cornell, light, None, settings, 0)[0]
    np.testing.assert_array_equal(bare["position"], columns["position"])
    found, blurred = (0.5 * (c["half_a"] + c["half_b"]) for c in (columns, bare))
    rows = np.random.default_rng(0).permutation(len(found))[:512]
    place = frames(cornell, shards.points)[0]
    index = [np.flatnonzero((place == columns["position"][row]).all(axis=1))[0] for row in rows]
    truth = np.mean(indirect(cornell, shards.points[index], columns["light"][rows], light, 2048, 8), axis=0)
    error = lambda y: np.sqrt(np.mean((y - truth) ** 2) / np.mean(truth**2))  # noqa: E731
    assert counts["paths"]["paths"] > size.paths * len(found)
    assert found[rows].mean() == pytest.approx(truth.mean(), rel=0.05)
    # Samples that read the bins alone are wrong by more than twice as much.
    assert error(found[rows]) < 0.5 * error(blurred[rows])


def test_samples_have_the_paths_that_are_asked_for(cornell):
    settings = [ShardSettings(paths=paths, lights=4, points_per_light=8) for paths in (4, 16, 64)]
    sizes = [GatherSize.of(1, each, 2) for each in settings]
    # The default of 16 is the default of the gather.
    assert [size.paths for size in sizes] == [8, GatherSize(1, 1, 1).paths, 128]
    for each, size in zip(settings, sizes):
        shards = GatheredShards(cornell, LIGHT, each, replace(size, points=64, bins=32, lights=4))
        (_, first), (_, second) = (shards(cornell, LIGHT, None, each, k) for k in (0, 1))
        assert shards.paths == size.paths and second["paths"]["paths"] == size.paths * each.size
        assert first["paths"]["paths"] == second["paths"]["paths"] + 64 * 2


def test_more_paths_keep_what_was_traced(cornell):
    settings = ShardSettings(paths=4, lights=8, points_per_light=16)
    few = GatheredShards(cornell, LIGHT, settings, GatherSize(256, 64, 8, 8, paths=8))
    more = few.with_paths(16)
    assert (few.paths, more.paths) == (8, 32) and more.seen is few.seen
    (one, first), (two, second) = (maker(cornell, LIGHT, None, settings, 1) for maker in (few, more))
    assert (first["paths"]["paths"], second["paths"]["paths"]) == (8 * settings.size, 32 * settings.size)
    np.testing.assert_array_equal(one["light"], two["light"])
    noise = [float(np.mean((c["half_a"] - c["half_b"]) ** 2)) for c in (one, two)]
    assert noise[1] < noise[0]
    # Samples that read the bins alone have none.
    assert GatheredShards(cornell, LIGHT, settings, GatherSize(256, 64, 8, 8, paths=0)).with_paths(16).paths == 8


def test_gathered_light_has_no_spikes(cornell):
    # One ray of each half, and a lamp 2 cm beside a wall: a ray that meets its bin is all of the light.
    light = PointLight((-0.98, 0.6, -0.3), (-0.98, 1.4, 0.3), 0.01)
    settings = ShardSettings(paths=4, lights=16, points_per_light=128)
    shards = GatheredShards(cornell, light, settings, GatherSize(4096, 4096, 16, 2, paths=0))
    columns = shards(cornell, light, None, settings, 0)[0]
    level = np.stack([columns[half].mean(axis=1).reshape(16, 128) for half in ("half_a", "half_b")])
    mean = level.mean(axis=(0, 2))[None, :, None]
    # The mean that limits them is without the largest, so that it is below this one.
    assert (level <= SPIKE * (level[::-1] + SPIKE_LEVEL * mean) * (1 + 1e-5)).all()


def test_no_bin_is_a_spot_of_light_because_of_few_paths():
    # A closed white room: what bins receive from each other is nearly even, however long the paths are.
    walls = [*rooms.room_walls(), rooms.quad("front", (-1, 0, 1), (0, 2, 0), (2, 0, 0))]
    scene = rooms.build("white", walls, [rooms.diffuse([0.85] * 3)] * len(walls))
    radiosity = Radiosity(scene, draw_surface(scene, 16384, 1).points, 0, 4096)
    even = np.ones((1, radiosity.bins.count + 1), np.float32)
    received = radiosity.indirect(even)[0, :-1, 0]
    # An irradiance of 1 everywhere is reflected to ρ / (1 - ρ).
    assert received.mean() == pytest.approx(0.85 / 0.15, rel=0.1)
    assert received.max() < 4 * received.mean()


def test_a_half_that_one_path_decides_is_limited():
    random = np.random.default_rng(0)
    a, b = random.gamma(4.0, 0.25, (2, 256, 1)) * np.float32([[1.0, 0.5, 0.25]])
    kept = without_spikes(a, b, 64)
    np.testing.assert_allclose(kept, (a, b))
    spiked = a.copy()
    spiked[7] *= 1000
    limited, other = without_spikes(spiked, b, 64)
    assert np.array_equal(other, b) and limited[7].max() < 0.1 * spiked[7].max()
    # Its colour is kept, and so are the samples around it.
    np.testing.assert_allclose(limited[7] / limited[7, 0], a[7] / a[7, 0])
    np.testing.assert_allclose(np.delete(limited, 7, 0), np.delete(a, 7, 0))


def test_light_that_few_paths_find_is_kept():
    # One half of ten finds light, at ten times the mean: no path is a spike.
    random = np.random.default_rng(0)
    a, b = np.where(random.random((2, 4096, 1)) < 0.1, np.float32(10), np.float32(0)) * np.ones(3, np.float32)
    limited = np.mean(without_spikes(a, b, 128))
    assert limited == pytest.approx(np.mean((a, b)), rel=0.05)
