"""The sun's path on a day at a place."""

import numpy as np
import pytest

from lightwell.core.sun_path import clock, parse_clock, sun_day, sun_hours
from lightwell.core.vary import parse_vary
from lightwell.scenes.variables import Sun


def directions(text: str) -> np.ndarray:
    return np.array(sun_day(text)).reshape(3, 3)


def test_a_summer_day_in_munich():
    morning, noon, evening = directions("2026-06-21,48.1,11.6")
    np.testing.assert_allclose(np.linalg.norm([morning, noon, evening], axis=1), 1, atol=1e-9)
    # Solstice: 90 - 48.1 + 23.44 degrees above the south, which is +Z.
    assert np.degrees(np.arcsin(noon[1])) == pytest.approx(65.3, abs=0.2)
    assert noon[2] > 0.4 and abs(noon[0]) < 0.02
    # It rises north of east and sets north of west.
    assert morning[0] > 0.7 and morning[2] < 0 and evening[0] < -0.7 and evening[2] < 0
    assert np.degrees(np.arcsin([morning[1], evening[1]])) == pytest.approx(2, abs=0.5)


def test_the_arc_through_three_directions_is_the_path_of_the_day():
    from datetime import datetime, timezone

    from astral import Observer
    from astral.sun import azimuth, elevation

    arc = Sun(*(tuple(d) for d in directions("2026-03-20,48.1,0")))
    place, at = Observer(48.1, 0), datetime(2026, 3, 20, 9, tzinfo=timezone.utc)
    az, el = np.radians([azimuth(place, at), elevation(place, at, with_refraction=False)])
    sun = np.array([np.cos(el) * np.sin(az), np.sin(el), -np.cos(el) * np.cos(az)])
    nearest = arc.direction(np.linspace(0, 1, 2001)) @ sun
    assert np.degrees(np.arccos(min(nearest.max(), 1))) < 0.3


def test_in_the_south_the_sun_passes_north_and_beyond_the_circle_it_never_sets():
    assert directions("2026-12-21,-33.9,151.2")[1][2] < 0
    polar = directions("2026-06-21,78.2,15.6")
    assert (polar[:, 1] > 0.1).all() and not np.allclose(polar[0], polar[2], atol=1e-3)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("day(2026-12-21,78.2,15.6)", "the sun stays below 2 degrees on 2026-12-21 at latitude 78.2; choose another"),
        ("day(2026-02-30,48,11)", "is not day(YYYY-MM-DD,latitude,longitude)"),
        ("day(2026-06-21,48)", "is not day(YYYY-MM-DD,latitude,longitude)"),
        ("day(2026-06-21,95,11)", "a latitude lies between -90 and 90"),
    ],
)
def test_a_wrong_day_is_one_line_with_an_example(value, message):
    with pytest.raises(ValueError, match=r"^vary: [^\n]+write for example sun\.direction=day\([^\n]+$") as error:
        parse_vary(f"sun.direction={value}")
    assert message in str(error.value)


def test_a_day_declares_a_sun():
    assert len(parse_vary("sun.direction=day(2026-06-21,48.1,11.6)").values) == 9


def test_a_day_tells_its_hours_in_the_zone_of_its_longitude_or_in_a_given_one():
    numbers = sun_hours("2026-06-21,48.1,11.6")
    # Civil twilight included, which the path of a white sun leaves out; both have one noon.
    assert numbers[3:6] == sun_day("2026-06-21,48.1,11.6")[3:6]
    np.testing.assert_allclose(np.degrees(np.arcsin([numbers[1], numbers[7]])), -6, atol=0.5)
    # Central European Time: the sun culminates at 12:15 (longitude 3.4 degrees west of 15, equation of time +2 min).
    assert numbers[10] == pytest.approx(12.26, abs=0.05)
    assert numbers[9] == pytest.approx(3.6, abs=0.1) and numbers[11] == pytest.approx(20.95, abs=0.1)
    summer = sun_hours("2026-06-21,48.1,11.6,2")
    np.testing.assert_allclose(np.subtract(summer[9:], numbers[9:]), 1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("day=2026-12-21,78.2,15.6", "the sun stays below 2 degrees on 2026-12-21"),
        ("day=2026-02-30,48,11", "is not day(YYYY-MM-DD,latitude,longitude)"),
        ("day=tomorrow", "is not day(YYYY-MM-DD,latitude,longitude)"),
        ("day=2026-06-21,95,11", "a latitude lies between -90 and 90"),
        ("day=2026-06-21,48,11,25", "a time zone lies between -14 and 14"),
    ],
)
def test_a_wrong_day_with_its_sky_is_one_line_with_an_example(text, message):
    with pytest.raises(ValueError, match=r"^vary: [^\n]+write for example day=2026[^\n]+$") as error:
        parse_vary(text)
    assert message in str(error.value)


def test_clocks():
    assert parse_clock("18:30") == 18.5 and parse_clock("7.25") == 7.25
    assert clock(18.5) == "18:30" and clock(-0.5) == "23:30" and clock(24.25) == "00:15"
    for wrong in ("25:00", "12:75", "noon", "-3"):
        with pytest.raises(ValueError, match=r"no time of day; write for example 18:30"):
            parse_clock(wrong)
