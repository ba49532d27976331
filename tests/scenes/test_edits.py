"""Edits of a scene: what they change, what they refuse, and that a bake takes them over."""

import json

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.baking.pipeline import loaded
from lightwell.baking.settings import BakeSettings
from lightwell.cache.live_scene import LiveScene
from lightwell.core.scene_edits import Paint, SceneEdits, read_edits
from lightwell.scenes import load
from lightwell.scenes.edits import can_paint, edited
from lightwell.scenes.glb_writer import GlbWriter

EDITS = SceneEdits(
    {3: (0.1, 0.0, -0.05)}, {7: 0.25}, {1: Paint((0.1, 0.2, 0.3), 0.5), 2: Paint(None, 0.7)}
)  # fmt: skip


def test_a_text_of_edits_is_read_as_it_was_written():
    assert SceneEdits.from_json(EDITS.to_json()) == EDITS and EDITS
    assert not SceneEdits()


@pytest.mark.parametrize(
    "text",
    [
        b"", b"\xff", b"[]", b"{", b"[" * 5000, b'{"other": {}}', b'{"moved": []}', b'{"moved": {"-1": [0, 0, 0]}}',
        b'{"moved": {"0": [0, 0]}}', b'{"moved": {"0": [0, 0, NaN]}}', b'{"moved": {"0": [0, 0, 1e300]}}',
        b'{"moved": {"0": "abc"}}', b'{"dimmed": {"0": -1}}', b'{"dimmed": {"0": true}}', b'{"painted": {"0": {}}}',
        b'{"painted": {"0": {"color": [0, 0, 2], "roughness": null}}}',
        b'{"painted": {"0": {"color": null, "roughness": 0}}}',
    ],
)  # fmt: skip
def test_what_is_no_file_of_edits_is_refused_in_one_line(tmp_path, text):
    file = tmp_path / "edits.json"
    file.write_bytes(text)
    with pytest.raises(ValueError, match="no file that 'lightwell live' wrote") as caught:
        read_edits(str(file))
    assert "\n" not in str(caught.value)


def test_a_missing_or_huge_file_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"name the edits\.json"):
        read_edits(str(tmp_path / "none.json"))
    (tmp_path / "huge.json").write_bytes(b" " * ((1 << 22) + 1))
    with pytest.raises(ValueError, match="larger than 4 MiB"):
        read_edits(str(tmp_path / "huge.json"))


@pytest.mark.parametrize(
    ("edits", "words"),
    [
        (SceneEdits(moved={99: (0, 0, 0)}), "no mesh 99"),
        (SceneEdits(painted={99: Paint()}), "no material 99"),
        (SceneEdits(dimmed={0: 0.5}), "mesh 0 .* is no lamp"),
    ],
)
def test_edits_of_another_scene_are_refused(edits, words):
    with pytest.raises(ValueError, match=words):
        edited(load("cornell"), edits)


def test_edits_change_records_and_what_is_traced():
    plain, scene = load("loft"), load("loft")
    lamp = next(k for k, shape in enumerate(scene.mi.shapes()) if shape.emitter() is not None)
    moved = next(k for k, mesh in enumerate(scene.meshes) if k != lamp and mesh.normals is not None)
    material = scene.meshes[moved].material
    found = edited(scene, SceneEdits({moved: (0.5, 0.0, 0.0)}, {lamp: 0.5}, {material: Paint((0.1, 0.2, 0.3), 0.4)}))
    assert found.digest != plain.digest and len(found.mi.emitters()) == len(plain.mi.emitters())
    shift = found.meshes[moved].positions - plain.meshes[moved].positions
    assert np.allclose(shift, (0.5, 0, 0), atol=1e-5)
    traced = mi.traverse(found.mi.shapes()[moved])
    before = mi.traverse(plain.mi.shapes()[moved])
    assert np.allclose(np.array(traced["vertex_positions"]).reshape(-1, 3), found.meshes[moved].positions, atol=1e-5)
    # Authored normals stay.
    assert np.array_equal(np.array(traced["vertex_normals"]), np.array(before["vertex_normals"]))
    assert np.allclose(found.meshes[lamp].emission, 0.5 * np.array(plain.meshes[lamp].emission))
    assert np.allclose(
        np.array(mi.traverse(found.mi.shapes()[lamp])["emitter.radiance.value"]),
        0.5 * np.array(mi.traverse(plain.mi.shapes()[lamp])["emitter.radiance.value"]),
    )
    record, old = found.materials[material], plain.materials[material]
    if old.base_color_texture is None:
        assert record.base_color[:3] == (0.1, 0.2, 0.3)
    assert record.roughness == 0.4 and can_paint(found.mi.shapes()[moved].bsdf())
    # The other lamps and materials are as they were.
    others = [k for k in range(len(plain.materials)) if k != material]
    assert [found.materials[k] for k in others] == [plain.materials[k] for k in others]


def test_a_bake_loads_the_edited_scene(tmp_path):
    (tmp_path / "edits.json").write_text(SceneEdits(moved={4: (0.1, 0, 0)}).to_json())
    read = read_edits(str(tmp_path / "edits.json"))
    scene = loaded(BakeSettings("cornell", tmp_path, edits=read))
    assert np.allclose(scene.meshes[4].positions - load("cornell").meshes[4].positions, (0.1, 0, 0), atol=1e-6)
    with pytest.raises(ValueError, match="leave it out, or --edits"):
        loaded(BakeSettings("cornell", tmp_path, edits=read, cluster="local:1"))


def test_the_live_scene_has_every_light_of_the_file(tmp_path):
    """Point, spot and directional lights of a file are no shapes; the live page once left them out."""
    writer = GlbWriter()
    floor = np.float32([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    writer.mesh("floor", {"POSITION": floor}, np.uint32([[0, 2, 1], [0, 3, 2]]), None)
    for kind in ("point", "directional"):
        writer.light({"type": kind, "intensity": 5.0, "color": [1, 1, 1]}, np.eye(4))
    path = tmp_path / "lit.glb"
    path.write_bytes(writer.encoded())
    scene = load(path)
    assert len(scene.mi.emitters()) == 2 and len(LiveScene(scene, 8).scene.emitters()) == 2


def test_edits_of_the_page_are_those_of_a_bake():
    """What the page renders after its edits is what a bake of its edits loads."""
    scene = load("cornell")
    live = LiveScene(scene, 8)
    live.move(4, np.array([0.05, 0, 0]))
    live.paint(0, (0.2, 0.4, 0.6), None)
    fresh = edited(load("cornell"), SceneEdits.from_json(json.dumps(json.loads(live.edits.to_json()))))
    here, there = (mi.traverse(shapes[4]) for shapes in (live.scene.shapes(), fresh.mi.shapes()))
    assert np.allclose(np.array(here["vertex_positions"]), np.array(there["vertex_positions"]), atol=1e-6)
    for key in here.keys():
        if key.endswith("reflectance.value"):
            assert np.allclose(np.array(here[key]), np.array(there[key]))
