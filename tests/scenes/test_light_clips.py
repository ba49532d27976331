"""Animations of lights: read as factors of what the file has at rest, and joined to those of groups."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.core.lamps import parse_lamps
from lightwell.scenes import load
from lightwell.scenes.errors import SceneError
from lightwell.scenes.lamp_clips import lamp_clips
from lightwell.scenes.lamps import group_lamps
from tests.scenes.gltf_builder import Builder

TIMES = np.float32([0, 1, 2])
BULB, TUBE = "/extensions/KHR_lights_punctual/lights/0/", "/extensions/KHR_lights_punctual/lights/1/"
GLOW = "/materials/1/emissiveFactor"
STRENGTH = "/materials/1/extensions/KHR_materials_emissive_strength/emissiveStrength"


def channel(sampler: int, pointer: str) -> dict:
    return {
        "sampler": sampler,
        "target": {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}},
    }


def lit(tmp_path, *tracks, change=lambda file: None):
    """A floor, a shining square, lights 'Bulb.001' and 'Bulb.002' (of 4 cd) and 'Tube' (off); a clip with these tracks.

    A track is (pointer, values, interpolation).
    """
    file = Builder()
    file.mesh(node=False, material=0)
    file.mesh(node=False, material=1)
    file.json["materials"] = [
        {"name": "Plain"},
        {
            "name": "Glow",
            "emissiveFactor": [1.0, 0.5, 0.0],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2.0}},
        },
    ]
    bulb = {"type": "point", "name": "Bulb", "intensity": 4.0, "color": [1.0, 0.5, 0.25]}
    tube = {"type": "point", "name": "Tube", "intensity": 0.0}
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [bulb, tube]}}
    file.json["extensionsUsed"] = ["KHR_lights_punctual", "KHR_animation_pointer"]
    node = lambda name, k: {"name": name, "extensions": {"KHR_lights_punctual": {"light": k}}}  # noqa: E731
    file.json["nodes"] = [{"name": "Floor", "mesh": 0}, {"name": "Screen", "mesh": 1}]
    file.json["nodes"] += [node("Bulb.001", 0), node("Bulb.002", 0), node("Tube", 1)]
    times = file.accessor(TIMES)
    samplers = [
        {"input": times, "output": file.accessor(np.float32(values)), "interpolation": kind}
        for _, values, kind in tracks
    ]
    channels = [channel(k, pointer) for k, (pointer, _, _) in enumerate(tracks)]
    file.json["animations"] = [{"name": "Flicker", "channels": channels, "samplers": samplers}]
    change(file)
    return load(file.save(tmp_path))


def joined(scene, *texts):
    return lamp_clips(scene, group_lamps(scene, parse_lamps(texts)))


def test_keys_are_factors_of_the_light_at_rest(tmp_path):
    scene = lit(
        tmp_path,
        (BULB + "intensity", [4, 0, 8], "STEP"),
        (BULB + "color", [[1, 0.5, 0.25]] * 2 + [[0, 0.5, 0.5]], "LINEAR"),
    )
    (clip,), told = joined(scene, "name")
    assert clip.name == "Flicker" and not told
    assert [(track.lamp, track.path, track.keys.interpolation) for track in clip.lamps] == [
        (1, "intensity", "STEP"),
        (1, "color", "LINEAR"),
    ]
    assert clip.lamps[0].keys.values.ravel().tolist() == [1, 0, 2]
    assert clip.lamps[1].keys.values.tolist() == [[1, 1, 1], [1, 1, 1], [0, 1, 2]]
    assert [track.lights for track in clip.lights] == [(0, 1), (0, 1)]


def test_an_emissive_factor_that_only_dims_is_a_dimmer(tmp_path):
    values = np.outer([1, 0.5, 0], [1, 0.5, 0])
    (clip,), _ = joined(lit(tmp_path, (GLOW, values, "LINEAR")), "name")
    (track,) = clip.lamps
    assert (track.lamp, track.path, track.keys.values.ravel().tolist()) == (0, "intensity", [1, 0.5, 0])
    assert (clip.lights[0].material, clip.lights[0].path) == (1, "color")


def test_a_cubic_spline_keeps_its_tangents(tmp_path):
    values = [8, 4, -4, 0, 2, 0, 4, 6, 0]
    (clip,), _ = joined(lit(tmp_path, (STRENGTH, values, "CUBICSPLINE")), "name")
    assert clip.lamps[0].keys.values[..., 0].tolist() == [[4, 2, -2], [0, 1, 0], [2, 3, 0]]


def test_tangents_that_overflow_are_left_out(tmp_path):
    def faint(file):
        file.json["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = 1e-300

    scene = lit(tmp_path, (BULB + "intensity", [3e38, 0, 3e38] * 3, "CUBICSPLINE"), change=faint)
    assert joined(scene, "name")[0] == []


def test_a_group_of_which_only_some_change_stays_as_it_is_and_says_so(tmp_path):
    scene = lit(tmp_path, (BULB + "intensity", [4, 0, 8], "LINEAR"))
    (clip,), told = joined(scene, "all")
    assert not clip.lamps and len(clip.lights) == 1
    assert told == [
        "animations: lamp 'lights' in 'Flicker': only some of its lights change, or not alike, so that the lamp stays "
        "as it is; group them apart with --lamps NAME=PATTERN, or animate all of them"
    ]
    # Alike: a lamp of a bulb and a screen that both fall to a half.
    both = lit(tmp_path, (BULB + "intensity", [4, 4, 2], "LINEAR"), (STRENGTH, [2, 2, 1], "LINEAR"))
    (clip,), told = joined(both, "tv=Bulb*", "tv2=Tube", "all")
    assert [track.lamp for track in clip.lamps] == [0, 2] and not told
    (clip,), told = joined(both, "tv=Bulb*,Screen", "rest=Tube")
    assert [track.lamp for track in clip.lamps] == [0] and not told


def test_what_is_off_at_rest_cannot_follow(tmp_path):
    scene = lit(
        tmp_path, (TUBE + "intensity", [0, 1, 2], "LINEAR"), (GLOW, [[1, 0.5, 0], [1, 0.5, 0], [1, 0.5, 1]], "LINEAR")
    )
    clips, told = joined(scene, "each")
    assert not clips
    assert told[0].startswith("animations: 'Tube' in 'Flicker', 'Glow' in 'Flicker': off at rest")


def test_a_bake_without_switches_says_what_is_lost(tmp_path):
    scene = lit(tmp_path, (BULB + "intensity", [4, 0, 8], "LINEAR"))
    assert lamp_clips(scene, ()) == (
        [],
        [
            "animation 'Flicker' changes lights, which is lost: only lamps with a switch can change; "
            "bake with --lamps name"
        ],
    )
    # It moves nothing, so that it is not offered as a variable; and its extension is known.
    assert not any("animation" in text for text in scene.warnings)


def damage(change):
    return lambda file: change(file.json["animations"][0], file)


def set_accessor(animation, file, key, **values):
    file.json["accessors"][animation["samplers"][0][key]].update(values)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a, f: a["samplers"][0].update(output=999), "names accessor 999, but there are"),
        (lambda a, f: a["samplers"][0].pop("input"), "has no input"),
        (lambda a, f: a["samplers"][0].update(interpolation="CUBIC"), "has interpolation 'CUBIC'"),
        (lambda a, f: a["samplers"][0].update(interpolation="CUBICSPLINE"), "times that do not increase, or values"),
        (lambda a, f: a["channels"][0].update(sampler=7), "names sampler 7, but there are 1"),
        (lambda a, f: a.update(samplers=3), "samplers"),
        (lambda a, f: a["channels"].append(a["channels"][0]), "changes the same value by two channels"),
        (lambda a, f: a["channels"].append(channel(0, "/materials/99/emissiveFactor")), "material 99 is named"),
        (
            lambda a, f: a["channels"].append(channel(0, BULB.replace("0", "99999999") + "color")),
            "names light 99999999",
        ),
        (
            lambda a, f: a["channels"].extend([channel(0, BULB + "color")] * 2000),
            "2,001 channels of lights, more than 1,024",
        ),
        (lambda a, f: set_accessor(a, f, "output", count=300_000_000), "300,000,000 keys, too many"),
        (lambda a, f: set_accessor(a, f, "input", bufferView=2), "times that do not increase"),
        (lambda a, f: f.json["animations"].extend([a] * 100), "101 animations of lights, more than 64"),
    ],
)
def test_a_damaged_animation_is_no_error_before_it_is_used(tmp_path, change, message):
    scene = lit(tmp_path, (BULB + "intensity", [4, 0, 8], "LINEAR"), change=damage(change))
    assert scene.light_clips.names[0] == "Flicker"
    assert len(lamp_clips(scene, ())[1]) == 1
    with pytest.raises(SceneError, match=message) as error:
        joined(scene, "name")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", [None, 3, "x", [1], {"pointer": 5}, {"pointer": "/materials/-1/emissiveFactor"}])
def test_pointers_that_name_no_light_are_passed_over(tmp_path, value):
    def change(animation, file):
        animation["channels"][0]["target"]["extensions"]["KHR_animation_pointer"] = value

    scene = lit(tmp_path, (BULB + "intensity", [4, 0, 8], "LINEAR"), change=damage(change))
    assert not scene.light_clips.names and joined(scene, "name") == ([], [])


@pytest.mark.parametrize("value", [None, 3, [None], [[]], [{"target": 3}], [{"target": {"extensions": []}}]])
def test_channels_of_any_form_do_not_stop_a_scene_from_loading(tmp_path, value):
    def change(animation, file):
        animation["channels"] = value

    assert lit(tmp_path, (BULB + "intensity", [4, 0, 8], "LINEAR"), change=damage(change)).clips == ("Flicker",)
