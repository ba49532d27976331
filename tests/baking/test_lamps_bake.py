"""A bake of a room with two lamps of its own: the file has switches, and the light of a state is that of its lamps."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset.read import read_fields
from lightwell.asset.records import FieldEntry
from lightwell.asset.validate import validate_file
from lightwell.asset.write import glb_bytes
from lightwell.baking.pipeline import bake
from lightwell.fields.baked import Baked
from lightwell.graph import Builder
from lightwell.scenes import load
from lightwell.scenes.assemble import assemble
from lightwell.scenes.lamp_clips import LampClip
from lightwell.scenes.light_clips import Keys, LightTrack
from lightwell.scenes.scene import Material
from lightwell.transport.queries import make_query
from lightwell.transport.surface import draw_surface
from tests.baking.conftest import small
from tests.transport.rooms import quad, room_walls


def room(path: Path) -> Path:
    """Write a closed room with a warm panel on the left, which flickers, and a cool one on the right."""
    walls = [*room_walls(), quad("front", (-1, 0, 1), (0, 2, 0), (2, 0, 0))]
    panels = [
        quad("warm", (-0.98, 0.6, -0.4), (0, 0.6, 0), (0, 0, 0.8), material=1),
        quad("cool", (0.98, 0.6, -0.4), (0, 0, 0.8), (0, 0.6, 0), material=2),
    ]
    white = Material("white", base_color=(0.6, 0.6, 0.6, 1.0), metallic=0.0)
    lit = [replace(white, name="w", emissive=(4.0, 1.0, 0.2)), replace(white, name="c", emissive=(0.2, 1.0, 4.0))]
    scene = assemble("room", [*walls, *panels], [white, *lit], digest="room")
    b = Builder(position=3)
    plain = FieldEntry("none", "static", b.build(radiance=b.scale("position", 0.0)))
    # The warm panel goes out within a second.
    keys = Keys(np.float32([0, 1]), np.array([[1.0] * 3, [0.0] * 3]), "LINEAR")
    clip = LampClip("Flicker", (), (LightTrack("color", keys, material=1),))
    path.write_bytes(glb_bytes(scene, [plain], [], clips=[clip]))
    return path


@pytest.fixture(scope="module")
def lamps(tmp_path_factory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("lamps")
    settings = small(
        folder / "out",
        scene=str(room(folder / "room.glb")),
        shards=1,
        steps=60,
        lights_per_shard=8,
        views=1,
        quality="draft",
        lamps=("name",),
    )
    return folder, bake(settings)


@pytest.mark.slow
def test_the_file_has_a_switch_for_each_lamp(lamps):
    folder, _ = lamps
    assert validate_file(folder / "out") == []
    data = (folder / "out" / "scene.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    extension = json.loads(data[20 : 20 + length])["extensions"]["LIGHTWELL_neural_radiance"]
    assert extension["version"] == 2
    assert [(lamp["name"], lamp["nodes"]) for lamp in extension["lamps"]] == [("warm", ["warm"]), ("cool", ["cool"])]
    (animation,) = json.loads(data[20 : 20 + length])["animations"]
    targets = [channel["target"]["extensions"]["KHR_animation_pointer"]["pointer"] for channel in animation["channels"]]
    assert animation["name"] == "Flicker"
    assert targets[0] == "/extensions/LIGHTWELL_neural_radiance/lamps/0/intensity"
    assert [target.split("/")[-1] for target in targets[1:]] == ["emissiveFactor"]
    fields, _ = read_fields(folder / "out" / "scene.glb")
    assert [field.graph.inputs.get("lamps") for field in fields] == [None, 6]


@pytest.mark.slow
def test_light_of_a_state_is_that_of_its_lamps(lamps):
    folder, _ = lamps
    graph = next(field.graph for field in read_fields(folder / "out" / "scene.glb")[0] if field.role == "static")
    scene = load(str(folder / "room.glb"))
    points = draw_surface(scene, 256, 1).points
    query = make_query(scene, points, np.zeros(3, np.float32))

    def light(warm: float, cool: float) -> np.ndarray:
        return Baked(graph, {"lamps": np.tile(np.float32([warm, cool]), 3)})(query)

    warm, cool = light(1, 0), light(0, 1)
    assert warm[:, 0].mean() > 3 * warm[:, 2].mean() and cool[:, 2].mean() > 3 * cool[:, 0].mean()
    np.testing.assert_allclose(light(0.5, 2), 0.5 * warm + 2 * cool, rtol=1e-3, atol=1e-6)
    assert not light(0, 0).any()


@pytest.mark.slow
def test_the_report_has_the_error_of_each_lamp(lamps):
    _, report = lamps
    text = json.dumps(report)
    assert "error_of_each_lamp" in text and "error_of_random_lamps" in text


def test_a_field_that_learns_all_lights_together_says_so(tmp_path):
    with pytest.raises(ValueError, match="bake: field 'mlp' learns all lights together; use --field factored"):
        bake(small(tmp_path / "out", scene=str(room(tmp_path / "room.glb")), field="mlp", lamps=("each",)))
