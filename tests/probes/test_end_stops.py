"""Probes at end stops: what is dark behind a shut door stays dark under every light; the rest stays as it was."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.fields.field_and_probes.light import reduced
from lightwell.probes.end_stops import dark_at_stops
from lightwell.probes.spline import SplineMix

STATES, PROBES, ROOM = 40, 30, slice(20, 30)
NODES = ((0.0, 0.25, 0.5, 0.75, 1.0),)


class House:
    """Probes in a yard and, from ``ROOM`` on, behind a door: shut at 0 or 1, as good as open a quarter from there."""

    def __init__(self, shut: float | None) -> None:
        rng = np.random.default_rng(7)
        self._shut, self._waves = shut, rng.standard_normal((3, 4))
        self._shapes = rng.standard_normal((4, PROBES, 9, 3))

    def light(self, lights: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """[N, P, 9, 3] light of N states."""
        found = np.einsum("nw,wpbc->npbc", 1.5 + np.cos(lights @ self._waves), self._shapes)
        if self._shut is not None:
            found[:, ROOM] *= 0.02 * np.minimum(4 * np.abs(pose - self._shut), 1)[:, :, None, None]
        return found


def lights_of(count: int, kind: str, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    if kind == "lamp":
        return rng.uniform(-1, 1, (count, 3))
    turn = rng.uniform(0.3, 2.8, count)
    return np.stack([np.cos(turn), np.sin(turn), 0.2 * np.sin(turn)], axis=1)


def solved(house: House, kind: str, seed: int = 1) -> tuple[SplineMix, SplineMix, np.ndarray]:
    """(spline, the same with its end stops, bases [P, 9, 3, K])."""
    lights = lights_of(STATES, kind, seed)
    pose = np.array(NODES[0])[np.arange(STATES) % 5][:, None]
    states = house.light(lights, pose)
    bases, factors = reduced(states, np.arange(PROBES), 16)
    mix = SplineMix.of(lights, pose, factors, directions=kind == "sun", levels=kind == "lamp")
    return mix, dark_at_stops(mix, lights, pose, states, bases, NODES), bases


def shown(mix: SplineMix, bases: np.ndarray, lights: np.ndarray, pose: float) -> np.ndarray:
    return np.einsum("pbck,nk->npbc", bases, mix.factors(lights, np.full((len(lights), 1), pose)))


@pytest.mark.parametrize("kind", ["sun", "lamp"])
@pytest.mark.parametrize("shut", [0.0, 1.0])
def test_behind_a_shut_door_it_is_dark(kind, shut):
    house, lights = House(shut), lights_of(12, kind, 2)
    before, after, bases = solved(house, kind)
    opened = np.abs(house.light(lights, np.full((12, 1), 1 - shut))[:, ROOM]).mean()
    dark = [np.abs(shown(mix, bases, lights, shut)[:, ROOM]).mean() / opened for mix in (before, after)]
    assert dark[1] < 0.002 < 0.005 < dark[0], f"{dark[0]:.3f} before, {dark[1]:.4f} after"
    # In the yard, and where the door is open, the light is what it was.
    yard = [shown(mix, bases, lights, shut)[:, : ROOM.start] for mix in (before, after)]
    assert np.abs(yard[1] - yard[0]).mean() < 0.01 * np.abs(yard[0]).mean()
    for pose in (0.5, 1 - shut):
        np.testing.assert_array_equal(*(shown(mix, bases, lights, pose) for mix in (before, after)))


def test_a_door_beside_another_thing_that_moves():
    house, lights = House(0.0), lights_of(STATES, "sun", 1)
    door, other = np.array(NODES[0])[np.arange(STATES) % 5], np.arange(STATES) % 7 / 6
    states = house.light(lights, door[:, None])
    bases, factors = reduced(states, np.arange(PROBES), 16)
    pose = np.stack([other, door], axis=1)
    mix = SplineMix.of(lights, pose, factors, directions=True)
    mix = dark_at_stops(mix, lights, pose, states, bases, (tuple(np.linspace(0, 1, 7)), NODES[0]))
    assert [(stop.mover, stop.at, stop.reach) for stop in mix.stops] == [(1, 0.0, 0.25)]
    shut = mix.factors(lights_of(9, "sun", 3), np.stack([np.linspace(0, 1, 9), np.zeros(9)], axis=1))
    assert np.abs(np.einsum("pbck,nk->npbc", bases, shut)[:, ROOM]).max() < 0.01 * np.abs(states[:, ROOM]).max()


def test_the_light_of_an_opening_door_has_no_step():
    house, lights = House(0.0), lights_of(12, "sun", 2)
    _, after, bases = solved(house, "sun")
    light = np.stack([shown(after, bases, lights, pose)[:, ROOM] for pose in np.linspace(0, 0.5, 51)])
    assert np.abs(np.diff(light, axis=0)).mean(axis=(1, 2, 3, 4)).max() < 0.1 * np.abs(light[-1]).mean()


def test_a_door_that_shuts_nothing_off_changes_nothing():
    mix, after, _ = solved(House(None), "sun")
    assert not after.stops
    assert after.inputs == mix.inputs
