"""Declaring, sampling and storing what may move."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lightwell.scenes import load
from lightwell.scenes.variables import (
    PointLight,
    Sun,
    declare,
    default_variable,
    from_json,
    parse_vary,
    sun_arc,
    to_json,
    toward,
)


def bounded(*size):
    """What declarations ask of a scene: its bounds."""
    bounds = np.array([[0.0, 0, 0], size])
    return SimpleNamespace(bounds=bounds, core=bounds, extent=float(max(size)), vary=())


ROOM = bounded(4, 2, 3)


@pytest.mark.parametrize(
    "text, parameter, values",
    [
        ("light.position=box(0,0.5,-1,1,2,1)", "position", (0, 0.5, -1, 1, 2, 1)),
        (" light.position=box( 0, 0.5, -1, 1e0, 2, 1 ) ", "position", (0, 0.5, -1, 1, 2, 1)),
        ("light.radius=0.05", "radius", (0.05,)),
        ("light.clearance=0.1", "clearance", (0.1,)),
        ("light.direction=arc(90,10,270,10)", "direction", (90, 10, 270, 10)),
        ("light.intensity", "intensity", ()),
        ("light.intensity=20", "intensity", (20,)),
        ("light.color=1,0.9,0.8", "color", (1, 0.9, 0.8)),
    ],
)
def test_parse(text, parameter, values):
    found = parse_vary(text)
    assert (found.name, found.parameter, found.values) == ("light", parameter, values)
    assert found.learned == (parameter not in ("intensity", "color"))


@pytest.mark.parametrize(
    "text, message",
    [
        ("nonsense", "vary: 'nonsense': expected NAME.PARAMETER=VALUE; write for example light.position=box("),
        ("light.size=3", "vary: 'light.size=3': 'size' cannot vary, only position, radius, clearance, direction"),
        ("light.position=1,2,3", "expected box(x0,y0,z0,x1,y1,z1); write for example light.position=box("),
        ("light.position=box(1,2)", "expected 6 numbers (x0,y0,z0,x1,y1,z1), got 2; write"),
        ("light.position=box(0,0,0,1,1,east)", "'0,0,0,1,1,east' is not a list of numbers; write"),
        ("light.position=box(0,0,0,1,1,inf)", "every number must be finite"),
        ("light.position=box(0,0,0,1,-1,1)", "the second corner must be larger than the first in x, y and z"),
        ("light.radius=-1", "a radius is not negative; write for example light.radius=0.05"),
        ("light.intensity=0", "an intensity is above 0; write for example light.intensity=20"),
        ("light.radius=", "expected 1 numbers (metres), got 0"),
        ("sun.direction=arc(0,10,90)", "expected 4 numbers (az0,el0,az1,el1), got 3"),
        ("sun.direction=arc(0,100,90,10)", "an elevation lies between -90 and 90 degrees"),
        ("sun.direction=arc(10,20,370,20)", "the arc starts where it ends"),
    ],
)
def test_nonsense_is_one_clear_line(text, message):
    with pytest.raises(ValueError) as error:
        parse_vary(text)
    assert message in str(error.value)
    assert text in str(error.value)
    assert "\n" not in str(error.value)


def test_azimuth_is_clockwise_from_north():
    for azimuth, elevation, expected in (
        (0, 0, (0, 0, -1)),
        (90, 0, (1, 0, 0)),
        (180, 0, (0, 0, 1)),
        (270, 0, (-1, 0, 0)),
        (123, 90, (0, 1, 0)),
    ):
        np.testing.assert_allclose(toward(azimuth, elevation), expected, atol=1e-12)


@pytest.mark.parametrize(
    "arc", [(90, 10, 270, 10), (90, 0, 270, 0), (100, 30, 260, 10), (0, 0, 0, 60), (270, 5, 90, 5)]
)
def test_the_sun_goes_through_its_three_directions_and_stays_unit(arc):
    sun = sun_arc(*arc)
    t = np.linspace(0, 1, 101)
    directions = sun.direction(t)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(directions[0], toward(*arc[:2]), atol=1e-12)
    np.testing.assert_allclose(directions[50], sun.middle, atol=1e-12)
    np.testing.assert_allclose(directions[-1], toward(*arc[2:]), atol=1e-12)
    # One circle, run through evenly: all steps of a half are equal.
    steps = np.linalg.norm(np.diff(directions, axis=0), axis=1)
    np.testing.assert_allclose(steps[:50], steps[0], rtol=1e-9)
    np.testing.assert_allclose(steps[50:], steps[-1], rtol=1e-9)


def test_a_day_reaches_noon_in_the_south_and_a_short_arc_stays_low():
    np.testing.assert_allclose(sun_arc(90, 0, 270, 0).middle, toward(180, 60), atol=1e-12)
    assert sun_arc(100, 20, 110, 20).middle[1] == pytest.approx(np.sin(np.radians(20)), abs=0.01)


def test_a_sun_that_stands_still_is_refused():
    with pytest.raises(ValueError, match="sun 'sun': start, middle and end must differ"):
        Sun((0, 1, 0), (0, 1, 0), (1, 0, 0))


def test_samples_fill_the_box_and_the_arc():
    u = np.random.default_rng(0).random((256, 3))
    points = PointLight((0, 1, 2), (1, 3, 5), 0.1).sample(u)
    assert points.dtype == np.float32
    np.testing.assert_allclose(points, [0, 1, 2] + u * [1, 2, 3], rtol=1e-6)
    sun = sun_arc(90, 10, 270, 10)
    assert sun.sample(u[:, :1]).shape == (256, 3)
    np.testing.assert_allclose(sun.sample(u[:, 0]), sun.direction(u[:, 0]), rtol=1e-6)


def test_the_default_light_roams_the_air_of_the_scene():
    light = default_variable(ROOM)
    np.testing.assert_allclose(light.low, 0.1)
    np.testing.assert_allclose(light.high, [3.9, 1.9, 2.9])
    assert light.clearance == pytest.approx(0.025 * 3.8)


def test_the_default_box_of_a_flat_scene_has_a_volume():
    flat = bounded(10, 0.2, 10)
    light = default_variable(flat)
    assert all(a < b for a, b in zip(light.low, light.high))


def test_declarations_complete_each_other():
    light = declare(["lamp.position=box(1,0,1,2,1,2)", "lamp.radius=0.2", "lamp.intensity=5"], ROOM)
    assert light == PointLight((1, 0, 1), (2, 1, 2), 0.2, 0.2, "lamp")
    assert declare(["lamp.radius=0.01", "lamp.clearance=0.1"], ROOM).low == default_variable(ROOM).low
    assert declare(["light.clearance=0.1"], ROOM) == replace(default_variable(ROOM), clearance=0.1)
    assert declare(["noon.direction=arc(90,10,270,10)"], ROOM) == sun_arc(90, 10, 270, 10, "noon")


def test_a_lamp_replaces_a_day_that_the_scene_suggests():
    day = load("courtyard-day")
    assert declare((), day).kind == "sun"
    lamp = declare(["light.position=box(-1,1,-1,1,2,1)"], day)
    assert lamp.kind == "point" and lamp.low == (-1, 1, -1)


def test_the_default_clearance_fits_into_low_rooms():
    hall = bounded(140, 4, 80)
    assert default_variable(hall).clearance == 0.5
    assert default_variable(ROOM).clearance == pytest.approx(0.025 * (4 - 2 * 0.1))


@pytest.mark.parametrize(
    "texts, message",
    [
        (["a.radius=1", "b.radius=1"], r"vary: one light can move here, not 2 \(a, b\); declare one of them"),
        (["sun.direction=arc(0,0,90,0)", "sun.radius=1"], "vary: 'sun' is a sun, it has no radius; drop it"),
    ],
)
def test_declarations_that_do_not_fit(texts, message):
    with pytest.raises(ValueError, match=message):
        declare(texts, ROOM)


@pytest.mark.parametrize("variable", [PointLight((0, 1, 2), (1, 3, 5), 0.1, 0.02, "lamp"), sun_arc(90, 10, 250, 30)])
def test_stored_variables_come_back(variable):
    entry = json.loads(json.dumps(to_json(variable, intensity=20, color=(1, 0.5, 0.25))))
    assert from_json(entry) == variable
    own = {"low", "high", "clearance", "radius"} if variable.kind == "point" else {"start", "middle", "end"}
    assert set(entry) == {"name", "kind", "initial", "intensity", "color"} | own
    assert len(entry["initial"]) == 3


def test_a_stored_variable_that_cannot_be_read():
    with pytest.raises(ValueError, match="variable 'x': kind is 'spot', expected 'point', 'sun' or 'environment'"):
        from_json({"name": "x", "kind": "spot"})
    with pytest.raises(ValueError, match=r"variable 'x': a point cannot be read .*'clearance'"):
        from_json({"name": "x", "kind": "point", "low": [0, 0, 0], "high": [1, 1, 1]})
