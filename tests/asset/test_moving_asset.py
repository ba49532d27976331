"""A node that moves, as a variable of an asset."""

from __future__ import annotations

import json
from copy import deepcopy

import numpy as np
import pytest

from lightwell.asset.container import pack, read_file
from lightwell.asset.export import export_field
from lightwell.asset.read import read_fields
from lightwell.asset.records import EXTENSION, FieldEntry
from lightwell.asset.schema import validate
from lightwell.asset.validate import validate_file
from lightwell.asset.write import write_glb
from lightwell.engines.bake import read_bake
from lightwell.graph import Builder as GraphBuilder
from lightwell.scenes import load
from lightwell.scenes.posing import declared_movers, posed, with_movers
from tests.scenes.gltf_builder import Builder


def field() -> FieldEntry:
    b = GraphBuilder(rest_position=3, rest_normal=3, pose=1)
    frame = b.concat("pose", "pose", "pose", per_frame=True)
    return FieldEntry("static", "static", b.build(radiance=b.add(b.multiply("rest_position", "rest_normal"), frame)))


def written(path, vary: str):
    scene = load("doorway")
    scene = with_movers(scene, declared_movers([vary], scene))
    write_glb(path, scene, [field()], [], pose=(0.5,))
    return scene


def distance(first, second) -> float:
    """Largest distance of a vertex, mesh by mesh of one name."""
    other = {mesh.name: mesh for mesh in second.meshes}
    return max(float(abs(mesh.positions - other[mesh.name].positions).max()) for mesh in first.meshes)


@pytest.mark.parametrize(
    "vary, unit, initial",
    [("node:Door.rotation=y:0..90", "degrees", 45.0), ("node:Door.translation=(0,0,0)..(0,0,1)", "metres", 0.5)],
)
def test_the_door_of_a_file_is_a_node_that_moves_all_it_carries(tmp_path, vary, unit, initial):
    path = tmp_path / "scene.glb"
    scene = written(path, vary)
    fields, variables = read_fields(path)
    (door,) = variables
    assert (door["kind"], door["name"], door["unit"], door["initial"]) == ("node", "Door", unit, initial)
    assert fields[0].graph.inputs["pose"] == 1 and not validate_file(path)
    document, _ = read_file(path)
    assert document["extensions"][EXTENSION]["version"] == 2
    # Loaded again, the file is at rest where it was, and its node moves to the same poses.
    again = load(path)
    assert distance(scene, again) < 1e-6
    node = again.nodes[[n.name for n in again.nodes].index("Door mover")]
    other = with_movers(again, declared_movers([vary.replace("Door", node.name)], again))
    for t in (0.0, 1.0):
        assert distance(posed(scene, (t,)), posed(other, (t,))) < 1e-5


def clip_scene(tmp_path):
    """Two leaves that a clip opens, and a wall."""
    file = Builder()
    for _ in range(3):
        file.mesh(node=False)
    times = file.accessor(np.float32([0, 1, 3]))
    half = np.sqrt(0.5)
    turns = file.accessor(np.float32([[0, 0, 0, 1], [0, 0, 0, 1], [0, half, 0, half]]))
    ways = file.accessor(np.float32([[-2, 0, 0], [-2, 0, 1], [-2, 0, 1]]))
    samplers = [{"input": times, "output": turns}, {"input": times, "output": ways}]
    channels = [
        {"sampler": 0, "target": {"node": 1, "path": "rotation"}},
        {"sampler": 1, "target": {"node": 2, "path": "translation"}},
    ]
    file.json["animations"] = [{"name": "Open", "channels": channels, "samplers": samplers}]
    file.json["nodes"] = [
        {"name": "Wall", "mesh": 0},
        {"name": "Left", "mesh": 1, "translation": [2, 0, 0]},
        {"name": "Right", "mesh": 2, "translation": [-2, 0, 0]},
    ]
    return load(file.save(tmp_path))


def test_a_clip_becomes_an_animation_that_any_viewer_plays(tmp_path):
    scene = clip_scene(tmp_path)
    scene = with_movers(scene, declared_movers(["animation:Open=1..0.25", "node:Wall.rotation=y:0..30"], scene))
    b = GraphBuilder(rest_position=3, rest_normal=3, pose=2)
    frame = b.linear("pose", np.ones((3, 2), np.float32), np.zeros(3, np.float32), per_frame=True)
    graph = b.build(radiance=b.add(b.multiply("rest_position", "rest_normal"), frame))
    path = tmp_path / "scene.glb"
    write_glb(path, scene, [FieldEntry("static", "static", graph)], [], pose=(0.5, 0.0))
    assert not validate_file(path)
    clip, wall = read_fields(path)[1]
    assert (clip["kind"], clip["range"], clip["initial"], clip["unit"]) == ("clip", [1.0, 0.25], 0.625, "share")
    assert wall["kind"] == "node"
    again = load(path)
    assert distance(scene, again) < 1e-6 and again.clips == ("Open",)
    other = with_movers(again, declared_movers(["animation:Open=1..0.25", "node:Wall mover.rotation=y:0..30"], again))
    for pose in ((0.0, 0.0), (0.3, 1.0), (0.77, 0.5), (1.0, 0.0)):
        assert distance(posed(scene, pose), posed(other, pose)) < 1e-5


LIGHT = {"name": "l", "kind": "sun", "start": [1, 0, 0], "middle": [0, 1, 0], "end": [-1, 0, 0]}
LIGHT |= {"initial": [0, 1, 0], "intensity": 1, "color": [1, 1, 1]}


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda e: e["variables"].append(LIGHT), "lights come before nodes and clips"),
        (lambda e: e["variables"][0].update(range=[0, 10], initial=45), "a range that is not empty and holds initial"),
        (lambda e: e["variables"][0].update(axis=[0, 2, 0]), r"variables\[0\].axis: expected a unit vector"),
        (lambda e: e["variables"][0].update(unit="metres"), r"variables\[0\].unit: 'degrees' was expected"),
        (lambda e: e["variables"].clear(), "graph.inputs.pose: width 1, expected 0, 1 a node or clip"),
        (lambda e: e.update(version=1), "version|kind|variables"),
        (lambda e: e["fields"][0].update(role="indirect", variable=0), "there is no light 0"),
    ],
)
def test_files_that_break_the_rules_are_refused(tmp_path, change, message):
    path = tmp_path / "scene.glb"
    written(path, "node:Door.rotation=y:0..90")
    extension = deepcopy(read_file(path)[0]["extensions"][EXTENSION])
    validate(json.loads(json.dumps(extension)))
    change(extension)
    with pytest.raises(ValueError, match=message):
        validate(extension)


def test_what_moves_must_be_in_the_file(tmp_path):
    path = tmp_path / "scene.glb"
    written(path, "node:Door.rotation=y:0..90")
    document, binary = read_file(path)
    (door,) = document["extensions"][EXTENSION]["variables"]
    door["node"] = len(document["nodes"])
    path.write_bytes(pack(document, binary))
    assert validate_file(path) == [f"variables[0].node: there is no node {door['node']}; name one of the file"]
    clip = {"name": "Open", "kind": "clip", "animation": 0, "range": [0, 1], "unit": "share", "initial": 0}
    document["extensions"][EXTENSION]["variables"] = [clip]
    channel = {"sampler": 0, "target": {"node": 0, "path": "rotation"}}
    for animations, problem in (
        ([], "there is no animation 0; name one of the file"),
        ([{"channels": [channel | {"target": {"node": 0, "path": "scale"}}]}], "more than rotations and translations"),
        ([{"channels": [channel | {"target": {"node": 999, "path": "rotation"}}]}], "moves a node that is not there"),
        ([{"channels": [channel]}], None),
    ):
        path.write_bytes(pack(document | {"animations": animations}, binary))
        found = validate_file(path)
        assert not found if problem is None else len(found) == 1 and problem in found[0]


def test_a_shader_takes_the_pose_and_says_its_range(tmp_path):
    path = tmp_path / "scene.glb"
    written(path, "node:Door.rotation=y:0..90")
    text = export_field(path, to="glsl").text
    assert "vec3 lightwell(vec3 rest_position, vec3 rest_normal, float pose)" in text
    assert "1 at the last (Door, 0 to 90 degrees)" in text


def test_engines_say_that_they_know_one_pose(tmp_path):
    path = tmp_path / "scene.glb"
    written(path, "node:Door.rotation=y:0..90")
    with pytest.raises(ValueError, match=r"export: field 'static' follows a node that moves.*--to gdshader"):
        read_bake(path)
