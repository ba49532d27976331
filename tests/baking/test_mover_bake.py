"""A bake of two rooms with a door: the light follows the door, and is scored at poses that were not traced."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.asset.read import read_fields
from lightwell.asset.validate import validate_file
from lightwell.baking.pipeline import bake
from lightwell.baking.preview import Preview
from lightwell.fields.surface.poses import held_out_poses, traced_poses
from tests.baking.conftest import small

DOOR = ("node:Door.rotation=y:0..90",)


@pytest.mark.slow
def test_a_door_and_a_lamp_that_roams_are_learned_together_and_scored_by_pose(tmp_path):
    vary = (*DOOR, "light.position=box(-2.2,0.4,-1,2.2,2,1)")
    report = bake(small(tmp_path / "out", scene="doorway", shards=1, steps=20, views=1, quality="draft", vary=vary))
    fields, variables = read_fields(tmp_path / "out/scene.glb")
    assert [field.role for field in fields] == ["indirect", "static"]
    assert [v["kind"] for v in variables] == ["point", "node"] and validate_file(tmp_path / "out/scene.glb") == []
    assert all("pose" in field.graph.inputs for field in fields)
    door = report["facts"]["movers"][0]
    values = [row["value"] for row in door["poses"]]
    assert values[0] == 0 and values[-1] == 90 and len(values) == 9 and door["worst_pose"] in door["poses"]
    assert [stop["value"] for stop in door["end_stops"]] == [0, 90]
    assert report["sweep_axis"] == "Door, degrees" and report["sweep"][-1]["at"] == 90


@pytest.mark.slow
def test_two_things_move_and_are_scored_each_from_end_to_end(tmp_path):
    vary = (*DOOR, "node:crate.translation=(0,0,0)..(0,0.5,0)")
    report = bake(small(tmp_path / "out", scene="doorway", shards=1, steps=20, views=2, quality="draft", vary=vary))
    fields, variables = read_fields(tmp_path / "out/scene.glb")
    assert [v["name"] for v in variables] == ["Door", "crate"] and validate_file(tmp_path / "out/scene.glb") == []
    assert [field.graph.inputs["pose"] for field in fields] == [2]
    door, crate = report["facts"]["movers"]
    assert [row["value"] for row in door["poses"]] == [0, 11.7, 42.3, 71.1, 90]
    assert [row["value"] for row in crate["poses"]] == [0, 0.065, 0.235, 0.395, 0.5]
    assert all(len(mover["end_stops"]) == 2 for mover in (door, crate))
    assert "Door at 55.8°, crate at 0.145 m" in (tmp_path / "out/report.html").read_text()


@pytest.mark.parametrize(
    "more, message",
    [
        ({"field": "mlp"}, "field 'mlp' learns one pose; use --field factored, or drop 'Door' from --vary"),
        ({"vary": ("node:Dor.rotation=y:0..90",)}, "has no node 'Dor'; the nearest names are 'Door'"),
    ],
)
def test_what_knows_one_pose_is_refused(tmp_path, more, message):
    with pytest.raises(ValueError, match=message):
        bake(small(tmp_path / "out", **({"scene": "doorway", "vary": DOOR} | more)))


def test_a_preview_shows_one_pose(tmp_path):
    with pytest.raises(ValueError, match="--preview shows one pose; leave it out"):
        bake(small(tmp_path / "out", scene="doorway", vary=DOOR), preview=object.__new__(Preview))


def test_held_out_poses_are_none_of_the_traced_ones():
    traced = traced_poses("good", 512, 16)
    held_out = held_out_poses(traced, 8)[:, 0]
    assert len(traced) == 16 and len(held_out) == 8 and held_out[0] == 0 and held_out[-1] == 1
    assert np.abs(held_out[1:-1, None] - traced[:, 0]).min() > 1e-3
    assert len(traced_poses("best", 48, 16)) == 24
    # Less time has fewer poses.
    assert [len(traced_poses("draft", 512, gathered)) for gathered in (1, 3, 16)] == [4, 4, 8]
