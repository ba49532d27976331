"""Light gathered for many lights at once against paths, and walls between bins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.transport import draw_surface, indirect
from lightwell.transport.bins import PLACES, find_bins, parted
from lightwell.transport.gather_sums import DeviceRows, Gather
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.paths import MAX_DEPTH
from lightwell.transport.radiosity import Radiosity, copies_of_paths
from lightwell.transport.seen import draw_seen
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings

from . import rooms

LIGHTS = np.float32([[0.2, 1.2, 0.1], [-0.4, 0.8, -0.3]])
POINTS = 400


@pytest.fixture(scope="module")
def gathered(cornell):
    """(points, means of both halves, paths' means) of the Cornell box under two lights, light by light."""
    from lightwell.scenes.variables import PointLight

    light = PointLight((-0.6, 0.4, -0.6), (0.6, 1.6, 0.6), 0.1)
    points = draw_surface(cornell, 8192, 1).points
    radiosity = Radiosity(cornell, points, 0, 2048)
    few = points[:POINTS]
    rows = radiosity.rows(few, 256, 2)
    gather = Gather(DeviceRows.of(rows), radiosity.light(light, LIGHTS, 3).irradiance)
    pairs = np.tile(np.arange(POINTS), 2), np.arange(2).repeat(POINTS)
    halves = gather(*pairs)
    truth = np.concatenate([sum(indirect(cornell, few, l, light, 512, 4)) / 2 for l in LIGHTS])
    return halves, truth


def test_gathered_light_is_that_of_paths(gathered):
    (a, b), truth = gathered
    found = 0.5 * (a + b)
    assert found.mean(axis=0) == pytest.approx(truth.mean(axis=0), rel=0.06)
    assert np.median(np.abs(found - truth).mean(axis=1) / (truth.mean(axis=1) + 0.01)) < 0.1


@pytest.mark.parametrize("gain", [1.2, 0.6, 0.05])
def test_paths_that_are_split_or_ended_count_as_much_as_before(gain):
    # 40,000 paths that count much or little; their mean grows, falls, or leaves few of them.
    random = np.random.default_rng(0)
    weight = gain * random.gamma(0.5, 2.0, 40_000)
    copies, each = copies_of_paths(weight, len(weight), random)
    assert copies.sum() <= 1.01 * len(weight) and each >= 1
    assert copies.sum() * each == pytest.approx(weight.sum(), rel=0.02)
    bright = weight > 4 * gain
    assert (copies * each)[bright].sum() == pytest.approx(weight[bright].sum(), rel=0.04)


def test_paths_that_count_nothing_end():
    copies, _ = copies_of_paths(np.zeros(8), 8, np.random.default_rng(0))
    assert not copies.any()


def test_the_halves_are_independent_means(gathered):
    (a, b), truth = gathered
    assert a.mean() == pytest.approx(b.mean(), rel=0.05)
    assert 0 < np.abs(a - b).mean() < 0.3 * truth.mean()


def test_what_is_seen_through_a_blended_surface_is_not_its_light():
    from lightwell.scenes.variables import PointLight

    pane = {"type": "mask", "opacity": 0.3, "bsdf": rooms.diffuse(rooms.WHITE)}
    scene = rooms.cornell(short=pane)
    light = PointLight((-0.6, 0.4, -0.6), (0.6, 1.6, 0.6), 0.1)
    points = draw_surface(scene, 4096, 1).points
    radiosity = Radiosity(scene, points, 0, 1024)
    names = [mesh.name for mesh in scene.meshes]
    few = points[np.flatnonzero(points.shape == names.index("short"))[:100]]
    gather = Gather(DeviceRows.of(radiosity.rows(few, 256, 2)), radiosity.light(light, LIGHTS[:1], 3).irradiance)
    found = sum(gather(np.arange(len(few)), np.zeros(len(few), int))) / 2
    truth = sum(indirect(scene, few, LIGHTS[0], light, 256, 4)) / 2
    assert found.mean() == pytest.approx(truth.mean(), rel=0.12)


def wall_and_floor(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Places and upward normals of a floor 4 m x 4 m."""
    place = random.random((20_000, 3)) * (4, 0, 4)
    return place, np.tile([0.0, 1.0, 0.0], (len(place), 1))


def test_bins_are_as_many_as_asked_for():
    random = np.random.default_rng(0)
    bins = find_bins(*wall_and_floor(random), 256, random)
    assert 150 <= bins.count <= 256
    assert bins.place.shape == (bins.count, PLACES, 3)


def test_a_wall_parts_bins():
    random = np.random.default_rng(0)
    whole = find_bins(*wall_and_floor(random), 64, random)
    cut = parted(whole, lambda a, b: (a[:, 0] < 1.3) == (b[:, 0] < 1.3))
    assert cut.count > whole.count
    side = cut.place[:, :, 0] < 1.3
    assert (side == side[:, :1]).all()
    assert ((whole.place[:, :, 0] < 1.3) != (whole.place[:, :1, 0] < 1.3)).any()


def test_a_room_behind_a_thin_wall_stays_dark():
    from lightwell.scenes.variables import PointLight

    walls = [*rooms.room_walls(), rooms.quad("front", (-1, 0, 1), (0, 2, 0), (2, 0, 0))]
    walls.append(rooms.quad("partition", (0.13, 0, -1), (0, 2, 0), (0, 0, 2)))
    scene = rooms.build("parted", walls, [rooms.diffuse(rooms.WHITE)] * len(walls))
    light = PointLight((-0.8, 0.4, -0.6), (-0.2, 1.6, 0.6), 0.1)
    points = draw_surface(scene, 8192, 1).points
    found = Radiosity(scene, points, 0, 256)
    gather = Gather(DeviceRows.of(found.rows(points[:1000], 64, 2)), found.light(light, LIGHTS[1:], 3).irradiance)
    value = sum(gather(np.arange(1000), np.zeros(1000, int))).mean(axis=1)
    truth = sum(indirect(scene, points[:1000], LIGHTS[1], light, 64, 4)).mean(axis=1)
    # The partition has two sides; points of the dark one reflect nothing.
    dark = truth == 0
    assert dark.mean() > 0.1
    assert value[dark].mean() < 1e-4 * value.mean()


def test_shards_repeat_and_have_the_columns_of_others(cornell):
    from lightwell.scenes.variables import PointLight

    light = PointLight((-0.6, 0.4, -0.6), (0.6, 1.6, 0.6), 0.1)
    settings = ShardSettings(paths=4, lights=16, points_per_light=64)
    size = GatherSize(1024, 256, 64)
    make = lambda: GatheredShards(cornell, light, settings, size)(cornell, light, None, settings, 0)  # noqa: E731
    (first, counts), (second, _) = make(), make()
    assert all(np.array_equal(first[name], second[name]) for name in first)
    assert len(first["half_a"]) == settings.size and counts["paths"]["dropped"] == 0
    assert np.isfinite(first["half_a"]).all() and first["half_a"].mean() > 0
    assert len(np.unique(first["light"][:64], axis=0)) == 1


def test_most_points_are_where_people_look(cornell):
    from lightwell.scenes.variables import PointLight

    light = PointLight((-0.6, 0.4, -0.6), (0.6, 1.6, 0.6), 0.1)
    outside = rooms.quad("far ground", (-40, -9, -40), (0, 0, 80), (80, 0, 0))
    scene = rooms.build("far", [*cornell.meshes, outside], [rooms.diffuse(rooms.WHITE)] * (len(cornell.meshes) + 1))
    drawn, again = (draw_seen(scene, light, 2048, 3, floor=1) for _ in range(2))
    assert len(drawn.points) == 2048 and (drawn.weight == 1).all()
    assert np.array_equal(drawn.points.barycentric, again.points.barycentric)
    far = np.uint32(len(cornell.meshes))
    by_area = draw_surface(scene, 2048, 3, floor=0).points
    assert (by_area.shape == far).mean() > 0.9 > 0.75 > (drawn.points.shape == far).mean()


def test_a_scene_without_cameras_is_sampled(cornell):
    from lightwell.scenes.variables import PointLight

    bare = replace(cornell, cameras=())
    light = PointLight((-0.6, 0.4, -0.6), (0.6, 1.6, 0.6), 0.1)
    assert len(draw_seen(bare, light, 1000, 1, floor=1).points) == 1000


def test_rough_metal_keeps_its_energy():
    from lightwell.scenes.variables import PointLight

    metal = {
        "type": "principled",
        "metallic": 1.0,
        "roughness": 1.0,
        "base_color": {"type": "rgb", "value": [0.95] * 3},
    }
    scene = rooms.cornell(floor={"type": "twosided", "bsdf": metal}, tall={"type": "twosided", "bsdf": metal})
    light = PointLight((-0.6, 0.4, -0.6), (0.6, 1.6, 0.6), 0.1)
    points = draw_surface(scene, 4096, 1).points
    radiosity = Radiosity(scene, points, 0, 1024)
    few = points[:200]
    gather = Gather(DeviceRows.of(radiosity.rows(few, 128, 2)), radiosity.light(light, LIGHTS[:1], 3).irradiance)
    found = sum(gather(np.arange(200), np.zeros(200, int))) / 2
    truth = sum(indirect(scene, few, LIGHTS[0], light, 256, 4)) / 2
    assert found.mean() == pytest.approx(truth.mean(), rel=0.12)


def gathered_and_traced(scene, points) -> tuple[np.ndarray, np.ndarray]:
    """[N] radiance of points by bins and by paths, under a light in the left half of the room."""
    from lightwell.scenes.variables import PointLight

    light = PointLight((-0.8, 0.4, -0.6), (-0.2, 1.6, 0.6), 0.1)
    found = Radiosity(scene, draw_surface(scene, 8192, 1).points, 0, 1024)
    gather = Gather(DeviceRows.of(found.rows(points, 256, 2)), found.light(light, LIGHTS[1:], 3).irradiance)
    value = sum(gather(np.arange(len(points)), np.zeros(len(points), int))).mean(axis=1) / 2
    return value, sum(indirect(scene, points, LIGHTS[1], light, 512, 4)).mean(axis=1) / 2


def test_light_goes_through_a_pane_of_a_glTF_file():
    glass = {"type": "principledthin", "spec_trans": 1.0, "roughness": 0.0, "eta": 1.5}
    walls = [*rooms.room_walls(), rooms.quad("front", (-1, 0, 1), (0, 2, 0), (2, 0, 0))]
    pane = rooms.quad("pane", (0.13, 0, -1), (0, 2, 0), (0, 0, 2))
    scene = rooms.build("pane", [*walls, pane], [rooms.diffuse(rooms.WHITE)] * len(walls) + [glass])
    points = draw_surface(scene, 4096, 1).points
    # The right wall, which no light reaches but through the pane.
    behind = points[np.flatnonzero(points.shape == 4)[:200]]
    found, truth = gathered_and_traced(scene, behind)
    # The mean over paths has the lamp itself through the pane, which few of them find.
    assert np.median(found / truth) == pytest.approx(1, abs=0.08)


def test_a_smooth_metal_shows_what_it_mirrors():
    metal = {"type": "principled", "metallic": 1.0, "roughness": 0.1, "base_color": {"type": "rgb", "value": [0.9] * 3}}
    walls = [*rooms.room_walls(), rooms.quad("front", (-1, 0, 1), (0, 2, 0), (2, 0, 0))]
    white = rooms.diffuse(rooms.WHITE)
    scene = rooms.build("mirror", walls, [{"type": "twosided", "bsdf": metal}] + [white] * (len(walls) - 1))
    points = draw_surface(scene, 4096, 1).points
    low = points[np.flatnonzero((points.shape == 3) | (points.shape == 2))[:200]]
    found, truth = gathered_and_traced(scene, low)
    assert np.median(found / truth) == pytest.approx(1, abs=0.08)


def light_of_even_light(scene) -> np.ndarray:
    """[F] indirect irradiance of bins that all have a direct irradiance of 1."""
    found = Radiosity(scene, draw_surface(scene, 4096, 1).points, 0, 256)
    return found.indirect(np.append(np.ones((1, found.bins.count)), [[0]], axis=1).astype(np.float32))[0, :-1, 0]


def test_many_bounces_between_white_walls_are_no_spots():
    even = light_of_even_light(rooms.furnace(0.95))
    # An even light of 1 comes back as ρ + ρ² + ..., as often as traced paths are reflected.
    assert even.mean() == pytest.approx(sum(0.95**k for k in range(1, MAX_DEPTH - 2)), rel=0.04)
    assert even.std() < 0.3 * even.mean()


def test_walls_that_reflect_all_light_are_no_spots():
    # White and glossy: at grazing angles it reflects more than it receives.
    white = {"type": "principled", "roughness": 0.5, "base_color": {"type": "rgb", "value": [1.0] * 3}}
    walls = rooms.room_walls()
    even = light_of_even_light(rooms.build("white", walls, [{"type": "twosided", "bsdf": white}] * len(walls)))
    assert even.max() < 3 * np.median(even)


def test_a_lamp_beside_a_wall_lights_its_bins_by_many_places(cornell):
    # Bins of half a metre, lamps 15 cm in front of the back wall: one place of a bin decided how much light there is.
    from lightwell.scenes.variables import PointLight

    light = PointLight((-0.8, 0.2, -0.9), (0.8, 1.8, -0.8), 0.1)
    lamps = np.float32([[x, y, -0.85] for x in (-0.6, -0.2, 0.2, 0.6) for y in (0.9, 1.5)])
    points = draw_surface(cornell, 8192, 1).points
    radiosity = Radiosity(cornell, points, 0, 128)
    few = points[:256]
    gather = Gather(DeviceRows.of(radiosity.rows(few, 128, 2)), radiosity.light(light, lamps, 3).irradiance)
    at = np.tile(np.arange(256), len(lamps)), np.arange(len(lamps)).repeat(256)
    found = np.mean(gather(*at), axis=0).reshape(len(lamps), -1).mean(axis=1)
    truth = np.array([np.mean(indirect(cornell, few, lamp, light, 512, 4)) for lamp in lamps])
    ratio = found / truth
    assert np.abs(np.log(ratio)).max() < 0.3


def test_under_the_open_sky_bins_are_found_for_all_that_is_met():
    ground = rooms.quad("ground", (-60, 0, -60), (0, 0, 120), (120, 0, 0))
    boxes = [
        rooms.box(f"box {i} {k}", (10 * i, 0, 10 * k), (10 * i + 1, 1, 10 * k + 1))
        for i in range(-5, 5)
        for k in range(-5, 5)
    ]
    scene = rooms.build("field", [ground, *boxes], [rooms.diffuse(rooms.WHITE)] * 101)
    points = draw_surface(scene, 8192, 1).points
    radiosity = Radiosity(scene, points, 0, 4096)
    rows = radiosity.rows(points, 64, 2)
    met = rows.weight.max(axis=2) > 0
    assert (rows.bin[met] < radiosity.bins.count).mean() > 0.9


def test_places_of_bins_are_chosen_in_launches_of_any_size(cornell):
    # A vector of lanes that the last ones do not fill.
    radiosity = Radiosity(cornell, draw_surface(cornell, 1024, 1).points, 0, 64)
    for lanes in (1, 3, 9):
        place, _ = radiosity.places.spread(mi.UInt32(np.zeros(lanes, np.uint32)), dr.arange(mi.UInt32, lanes), 1 << 20)
        assert np.isfinite(np.array(place)).all()


@pytest.mark.parametrize("sky", [False, True])
def test_rows_that_stay_on_the_device_are_those_that_are_copied(cornell, sky):
    points = draw_surface(cornell, 3000, 4).points
    radiosity = Radiosity(cornell, points, 0, 512)
    found = DeviceRows.traced(radiosity, points, 16, 5, sky)
    expected = DeviceRows.of(radiosity.rows(points, 16, 5, sky))
    np.testing.assert_array_equal(np.array(found.bin), np.array(expected.bin))
    np.testing.assert_array_equal(np.array(found.weight), np.array(expected.weight))
    assert found.rays == expected.rays == 16
