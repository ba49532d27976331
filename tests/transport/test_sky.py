"""Sun and sky of a day: the path tracer against Mitsuba's, the gather against it, and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lightwell.scenes.daylight import radiance_of_mitsuba, sunsky
from lightwell.scenes.sky import STEPS, Sky
from lightwell.scenes.twilight import HORIZON
from lightwell.scenes.variables import PointLight, Sun, declare, from_json, to_json
from lightwell.transport import draw_surface, indirect
from lightwell.transport.bins import PLACES
from lightwell.transport.camera import total_image
from lightwell.transport.day_light import day_light
from lightwell.transport.gather_sums import DeviceRows, Gather
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.radiosity import Radiosity
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings

from . import rooms, zscores

DAY, TURBIDITY = ("day=2026-06-21,48.1,11.6", "day.north=200"), 3.0
# Just after sunrise, in the morning and in the afternoon.
TIMES = (0.07, 0.3, 0.7)
POINTS = 72


@pytest.fixture(scope="module")
def day(cornell) -> Sun:
    return declare(DAY, cornell)


def unit(day: Sun) -> float:
    """Mitsuba's radiance in units of the day's brightest light."""
    up = np.array([[0.0, 1.0, 0.0]])
    sun = day.direction(0.5)
    return float((radiance_of_mitsuba(sun, TURBIDITY, up) / day.sky.radiance(0.5, sun, up)).mean())


def flat_sky(radiance: float) -> Sun:
    """A sky of one radiance and no sun: c alone is not 0, in both keys."""
    model = (0, 0, radiance, 0, 0, 0, 0, 0, 0) * 3
    sky = Sky((0.0, 1.0), ((0.0,) * 3,) * 2, (model, model), (2 * np.pi * radiance,) * 2, TURBIDITY)
    return Sun((0.9, 0.1, 0.42), (0.0, 1.0, 0.0), (-0.9, 0.1, 0.42), sky=sky)


def test_the_numbers_of_the_sky_give_the_radiance_of_mitsubas(day):
    random = np.random.default_rng(1)
    directions = random.normal(size=(2000, 3))
    directions[:, 1] = np.abs(directions[:, 1])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for k, t in enumerate(day.sky.times):
        sun = day.direction(t)
        if sun[1] < np.sin(np.radians(HORIZON)) - 1e-6:
            continue
        truth = radiance_of_mitsuba(sun, TURBIDITY, directions)
        found = day.sky.radiance(t, sun, directions) * unit(day)
        assert np.abs(found / truth - 1).max() < 0.01, k
    # Between two of the times, where only the interpolation of the light is an approximation.
    t = 0.5 * (day.sky.times[13] + day.sky.times[14])
    truth = radiance_of_mitsuba(day.direction(t), TURBIDITY, directions)
    assert np.abs(day.sky.radiance(t, day.direction(t), directions) * unit(day) / truth - 1).mean() < 0.03


def test_a_path_knows_its_times(day):
    t = np.linspace(0, 1, 41)
    np.testing.assert_allclose(day.time(day.direction(t)), t, atol=1e-6)
    assert from_json(to_json(day)) == day
    assert day.hour(day.at_hour(9.5)) == pytest.approx(9.5, abs=1e-6)
    with pytest.raises(ValueError, match=r"it is night at 23:00; choose 03:"):
        day.at_hour(23)
    tables = day.tables
    assert len(tables.level) == STEPS and tables.level.max() == pytest.approx(1, rel=1e-3)
    assert tables.level[0] < 0.3


@pytest.fixture(scope="module")
def points(cornell):
    return draw_surface(cornell, POINTS, 7).points


def suns(day: Sun) -> np.ndarray:
    """[3, 3] directions at ``TIMES``, at steps of the tables."""
    return day.direction(np.rint(np.array(TIMES) * (STEPS - 1)) / (STEPS - 1))


def test_light_of_sun_and_sky_is_that_of_mitsubas_path_tracer(cornell, day, points):
    parts, path = np.array_split(np.arange(POINTS), len(TIMES)), {"type": "path", "max_depth": 32, "rr_depth": 5}
    truth, light = [], np.zeros((POINTS, 3))
    for k, (rows, sun) in enumerate(zip(parts, suns(day))):
        light[rows] = sun
        whole = zscores.mitsubas(cornell, points[rows], {"sky": sunsky(sun, TURBIDITY)}, path, 1024, 5 + k)
        alone = {"sky": sunsky(sun, TURBIDITY, sky_scale=0.0)}
        drawn = zscores.mitsubas(cornell, points[rows], alone, {**path, "max_depth": 2}, 256, 9 + k)
        truth.append((whole - drawn) * (1 / (unit(day) * float(day.level(sun)))))
    found = zscores.ours(cornell, points, light, day, 1024, 3)
    joined = zscores.Estimate(*(np.concatenate([getattr(t, name) for t in truth]) for name in ("mean", "variance")))
    good, text = zscores.z_test(found - joined)
    assert good, text


def test_gathered_light_of_a_day_is_that_of_paths(cornell, day, points):
    radiosity = Radiosity(cornell, draw_surface(cornell, 4096, 1).points, 0, 1024)
    gather = Gather(
        DeviceRows.of(radiosity.rows(points, 128, 2, sky=True)), day_light(radiosity, day, suns(day), 3).irradiance
    )
    pairs = np.tile(np.arange(POINTS), len(TIMES)), np.arange(len(TIMES)).repeat(POINTS)
    found = sum(gather(*pairs)) / 2
    light = suns(day)[pairs[1]]
    truth = sum(indirect(cornell, points[pairs[0]], light, day, 256, 4)) / 2
    for k in range(len(TIMES)):
        rows = pairs[1] == k
        assert found[rows].mean(axis=0) == pytest.approx(truth[rows].mean(axis=0), rel=0.06)
    assert np.median(np.abs(found - truth).mean(axis=1) / (truth.mean(axis=1) + 0.01)) < 0.12


def test_no_light_of_the_sky_enters_a_closed_room(day):
    room = rooms.furnace(0.5)
    # So few points find the bins that many rays meet none.
    radiosity = Radiosity(room, draw_surface(room, 64, 1).points, 0, 4096)
    rows = radiosity.rows(draw_surface(room, POINTS, 7).points, 32, 2, sky=True)
    assert (rows.bin >= radiosity.bins.count).mean() > 0.1
    gather = Gather(DeviceRows.of(rows), day_light(radiosity, day, suns(day), 3).irradiance)
    for k in range(len(TIMES)):
        halves = gather(np.arange(POINTS), np.full(POINTS, k))
        assert not np.any(halves)


def test_a_lamp_and_a_day_share_points_and_rays(cornell, day):
    lamp = PointLight((-0.5, 1.2, -0.5), (0.5, 1.6, 0.5), 0.05)
    settings, size = ShardSettings(lights=8, points_per_light=32, floor=1), GatherSize(256, 512, 8, 16)
    of_day = GatheredShards(cornell, day, settings, size)
    of_lamp = GatheredShards(cornell, lamp, settings, size, day)
    assert of_lamp.seen is of_day.seen
    # What leaves the room is dark to the lamp: its light is that of rays that know no sky.
    bare = GatheredShards(cornell, lamp, settings, size, replace(day, sky=None))
    found, expected = (make(cornell, lamp, None, settings, 0)[0] for make in (of_lamp, bare))
    for name in ("position", "light", "half_a", "half_b"):
        np.testing.assert_array_equal(found[name], expected[name])
    assert found["half_a"].max() > 0
    # Prepared once, it costs nothing.
    assert of_lamp.prepare() < 0.1


def test_a_plane_under_an_even_sky_has_a_closed_form():
    floor, sky = rooms.plane(0.5), flat_sky(2.0)
    points = draw_surface(floor, 64, 1).points
    a, b = indirect(floor, points, sky.direction(0.5), sky, 1024, 2)
    up = points.view[:, 1] > 0
    # L = albedo × radiance, and the level of the light is 2 π × radiance (no sun).
    assert 0.5 * (a + b)[up].mean() == pytest.approx(0.5 / (2 * np.pi), rel=0.01)


def test_a_plane_alone_gathers_the_sky_and_nothing_else():
    floor, sky = rooms.plane(0.5), flat_sky(2.0)
    points = draw_surface(floor, 512, 1).points
    # No ray meets a surface that a bin could be made of.
    radiosity = Radiosity(floor, points, 0, 64)
    rows = radiosity.rows(points, 64, 2, sky=True)
    assert radiosity.bins.count > 0 and (rows.bin >= radiosity.bins.count).all()
    gather = Gather(DeviceRows.of(rows), day_light(radiosity, sky, np.float32([sky.direction(0.5)]), 3).irradiance)
    a, b = gather(np.arange(512), np.zeros(512, np.int64))
    up = points.view[:, 1] > 0
    assert 0.5 * (a + b)[up].mean() == pytest.approx(0.5 / (2 * np.pi), rel=0.02)


def test_numbers_behind_the_bins_are_stored_whole():
    floor = rooms.plane(0.5)
    points = draw_surface(floor, 64, 1).points
    radiosity = Radiosity(floor, points, 0, 64)
    # As many as 16 bits count: the cells of the sky come after them.
    many = (1 << 16) - 1
    found = {name: np.resize(getattr(radiosity.bins, name), (many, PLACES, 3)) for name in ("place", "normal")}
    radiosity.bins = replace(radiosity.bins, **found)
    assert (radiosity.rows(points, 8, 2, sky=True).bin >= many).all()


def test_a_picture_shows_the_sky_behind_everything(day):
    floor = rooms.plane(0.5)
    from lightwell.scenes.scene import Camera

    camera, sun = Camera((0, 1, 4), (0, 2, 0), fov_y=30.0), day.direction(0.25)
    picture = total_image(floor, camera, sun, day, 8, 8, 16, intensity=3.0)
    forward = np.array([0, 1, -4]) / np.sqrt(17)
    wanted = 3 * day.sky.radiance(0.25, sun, forward)
    np.testing.assert_allclose(picture[3:5, 3:5].mean(axis=(0, 1)), wanted, rtol=0.1)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (("day.turbidity=3",), "needs one path"),
        (("day=2026-06-21,48.1,11.6", "day.radius=1"), "it has no radius; drop it"),
        (("sun.direction=arc(90,-8,270,10)", "sun.turbidity=3"), "goes below -6 degrees, where it is night"),
        (("day=2026-06-21,48.1,11.6", "day.turbidity=11"), "a turbidity lies between 1 and 10"),
    ],
)
def test_a_wrong_sky_is_one_line_with_a_cure(cornell, texts, message):
    with pytest.raises(ValueError, match=r"^vary: [^\n]+$") as error:
        declare(texts, cornell)
    assert message in str(error.value)


def test_an_arc_with_a_turbidity_has_a_sky_and_no_clock(cornell):
    sun = declare(("sun.direction=arc(90,10,270,10)", "sun.turbidity=5"), cornell)
    assert sun.sky and sun.sky.turbidity == 5 and sun.hour(sun.middle) is None
