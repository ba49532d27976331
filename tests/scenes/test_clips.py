"""Clips of a file: read as glTF says, split into rigid parts, and refused where something would bend."""

from __future__ import annotations

import json

import numpy as np
import pytest
from gltf_builder import Builder

from lightwell.scenes import SceneError, load
from lightwell.scenes.posing import declared_movers, posed, with_movers

HALF = np.sqrt(0.5)
# A quarter of a turn about y.
QUARTER = [0, HALF, 0, HALF]


def room(tmp_path, **options):
    """A scene with one clip."""
    return load(door(**options).save(tmp_path))


def door(*, name="Open", interpolation="LINEAR", extra=(), **more):
    """A wall, and two leaves of a door in a frame that slides; the clip turns one and slides both."""
    file = Builder()
    for _ in range(4):
        file.mesh(node=False)
    times = file.accessor(np.float32([1, 2, 4]))
    turns = np.float32([[0, 0, 0, 1], [0, 0, 0, 1], QUARTER])
    ways = np.float32([[0, 0, 0], [0, 0, 1], [0, 0, 1]])
    if interpolation == "CUBICSPLINE":
        zero = np.zeros_like
        turns, ways = (np.stack([zero(x), x, zero(x)], axis=1).reshape(-1, x.shape[1]) for x in (turns, ways))
    samplers = [
        {"input": times, "output": file.accessor(turns), "interpolation": interpolation},
        {"input": times, "output": file.accessor(ways), "interpolation": interpolation},
        *[{"input": times, "output": file.accessor(np.float32(values))} for _, _, values in extra],
    ]
    channels = [
        {"sampler": 0, "target": {"node": 2, "path": "rotation"}},
        {"sampler": 1, "target": {"node": 1, "path": "translation"}},
        *[{"sampler": 2 + k, "target": {"node": node, "path": path}} for k, (node, path, _) in enumerate(extra)],
    ]
    file.json["animations"] = [{"name": name, "channels": channels, "samplers": samplers}]
    file.json["nodes"] = [
        {"name": "Wall", "mesh": 0},
        {"name": "Frame", "mesh": 1, "children": [2, 3]},
        {"name": "Left", "mesh": 2, "translation": [2, 0, 0]},
        {"name": "Right", "mesh": 3, "translation": [-2, 0, 0]},
        *more.get("nodes", ()),
    ]
    file.json["scenes"] = [{"nodes": [0, 1, *range(4, len(file.json["nodes"]))]}]
    return file


def moved(scene, text, slider):
    mover = declared_movers([text], scene)
    return {mesh.name: mesh.positions for mesh in posed(with_movers(scene, mover), (slider,)).meshes}, mover[0]


def test_nodes_of_a_clip_are_rigid_parts_in_the_frame_of_their_parents(tmp_path):
    scene = room(tmp_path)
    end, mover = moved(scene, "animation:Open=0..1", 1.0)
    assert (mover.unit, mover.seconds, mover.low, mover.high) == ("share", 4.0, 0.0, 1.0)
    assert [part.name for part in mover.parts] == ["Frame", "Left"]
    rest = {mesh.name: mesh.positions for mesh in scene.meshes}
    assert np.array_equal(end["Wall"], rest["Wall"])
    assert np.allclose(end["Frame"], rest["Frame"] + [0, 0, 1]) and np.allclose(end["Right"], rest["Right"] + [0, 0, 1])
    # The left leaf turns about its own origin (2, 0, 0), from the x axis to the -z axis, and slides with the frame.
    assert np.allclose(sorted(end["Left"][:, 2]), [0, 0, 2, 2], atol=1e-5)
    assert np.allclose(end["Left"][:, 0], 2, atol=1e-5)


def test_clips_are_read_from_files_beside_the_file_unless_those_have_changed(tmp_path):
    file = door()
    file.bytes()
    # The clip is in a file of its own, which the scene at rest does not need.
    views, data = file.json["bufferViews"], bytes(file.data)
    samplers = file.json["animations"][0]["samplers"]
    used = [file.json["accessors"][sampler[key]]["bufferView"] for sampler in samplers for key in ("input", "output")]
    clip = min(views[view]["byteOffset"] for view in used)
    for view in views:
        if view["byteOffset"] >= clip:
            view.update(buffer=1, byteOffset=view["byteOffset"] - clip)
    parts = {"room.bin": data[:clip], "clip.bin": data[clip:]}
    file.json["buffers"] = [{"uri": name, "byteLength": len(part)} for name, part in parts.items()]
    for name, part in parts.items():
        (tmp_path / name).write_bytes(part)
    (tmp_path / "room.gltf").write_text(json.dumps(file.json))
    scene = load(tmp_path / "room.gltf")
    way = moved(scene, "animation:Open=0..1", 1.0)[0]["Frame"] - scene.meshes[1].positions
    assert np.allclose(way, [0, 0, 1])
    (tmp_path / "room.gltf").write_text(json.dumps(file.json) + " ")
    with pytest.raises(SceneError, match=r"'room\.gltf' has changed since it was loaded"):
        declared_movers(["animation:Open=0..1"], scene)


def test_keys_are_interpolated_as_gltf_says(tmp_path):
    scene = room(tmp_path)
    rest = {mesh.name: mesh.positions for mesh in scene.meshes}
    # Second 1.5 of 4: half of the way; before the first key the first value holds.
    assert np.allclose(moved(scene, "animation:Open=0..1", 1.5 / 4)[0]["Frame"], rest["Frame"] + [0, 0, 0.5], atol=1e-6)
    assert np.allclose(moved(scene, "animation:Open=0..1", 0.1)[0]["Frame"], rest["Frame"], atol=1e-6)
    # Second 3: half of a quarter turn, an eighth.
    left = moved(scene, "animation:Open=0..1", 3 / 4)[0]["Left"] - [2, 0, 1]
    assert np.allclose(np.abs(left[:, [0, 2]]), HALF, atol=1e-5)
    spline = moved(room(tmp_path, interpolation="CUBICSPLINE"), "animation:Open=0..1", 1.25 / 4)[0]["Frame"]
    # Hermite with flat tangents at a quarter: 3/16 - 2/64.
    assert np.allclose(spline - rest["Frame"], [0, 0, 3 / 16 - 2 / 64], atol=1e-3)
    step = moved(room(tmp_path, interpolation="STEP"), "animation:Open=0..1", 1.9 / 4)[0]["Frame"]
    assert np.allclose(step, rest["Frame"], atol=1e-6)


def test_a_stretch_of_a_clip_may_run_backwards(tmp_path):
    scene = room(tmp_path)
    first, mover = moved(scene, "animation:Open=0.5..0", 0.0)
    assert [part.name for part in mover.parts] == ["Frame", "Left"]
    assert mover.caption(0.5) == "Open at 25 %"
    assert np.allclose(first["Frame"][:, 2], 1) and np.allclose(first["Left"][:, 2], 1), "the leaf turns later"
    last = moved(scene, "animation:Open=0.5..0", 1.0)[0]["Frame"]
    assert np.allclose(last[:, 2], 0)


def test_a_stretch_between_two_keys_moves_too(tmp_path):
    _, mover = moved(room(tmp_path), "animation:Open=0.26..0.27", 0.5)
    assert [part.name for part in mover.parts] == ["Frame", "Left"]


@pytest.mark.parametrize(
    "more, text, message",
    [
        ({}, "animation:Opne=0..1", "has no clip 'Opne'; the nearest names are 'Open'"),
        ({"extra": [(3, "scale", [[1, 1, 1], [1, 1, 1], [2, 2, 2]])]}, "animation:Open=0..1", "scales node 'Right'"),
        ({}, "animation:Open=0..0.2", "moves no mesh and no light as a whole"),
        (
            {"extra": [(0, "translation", [[0, 0, 0], [0, 0, 0], [0, 9, 0]])]},
            "animation:Open=0..1",
            "moves every mesh of scene",
        ),
    ],
)
def test_clips_that_cannot_be_learned_are_refused(tmp_path, more, text, message):
    with pytest.raises(ValueError, match=message):
        declared_movers([text], room(tmp_path, **more))


def test_a_file_without_clips_or_with_damaged_ones_says_so_when_one_is_asked_for(tmp_path):
    with pytest.raises(ValueError, match="has no clips; move a node, for example"):
        declared_movers(["animation:Open=0..1"], load("doorway"))
    damaged = room(tmp_path, extra=[(3, "translation", [[0, 0, 0]])])
    with pytest.raises(ValueError, match="animation 0 sampler 2 has times that do not increase, or values"):
        declared_movers(["animation:Open=0..1"], damaged)


def test_a_clip_and_a_node_are_set_together(tmp_path):
    scene = room(tmp_path)
    movers = declared_movers(["animation:Open=0..1", "node:Wall.rotation=y:0..90"], scene)
    both = {mesh.name: mesh.positions for mesh in posed(with_movers(scene, movers), (1.0, 1.0)).meshes}
    assert np.allclose(both["Frame"][:, 2], 1) and np.allclose(both["Wall"][:, 0], 0, atol=1e-6)
    with pytest.raises(ValueError, match="'Open' and 'Left' move the same part"):
        declared_movers(["animation:Open=0..1", "node:Left.rotation=y:0..90"], scene)
