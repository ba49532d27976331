"""Nodes that move: found by name, refused with the cure, and posed with what hangs on them."""

from __future__ import annotations

import numpy as np
import pytest
from gltf_builder import Builder

from lightwell.scenes import load
from lightwell.scenes.movers import NodeMover, pose_nodes
from lightwell.scenes.posing import declared_movers, posed, with_movers

TURN = "node:Door.rotation=y:0..90"


def room(tmp_path, **door):
    """A wall, and a door with a handle, a light and (on another node) a camera below it."""
    file = Builder()
    for _ in range(3):
        file.mesh(node=False)
    light = {"KHR_lights_punctual": {"light": 0}}
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "spot", "name": "beam", "spot": {}}]}}
    file.json["extensionsUsed"] = ["KHR_lights_punctual"]
    file.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]
    file.json["animations"] = [{"name": "Swing", "channels": [], "samplers": []}]
    nodes = [
        {"name": "Wall", "mesh": 0},
        {"name": "Door", "mesh": 1, "translation": [2, 0, 0], "children": [2, 3], **door},
        {"name": "Handle", "mesh": 2, "translation": [1, 0, 0]},
        {"name": "Beam", "extensions": light},
        {"name": "Tripod", "children": [5]},
        {"name": "Eye", "camera": 0},
        {"name": "Nothing"},
        {"name": "House", "children": [0, 1, 4, 6]},
        {"name": "Twin"},
        {"name": "Twin"},
    ]
    file.json["nodes"] = nodes
    file.json["scenes"] = [{"nodes": [7, 8, 9]}]
    return load(file.save(tmp_path))


def test_the_tree_of_a_file_is_kept(tmp_path):
    scene = room(tmp_path)
    names = [node.name for node in scene.nodes]
    door, handle = names.index("Door"), names.index("Handle")
    assert scene.nodes[handle].parent == door and scene.nodes[door].parent == names.index("House")
    assert [scene.meshes[k].name for k in scene.nodes[handle].meshes] == ["Handle"]
    assert scene.nodes[names.index("Eye")].cameras == ("Eye",) and scene.clips == ("Swing",)


def test_a_door_turns_about_its_own_origin_with_its_children(tmp_path):
    scene = room(tmp_path)
    (mover,) = declared_movers([TURN, "light.radius=0.1"], scene)
    assert mover.pivot == (2, 0, 0) and mover.axis == (0, 1, 0) and (mover.low, mover.high) == (0, 90)
    open_ = posed(with_movers(scene, (mover,)), (1.0,))
    by_name = {mesh.name: mesh for mesh in open_.meshes}
    # The square of ±1 about the door's origin turns from the x axis to the -z axis.
    expected = {(2, -1, 1), (2, -1, -1), (2, 1, -1), (2, 1, 1)}
    assert {tuple(p) for p in by_name["Door"].positions.round(5).tolist()} == expected
    assert by_name["Handle"].positions[:, 2].min() == pytest.approx(-2, abs=1e-5)
    assert np.array_equal(by_name["Wall"].positions, scene.meshes[0].positions)
    # The light shines along -z at rest; its node stands at the door's origin.
    assert np.allclose(open_.lights[0].direction, (-1, 0, 0), atol=1e-6) and open_.lights[0].position == (2, 0, 0)
    assert open_.mi.shapes()[1].bbox().min.x == pytest.approx(2, abs=1e-5)
    assert open_.movers == () and open_.digest != posed(with_movers(scene, (mover,)), (0.5,)).digest


def test_a_rest_pose_is_the_scene_itself(tmp_path):
    scene = with_movers(room(tmp_path), declared_movers([TURN], room(tmp_path)))
    shut = posed(scene, (0.0,))
    assert all(np.array_equal(a.positions, b.positions) for a, b in zip(shut.meshes, scene.meshes))
    assert posed(scene, (0.0,)) is shut


def test_a_translation_follows_the_axes_of_the_parent(tmp_path):
    scene = room(tmp_path)
    scene.nodes[0].matrix[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    (mover,) = declared_movers(["node:Door.translation=(0,0,0.5)..(0,0,2)"], scene)
    assert (mover.low, mover.high, mover.unit) == (0, 1.5, "metres")
    assert np.allclose(mover.moved(1.0, [[0, 0, 0]]), [[2, 0, 0]])
    assert np.allclose(mover.moved(0.0, [[0, 0, 0]]), [[0.5, 0, 0]])


@pytest.mark.parametrize(
    "text, message",
    [
        ("node:Dor.rotation=y:0..90", "scene 'room.glb' has no node 'Dor'; the nearest names are 'Door'"),
        (
            "node:Eye.rotation=y:0..90",
            "node 'Eye' carries camera 'Eye', which cannot move; name a node without a camera",
        ),
        ("node:Tripod.rotation=y:0..90", "node 'Tripod' carries camera 'Eye'"),
        ("node:Nothing.rotation=y:0..90", "node 'Nothing' carries no mesh and no light"),
        ("node:Twin.rotation=y:0..90", "has 2 nodes 'Twin'; give each a name of its own"),
        ("node:House.translation=(0,0,0)..(1,0,0)", "node 'House' carries camera 'Eye'"),
        ("node:Scene.translation=(0,0,0)..(1,0,0)", "has no node 'Scene'"),
    ],
)
def test_what_cannot_move_is_refused(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        declared_movers([text], room(tmp_path))


def test_several_nodes_move_but_no_part_twice(tmp_path):
    scene, wall = room(tmp_path), "node:Wall.rotation=y:0..90"
    assert [mover.name for mover in declared_movers([TURN, wall], scene)] == ["Door", "Wall"]
    with pytest.raises(ValueError, match="'Door' and 'Handle' move the same part; declare one of them"):
        declared_movers([TURN, "node:Handle.rotation=y:0..90"], scene)
    with pytest.raises(ValueError, match="4 things move, more than 3; bake fewer of them together"):
        declared_movers([wall] * 4, scene)


def test_an_uneven_scale_would_shear_the_door(tmp_path):
    with pytest.raises(ValueError, match="scaled unevenly, so that it would not stay rigid; apply its scale"):
        declared_movers([TURN], room(tmp_path, scale=[1, 2, 1]))


def test_scenes_without_nodes_say_so(cornell_xml):
    with pytest.raises(ValueError, match=r"has no nodes that could move; use a \.glb or \.gltf file"):
        declared_movers([TURN], cornell_xml)


@pytest.fixture
def cornell_xml():
    from dataclasses import replace

    return replace(load("cornell"), nodes=())


def test_motions_are_rigid_and_end_where_they_should():
    mover = NodeMover("Door", "rotation", (0.6, 0.0, 0.8), (1.0, 2.0, 3.0), -20.0, 100.0, (0,))
    turn, offset = mover.motion(np.array([0.0, mover.slider(0.0), 1.0]))
    assert np.allclose(turn @ turn.transpose(0, 2, 1), np.eye(3)) and np.allclose(np.linalg.det(turn), 1)
    assert np.allclose(turn[1], np.eye(3)) and np.allclose(offset[1], 0)
    assert np.allclose(turn @ np.array(mover.pivot) + offset, mover.pivot)
    assert np.degrees(np.arccos((np.trace(turn[2]) - 1) / 2)) == pytest.approx(100)
    assert mover.caption(1.0) == "Door at 100°" and mover.initial == pytest.approx(1 / 6)


def test_poses_are_dense_at_both_end_stops():
    poses = pose_nodes(16)[:, 0]
    assert poses[0] == 0 and poses[-1] == 1 and np.all(np.diff(poses) > 0)
    assert np.allclose(poses, 1 - poses[::-1]) and poses[1] < 0.02 < np.diff(poses).max() < 0.11


def test_a_shut_door_is_dark_in_a_picture_and_an_open_one_is_not(tmp_path):
    from lightwell.rendering.path import render_path
    from lightwell.rendering.settings import RenderSettings

    def mean(degrees: float, **more) -> float:
        picture = {"scene": "doorway", "out": tmp_path / "door.exr", "size": (16, 10), "spp": 16}
        state = (f"node:Door.rotation={degrees}", "light=0")
        return render_path(RenderSettings(**picture, set=state, **more))["mean_radiance"]

    # What little comes through the joint of the leaf is far below a thousandth.
    assert mean(0) < 1e-5 < 1e-2 < mean(80)
    with pytest.raises(ValueError, match="lies outside of what --vary declares; give 0 to 60 degrees"):
        mean(80, vary=("node:Door.rotation=y:0..60",))
