"""A node that moves, as a variable of an asset."""

from __future__ import annotations

import json
from copy import deepcopy

import pytest

from lightwell.asset.container import read_file
from lightwell.asset.export import export_field
from lightwell.asset.read import read_fields
from lightwell.asset.records import EXTENSION, FieldEntry
from lightwell.asset.schema import validate
from lightwell.asset.validate import validate_file
from lightwell.asset.write import write_glb
from lightwell.engines.bake import read_bake
from lightwell.graph import Builder
from lightwell.scenes import load
from lightwell.scenes.posing import declared_mover, posed, with_mover


def field() -> FieldEntry:
    b = Builder(rest_position=3, rest_normal=3, pose=1)
    frame = b.concat("pose", "pose", "pose", per_frame=True)
    return FieldEntry("static", "static", b.build(radiance=b.add(b.multiply("rest_position", "rest_normal"), frame)))


def written(path, vary: str):
    scene = load("doorway")
    scene = with_mover(scene, declared_mover([vary], scene))
    write_glb(path, scene, [field()], [], pose=0.5)
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
    other = with_mover(again, declared_mover([vary.replace("Door", node.name)], again))
    for t in (0.0, 1.0):
        assert distance(posed(scene, t), posed(other, t)) < 1e-5


LIGHT = {"name": "l", "kind": "sun", "start": [1, 0, 0], "middle": [0, 1, 0], "end": [-1, 0, 0]}
LIGHT |= {"initial": [0, 1, 0], "intensity": 1, "color": [1, 1, 1]}


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda e: e["variables"].append(LIGHT), "lights come before nodes"),
        (lambda e: e["variables"][0].update(range=[0, 10], initial=45), "a range that is not empty and holds initial"),
        (lambda e: e["variables"][0].update(axis=[0, 2, 0]), r"variables\[0\].axis: expected a unit vector"),
        (lambda e: e["variables"][0].update(unit="metres"), r"variables\[0\].unit: 'degrees' was expected"),
        (lambda e: e["variables"].clear(), "graph.inputs.pose: width 1, expected 0, 1 a node"),
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


def test_exports_say_that_they_know_one_pose(tmp_path):
    path = tmp_path / "scene.glb"
    written(path, "node:Door.rotation=y:0..90")
    for export in (lambda: export_field(path, to="glsl"), lambda: read_bake(path)):
        with pytest.raises(ValueError, match="export: field 'static' follows a node that moves"):
            export()
