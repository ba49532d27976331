"""Animations of lamps in an asset: channels of the lamps, and of what other viewers show."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset.container import pack, read_file, view_bytes
from lightwell.asset.records import FieldEntry, LampEntry
from lightwell.asset.validate import validate_file
from lightwell.asset.write import write_glb
from lightwell.core.lamps import parse_lamps
from lightwell.fields.features import open_builder
from lightwell.scenes.lamp_clips import lamp_clips
from lightwell.scenes.lamps import group_lamps
from tests.scenes.test_light_clips import BULB, GLOW, STRENGTH, lit

WEB = Path(__file__).parents[2] / "web"
LAMP = "/extensions/LIGHTWELL_neural_radiance/lamps/"


def written(path: Path, scene) -> dict:
    b = open_builder()
    field = FieldEntry("none", "static", b.build(radiance=b.scale("reflectance", 0.0)))
    groups = group_lamps(scene, parse_lamps(["name"]))
    lamps = [LampEntry(group.name, group.nodes) for group in groups]
    write_glb(path, scene, [field], [], lamps=lamps, clips=lamp_clips(scene, groups)[0])
    return read_file(path)[0]


def channels(document: dict, path: Path) -> dict[str, list]:
    """Values by pointer."""
    binary, found = read_file(path)[1], {}
    for channel in document["animations"][0]["channels"]:
        sampler = document["animations"][0]["samplers"][channel["sampler"]]
        accessor = document["accessors"][sampler["output"]]
        values = np.frombuffer(view_bytes(document, binary, accessor["bufferView"]), np.float32)
        pointer = channel["target"]["extensions"]["KHR_animation_pointer"]["pointer"]
        found[pointer] = values.reshape(accessor["count"], -1).squeeze().tolist()
    return found


@pytest.fixture
def flicker(tmp_path):
    values = np.outer([1, 0.5, 0], [1, 0.5, 0])
    return lit(tmp_path, (BULB + "intensity", [4, 0, 8], "STEP"), (GLOW, values, "LINEAR"))


def test_lamps_have_factors_and_lights_and_materials_their_values(tmp_path, flicker):
    path = tmp_path / "scene.glb"
    document = written(path, flicker)
    assert document["animations"][0]["name"] == "Flicker"
    assert "KHR_animation_pointer" in document["extensionsUsed"]
    found = channels(document, path)
    names = [lamp["name"] for lamp in document["extensions"]["LIGHTWELL_neural_radiance"]["lamps"]]
    bulb, screen = names.index("Bulb"), names.index("Screen")
    assert found[f"{LAMP}{bulb}/intensity"] == [1, 0, 2]
    assert found[f"{LAMP}{screen}/intensity"] == [1, 0.5, 0]
    # Each node has a light of its own in the asset; the material's factor is written as at most 1.
    lights = document["extensions"]["KHR_lights_punctual"]["lights"]
    for k in (0, 1):
        assert (
            found[f"/extensions/KHR_lights_punctual/lights/{k}/intensity"] == [4, 0, 8] and lights[k]["intensity"] == 4
        )
    (glow,) = [k for k, material in enumerate(document["materials"]) if material["name"] == "Glow"]
    assert found[f"/materials/{glow}/emissiveFactor"] == [[1, 0.5, 0], [0.5, 0.25, 0], [0, 0, 0]]
    assert len(found) == 5 and len(document["animations"][0]["samplers"]) == 4
    assert not validate_file(path)


def test_a_strength_that_changes_is_in_the_file(tmp_path):
    def dim(file):
        file.json["materials"][1]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] = 0.5

    path = tmp_path / "scene.glb"
    document = written(path, lit(tmp_path, (STRENGTH, [0.5, 1, 0], "LINEAR"), change=dim))
    (pointer,) = [pointer for pointer in channels(document, path) if pointer.startswith("/materials")]
    material = document["materials"][int(pointer.split("/")[2])]
    assert material["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] == 1
    assert channels(document, path)[pointer] == [1, 2, 0]
    assert "KHR_materials_emissive_strength" in document["extensionsUsed"]


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ("lamps/9/intensity", "there is no lamp 9, only 3; name one of the file"),
        ("lamps/0/name", "can not be animated; name the intensity or color of a lamp"),
        ("exposure", "can not be animated; name the intensity or color of a lamp"),
        ("lamps/0/color", "its values have type SCALAR, expected VEC3"),
    ],
)
def test_pointers_that_name_no_lamp_are_problems(tmp_path, flicker, change, problem):
    path = tmp_path / "scene.glb"
    document = written(path, flicker)
    target = document["animations"][0]["channels"][0]["target"]["extensions"]["KHR_animation_pointer"]
    target["pointer"] = "/extensions/LIGHTWELL_neural_radiance/" + change
    document["extensionsUsed"].remove("KHR_animation_pointer")
    path.write_bytes(pack(document, read_file(path)[1]))
    found = validate_file(path)
    assert len(found) == 2 and found[0].startswith("animations[0].channels[0]: ") and problem in found[0]
    assert found[1] == "extensionsUsed: KHR_animation_pointer is missing; list it"


@pytest.mark.parametrize(
    ("keys", "change", "problem"),
    [
        ("input", lambda values: values[::-1], "expected times that increase and are not negative"),
        ("input", lambda values: values - 1, "expected times that increase and are not negative"),
        ("output", lambda values: values * np.float32(np.nan), "expected finite values"),
        ("output", None, "values for 3 times, expected 1 for each"),
    ],
)
def test_lamps_have_a_value_for_each_time(tmp_path, flicker, keys, change, problem):
    path = tmp_path / "scene.glb"
    document = written(path, flicker)
    animation, binary = document["animations"][0], bytearray(read_file(path)[1])
    accessor = document["accessors"][animation["samplers"][animation["channels"][0]["sampler"]][keys]]
    if change is None:
        accessor["count"] -= 1
    else:
        start = document["bufferViews"][accessor["bufferView"]]["byteOffset"]
        values = np.frombuffer(bytes(binary), np.float32, accessor["count"], start)
        binary[start : start + values.nbytes] = change(values).tobytes()
    path.write_bytes(pack(document, bytes(binary)))
    found = validate_file(path)
    assert found and all(problem in one for one in found)


def test_more_than_64_animations_of_lamps_are_a_problem(tmp_path, flicker):
    path = tmp_path / "scene.glb"
    document = written(path, flicker)
    document["animations"] *= 65
    path.write_bytes(pack(document, read_file(path)[1]))
    assert validate_file(path) == ["animations: 65 change lamps, more than 64; keep fewer of them"]


@pytest.mark.skipif(not (WEB / "node_modules").is_dir(), reason="needs npm ci in web/")
def test_the_validator_of_khronos_accepts_it(tmp_path, flicker):
    path = tmp_path / "scene.glb"
    written(path, flicker)
    script = Path(__file__).with_name("validate.mjs")
    done = subprocess.run(["node", script, path, WEB], capture_output=True, text=True, check=True)
    issues = json.loads(done.stdout)["issues"]
    assert issues["numErrors"] == 0, issues["messages"]
