"""A bake of two rooms with a door and a switch: the light of the lamp follows the door and the switch."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.asset.info import info
from lightwell.asset.read import read_fields
from lightwell.asset.validate import validate_file
from lightwell.baking.pipeline import bake
from lightwell.fields.baked import Baked
from lightwell.scenes import load
from lightwell.scenes.posing import declared_movers, with_movers
from lightwell.transport.moved import at_pose
from lightwell.transport.queries import make_query
from lightwell.transport.surface import draw_surface
from tests.baking.conftest import small

DOOR = ("node:Door.rotation=y:0..90",)
DOORWAY = {"scene": "doorway", "vary": DOOR, "lamps": ("name",), "views": 1, "quality": "draft"}
# Metres from the wall between the rooms from which a place is inside the dark one.
INSIDE = 0.3

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def door(tmp_path_factory):
    """(folder, report) of a bake in four poses."""
    out = tmp_path_factory.mktemp("door") / "out"
    return out, bake(small(out, shards=1, steps=150, **DOORWAY))


def test_the_file_has_a_switch_and_a_node_that_moves(door):
    out, report = door
    fields, variables = read_fields(out / "scene.glb")
    assert validate_file(out / "scene.glb") == []
    assert [v["name"] for v in variables] == ["Door"] and info(out / "scene.glb")["lamps"] == ["lamp"]
    assert [(f.role, f.graph.inputs["lamps"], f.graph.inputs["pose"]) for f in fields] == [("static", 3, 1)]
    facts = report["facts"]
    assert list(facts["error_of_each_lamp"]) == ["lamp"] and facts["pose_bases"] == 4
    assert facts["movers"][0]["name"] == "Door" and len(facts["movers"][0]["end_stops"]) == 2


def test_behind_the_shut_door_the_lamp_is_dark(door):
    graph = read_fields(door[0] / "scene.glb")[0][0].graph
    scene = load("doorway")
    scene = with_movers(scene, declared_movers(DOOR, scene))
    points, baked = draw_surface(scene, 2000, 1).points, Baked(graph, {"lamps": np.ones(3, np.float32)})

    def light(pose: float, graph: Baked = baked) -> float:
        query = make_query(scene, at_pose(points, (pose,)), np.zeros(3, np.float32))
        return float(graph(query)[query.rest_position[:, 0] > INSIDE].mean())

    assert light(0.0) < 0.2 * light(1.0)
    assert light(0.0) < light(0.5)
    assert light(1.0, baked.with_frame(lamps=np.zeros(3, np.float32))) == 0
