"""Light of a sun near and below the horizon: published figures, and what is continuous."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.core.vary import of_options, parse_vary
from lightwell.scenes.sky import cell_directions
from lightwell.scenes.suns import Sun, declared_sun
from lightwell.scenes.twilight import HORIZON, above_horizon, air_mass, altitude_of, illuminance

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@pytest.fixture(scope="module")
def day() -> Sun:
    return declared_sun({"day": parse_vary("day=2026-06-21,48.1,11.6").values}, "day")


def on_ground(day: Sun, t: float) -> float:
    """Luminance of what the ground receives of the sky."""
    directions = cell_directions()
    radiance = day.sky.radiance(t, day.direction(t), directions)
    return float(2 * np.pi * (radiance * directions[..., 1:2]).mean(axis=(0, 1)) @ LUMINANCE)


def time_of(day: Sun, altitude: float) -> float:
    """The time of a morning at which the sun has an altitude, degrees."""
    t = np.linspace(0, 0.5, 20001)
    heights = np.degrees(np.arcsin(day.direction(t)[:, 1]))
    return float(t[np.argmin(np.abs(heights - altitude))])


def test_published_figures():
    # Known values of the sun's illuminance: sunset 759 lx, end of civil twilight 3.4 lx; pieces meet within 3 %.
    assert illuminance(0) == pytest.approx(759, rel=0.01)
    assert illuminance(-6) == pytest.approx(3.4, rel=0.02)
    for joint in (20, 5, -0.8, -5):
        assert illuminance(joint + 1e-6) == pytest.approx(illuminance(joint - 1e-6), rel=0.03)
    # Kasten and Young 1989, table: 1 at the zenith, 1.994 at 30 degrees, 10.32 at 5 degrees, 37.9 at the horizon.
    masses = [air_mass(h) for h in (90, 30, 5, 0)]
    assert masses == pytest.approx([1, 1.994, 10.32, 37.92], rel=0.002)
    assert [above_horizon(h) for h in (1, 0, -1)] == pytest.approx([1, 0.5, 0])


def test_the_sky_follows_the_curve_and_is_continuous_at_the_join(day):
    join = on_ground(day, time_of(day, HORIZON + 0.01))
    for altitude in (-1, -2, -3, -4, -5):
        # Times of keys, between which light is interpolated.
        found = on_ground(day, time_of(day, altitude)) / join
        assert found == pytest.approx(illuminance(altitude) / illuminance(HORIZON), rel=0.03), altitude
    below = on_ground(day, time_of(day, HORIZON - 0.01))
    assert below == pytest.approx(join, rel=0.02)


def test_the_sun_dims_reddens_and_sets(day):
    suns = np.array([day.sky.sunlight(np.array(time_of(day, altitude))) for altitude in (10, 4, 2, 1, 0.5, 0.1)])
    assert (np.diff(suns[:, 0]) < 0).all()
    redness = suns[:, 1] / suns[:, 0]
    assert (np.diff(redness) < 0).all()
    assert not day.sky.sunlight(np.array(time_of(day, -0.3))).any()
    assert altitude_of(day.direction(0)) == pytest.approx(-6, abs=0.4)
    assert 1e-6 < day.sky.level[0] < 1e-3 and day.sky.level[0] < day.sky.level[1]


def test_an_arc_has_a_sky_where_it_is_asked_for():
    arc = "sun.direction=arc(90,-5,270,10)"
    assert of_options((arc,), True) == (arc, "sun.turbidity=3")
    assert of_options((arc,), True, turbidity=5.0) == (arc, "sun.turbidity=5")
    assert of_options(("day=2026-06-21,48.1,11.6",), True) == ("day=2026-06-21,48.1,11.6",)
    sun = declared_sun({"direction": parse_vary(arc).values, "turbidity": (3.0,)}, "sun")
    assert sun.sky is not None and not sun.sky.hours
    with pytest.raises(ValueError, match="vary: --sky is for a sun; add --vary day="):
        of_options((), True)


def test_night_is_refused_in_one_line():
    given = {"direction": parse_vary("sun.direction=arc(90,-9,270,10)").values, "turbidity": (3.0,)}
    with pytest.raises(ValueError, match=r"^vary: the path of 'sun' goes below -6 degrees, where it is night; [^\n]+$"):
        declared_sun(given, "sun")
