"""Samples of lamps in several poses: lamps that hang on a mover move with it, and all of them are the scene's light."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lightwell.core.lamps import parse_lamps
from lightwell.fields.protocol import State
from lightwell.fields.request import Request
from lightwell.fields.surface.lamp_samples import BATCH
from lightwell.fields.surface.posed_lamp_samples import PosedLampTracer, lamps_in
from lightwell.scenes.assemble import assemble
from lightwell.scenes.lamps import group_lamps, own_lights
from lightwell.scenes.movers import NodeMover
from lightwell.scenes.posing import posed, with_movers
from lightwell.scenes.scene import Light, Material, Scene
from lightwell.transport import static
from tests.transport.rooms import quad, room_walls

POSES = [0, 0.25, 0.75, 1]


def room() -> Scene:
    """A closed room with a panel that stands still, and a flag with a bulb that slide together to the right."""
    white = Material("white", base_color=(0.6, 0.6, 0.6, 1.0), metallic=0.0)
    glow = Material("glow", metallic=0.0, emissive=(2.0, 2.0, 2.0))
    front = quad("front", (-1, 0, 1), (0, 2, 0), (2, 0, 0))
    panel = quad("panel", (-0.2, 1.95, -0.2), (0.4, 0, 0), (0, 0, 0.4), material=1)
    flag = quad("flag", (-0.7, 0.5, -0.3), (0, 0.5, 0), (0, 0, 0.5))
    bulb = Light("point", "bulb", position=(-0.5, 1.0, 0.0), intensity=1.0)
    scene = assemble("room", [*room_walls(), front, panel, flag], [white, glow], lights=[bulb], digest="posed lamps")
    mover = NodeMover("flag", "translation", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 1.0, (7,), (0,))
    return with_movers(scene, (mover,))


def prepared(**request) -> State:
    """The room with a switch for each lamp, prepared for a draft."""
    scene, lamps = room(), ("each",)
    progress = SimpleNamespace(say=lambda text: None)
    job = SimpleNamespace(request=Request(seed=3, quality="draft", lamps=lamps, **request), progress=progress)
    return State(job, scene, None, ("static",), lamps=group_lamps(scene, parse_lamps(lamps)))


@pytest.fixture(scope="module")
def tracer():
    return PosedLampTracer(prepared(shards=1), seconds=60.0)


@pytest.mark.slow
def test_batches_have_as_many_rows_of_every_pose_and_the_lamps_of_each(tracer):
    batch, scene = tracer.batch(0), room()
    pose = batch.query.pose[:, 0]
    assert np.unique(pose, return_counts=True)[1].tolist() == [BATCH // 4] * 4
    assert np.allclose(np.unique(pose), POSES) and batch.groups == 2
    # What moves is at rest where the file has it.
    flag = batch.shape == 7
    assert flag.any() and np.allclose(batch.query.rest_position[flag, 0], -0.7, atol=1e-5)
    assert np.allclose(batch.query.position[flag, 0], -0.7 + pose[flag], atol=1e-5)
    for k, at in enumerate(POSES):
        # The light of all groups is that of the scene that stands so, by paths; the panel itself is left out.
        own = np.flatnonzero(tracer.tracers[k].points[np.arange(256)].shape != 6)
        whole = np.mean(static(posed(scene, (at,)), tracer.tracers[k].points[own], 256, 7))
        found = batch.radiance[np.flatnonzero(pose == np.float32(at))[own]].sum(axis=1).mean()
        assert abs(found / whole - 1) < 0.1, (at, found, whole)
    # The bulb is the second group: the wall that it has come near is brighter.
    walls = {name: batch.shape == k for k, name in ((3, "left"), (4, "right"))}
    share = lambda wall, at, group: batch.radiance[walls[wall] & (pose == at), group].mean()  # noqa: E731
    assert share("left", 0, 1) > 1.25 * share("left", 1, 1) and share("right", 1, 1) > 1.25 * share("right", 0, 1)


@pytest.mark.slow
def test_held_out_rows_are_at_end_stops_and_between_traced_poses(tracer):
    pose = tracer.held_out().query.pose[:, 0]
    assert np.unique(pose).tolist() == [0, 0.125, 0.875, 1]


def test_groups_are_the_same_in_every_pose():
    scene = room()
    groups = group_lamps(scene, parse_lamps(("each",)))
    assert [group.name for group in groups] == ["panel", "bulb"]
    moved = posed(scene, (0.5,))
    found = lamps_in(moved, ("each",), groups[::-1])
    lights = {light.emitter: light.name for light in own_lights(moved)}
    assert [lights[group.emitters[0]] for group in found] == ["bulb", "panel"]


def test_time_has_poses_and_too_little_is_refused():
    assert [len(PosedLampTracer(prepared(), seconds).poses) for seconds in (9.0, 60.0)] == [4, 8]
    with pytest.raises(ValueError, match="flag takes at least 4 poses, about 8 s, of 5 s that this budget leaves"):
        PosedLampTracer(prepared(), 5.0)
