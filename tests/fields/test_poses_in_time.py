"""How many poses of a mover a bake traces in its time, which depends on what a pose takes here."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from lightwell.fields.budget import Budget
from lightwell.fields.protocol import State
from lightwell.fields.request import Request
from lightwell.fields.surface.poses import (
    gather_in_time,
    posed_maker,
    seconds_for_others,
    times_in_time,
    traced_poses,
)
from lightwell.scenes import load
from lightwell.scenes.posing import declared_movers, with_movers
from lightwell.scenes.variables import default_variable
from lightwell.transport.shards import ShardSettings

SECONDS, GATHERED, LIGHTS = 58.0, 8, 512


@pytest.fixture
def state() -> State:
    """The room with a door, prepared for a bake of three minutes."""
    scene = load("doorway")
    scene = with_movers(scene, declared_movers(["node:Door.rotation=y:0..90"], scene))
    job = SimpleNamespace(request=Request(budget=Budget(180.0)), progress=SimpleNamespace(say=lambda text: None))
    return State(job, scene, None, ("static",))


def poses(gathered: int) -> int:
    return len(traced_poses("good", LIGHTS, gathered))


@pytest.mark.parametrize("seconds_of_a_pose, expected", [(0.5, 16), (3.0, 8), (8.5, 4), (60.0, 4)])
def test_poses_leave_half_of_the_time_by_what_one_of_them_took(state, seconds_of_a_pose, expected):
    asked = []

    def timed(gathered: int) -> float:
        asked.append(gathered)
        return seconds_of_a_pose

    gathered, each = gather_in_time(state, SECONDS, GATHERED, timed)
    assert poses(gathered) == expected and each == seconds_of_a_pose
    # One is timed, among as many as a pose of 2 s has time for.
    assert [poses(gathered) for gathered in asked] == [8]


def test_fixed_counts_time_no_pose(state):
    state.job.request = Request(shards=GATHERED)
    assert gather_in_time(state, SECONDS, GATHERED, lambda gathered: 1 / 0) == (GATHERED, 0)


@pytest.mark.parametrize("seconds_of_a_pose, expected", [(0.4, 4), (0.9, 2), (1.5, 1), (0.0, 1)])
def test_own_light_alone_has_more_points_where_poses_leave_time(state, seconds_of_a_pose, expected):
    # 16 poses in half of the 58 seconds; 0 where counts are fixed.
    assert times_in_time(state, SECONDS, GATHERED, seconds_of_a_pose) == expected
    beside_a_lamp = State(state.job, state.scene, None, ("indirect", "static"))
    assert times_in_time(beside_a_lamp, SECONDS, GATHERED, seconds_of_a_pose) == 1


def test_other_roles_give_their_share_of_the_poses(state):
    # 16 poses of 0.5 s; own light has three tenths of the time.
    assert seconds_for_others(state, "static", GATHERED, 0.5) == pytest.approx(0)
    lights = State(state.job, state.scene, None, ("indirect", "indirect-day"))
    assert seconds_for_others(lights, "indirect", GATHERED, 0.5) == pytest.approx(4)
    with_own = State(state.job, state.scene, None, ("indirect", "static"))
    assert seconds_for_others(with_own, "indirect", GATHERED, 0.5) == pytest.approx(0.3 * 8)


def test_shards_of_own_light_last_as_many_times(state):
    light, shards = default_variable(state.scene), ShardSettings()
    makers = [posed_maker(state, "static", light, shards, GATHERED, 1.0, times) for times in (1, 2, 4)]
    assert [maker.most for maker in makers] == [2, 4, 8]


def test_a_time_without_poses_is_refused_before_one_is_prepared(state):
    with pytest.raises(ValueError, match="Door takes at least 4 poses, about 8 s, of 5 s"):
        gather_in_time(state, 5.0, GATHERED, lambda gathered: 1 / 0)
