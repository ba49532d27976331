"""A bake of two rooms with a door and a switch: the light of the lamp follows the door and the switch."""

from __future__ import annotations

import pytest

from lightwell.asset.info import info
from lightwell.asset.read import read_fields
from lightwell.asset.validate import validate_file
from lightwell.baking.pipeline import bake
from tests.baking.conftest import small

DOOR = ("node:Door.rotation=y:0..90",)
TINY = {"scene": "doorway", "shards": 1, "steps": 20, "views": 1, "quality": "draft", "lamps": ("name",)}


@pytest.mark.slow
def test_a_lamp_with_a_switch_follows_a_door(tmp_path):
    report = bake(small(tmp_path / "out", vary=DOOR, **TINY))
    fields, variables = read_fields(tmp_path / "out/scene.glb")
    assert validate_file(tmp_path / "out/scene.glb") == []
    assert [v["name"] for v in variables] == ["Door"] and [field.role for field in fields] == ["static"]
    graph = fields[0].graph
    assert len(info(tmp_path / "out/scene.glb")["lamps"]) == 1
    assert graph.inputs["lamps"] == 3 and graph.inputs["pose"] == 1
    assert list(report["facts"]["error_of_each_lamp"]) and report["facts"]["movers"][0]["name"] == "Door"
