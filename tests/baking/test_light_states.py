"""Errors over the angles of a map and the hours of a day, from held-out points; what a view shows of them."""

import numpy as np
import pytest

from lightwell.baking.light_states import DEGREES, SWEEP, axis_of, errors_over_light, states_of_view
from lightwell.report.records import PointComparison
from lightwell.scenes.movers import NodeMover
from lightwell.scenes.suns import Sun
from lightwell.scenes.turning import Turning

ARC = Sun((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))


def comparison(predicted: np.ndarray) -> PointComparison:
    """Points whose reference is 1 without noise."""
    one = np.ones((len(predicted), 3))
    return PointComparison(predicted[:, None] * one, one, one, np.zeros(len(one), int), ("wall",))


def test_each_state_has_the_error_of_its_lights():
    turning = Turning(0.0, 360.0)
    angles = np.array([10.0, 100.0, 190.0, 280.0])
    # Half a turn is learned a fifth too bright; its points lie between those of others.
    predicted = np.tile([1.0, 1.0, 1.2, 1.0], 25)
    states = errors_over_light(comparison(predicted), turning.direction(np.tile(angles, 25)), turning, 1.0)
    assert [state["at"] for state in states] == pytest.approx(list(angles), abs=1e-3)
    assert [state["relative_error"] for state in states] == pytest.approx([0, 0, 0.2 / 1.01, 0])
    assert {(state["lights"], state["points"], state["noise_floor"]) for state in states} == {(1, 25, 0.0)}


def test_many_lights_are_joined_to_few_states():
    turning = Turning(0.0, 360.0)
    states = errors_over_light(comparison(np.ones(64)), turning.direction(np.linspace(5, 355, 64)), turning, 1.0)
    assert [state["lights"] for state in states] == [8] * 8
    assert np.all(np.diff([state["at"] for state in states]) > 0)


def test_a_sun_without_hours_has_no_axis():
    assert axis_of(ARC) == axis_of(None) == SWEEP
    assert errors_over_light(comparison(np.ones(4)), ARC.direction(np.linspace(0, 1, 4)), ARC, 1.0) == []


def test_a_view_says_angle_and_pose():
    door = NodeMover("Door", "rotation", (0.0, 1.0, 0.0), (0.0, 0.0, 0.0), 0.0, 90.0, (0,))
    turning = Turning(0.0, 360.0)
    lights = [(turning, turning.direction(90.0)), (ARC, ARC.direction(0.5))]
    assert states_of_view(lights, (door,), (0.5,)) == pytest.approx({DEGREES: 90.0, "Door, degrees": 45.0})
    assert states_of_view([(None, np.zeros(3))], (), None) == {}
