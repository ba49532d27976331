"""The written GLB: valid glTF 2.0, faithful to the records, whole or absent."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset import geometry
from lightwell.asset.container import unpack
from lightwell.asset.exposure import declare_exposure, declared_exposure
from lightwell.asset.materials import texture_transform
from lightwell.asset.records import EXTENSION
from lightwell.asset.write import glb_bytes, write_glb

HERE = Path(__file__).parent
# Issues that are right to remain: the extension is unknown to the validator, and scenes carry no tangents.
ACCEPTED = {"UNSUPPORTED_EXTENSION", "UNUSED_OBJECT", "MESH_PRIMITIVE_GENERATED_TANGENT_SPACE"}


def accessor(document, binary, index):
    types = {5121: "u1", 5120: "i1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
    entry = document["accessors"][index]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[entry["type"]]
    start = document["bufferViews"][entry["bufferView"]]["byteOffset"]
    assert start % 4 == 0
    array = np.frombuffer(binary, types[entry["componentType"]], entry["count"] * width, start)
    return array.reshape(-1, width) if width > 1 else array


def test_khronos_validator_finds_nothing(tmp_path, scene, entry, variable):
    root = HERE.parents[1] / "web"
    path = tmp_path / "room.glb"
    write_glb(path, scene, [entry], [variable])
    command = ["node", str(HERE / "validate.mjs"), str(path), str(root)]
    report = json.loads(subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout)
    assert report["issues"]["numErrors"] == 0, report["issues"]["messages"]
    assert {m["code"] for m in report["issues"]["messages"]} <= ACCEPTED
    assert report["info"]["totalTriangleCount"] == 8


def test_records_arrive(scene, entry, variable):
    document, binary = unpack(glb_bytes(scene, [entry], [variable]))
    floor = document["meshes"][0]["primitives"][0]
    np.testing.assert_array_equal(
        accessor(document, binary, floor["attributes"]["POSITION"]), scene.meshes[0].positions
    )
    np.testing.assert_array_equal(accessor(document, binary, floor["indices"]), scene.meshes[0].indices.reshape(-1))
    assert document["accessors"][floor["indices"]]["componentType"] == 5123
    normals = accessor(document, binary, floor["attributes"]["NORMAL"])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    assert document["accessors"][floor["attributes"]["POSITION"]]["max"] == [1.0, 0.0, 1.0]
    assert "NORMAL" not in document["meshes"][1]["primitives"][0]["attributes"]
    assert EXTENSION in document["extensionsUsed"] and "extensionsRequired" not in document
    assert document["asset"]["generator"].startswith("lightwell ")


def test_materials_arrive(scene, entry, variable):
    document, binary = unpack(glb_bytes(scene, [entry], [variable]))
    textured, glass, flat, lamp = document["materials"]
    assert textured["emissiveFactor"] == [1.0, 0.5, 0.0]
    assert textured["extensions"]["KHR_materials_emissive_strength"] == {"emissiveStrength": 2.0}
    assert textured["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] == 1
    assert document["extensions"]["LIGHTWELL_neural_radiance"]["glass"] is True
    assert glass["extensions"]["KHR_materials_ior"] == {"ior": 1.7} and glass["alphaMode"] == "BLEND"
    # The path tracer lights what is unlit in the scene's file, so that viewers must.
    assert "KHR_materials_unlit" not in json.dumps(document) and flat["alphaCutoff"] == 0.5 and flat["doubleSided"]
    assert lamp["emissiveFactor"] == [1.0, 1.0, 1.0]  # the lamp glows although its material does not say so
    assert len(document["images"]) == 2 and len(document["samplers"]) == 3
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    stored = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    assert stored == scene.materials[0].base_color_texture.image.data


def test_missing_uv_is_written_as_zeros(scene, entry, variable):
    scene.meshes[0] = replace(scene.meshes[0], uv0=None)
    document, binary = unpack(glb_bytes(scene, [entry], [variable]))
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    assert not accessor(document, binary, attributes["TEXCOORD_0"]).any()
    assert "TEXCOORD_0" not in document["meshes"][1]["primitives"][0]["attributes"]


def test_many_vertices_need_wide_indices():
    class Wide:
        positions, indices, name = np.zeros((65536, 3), np.float32), np.array([[0, 1, 65535]], np.uint32), "wide"

    assert geometry.compact_indices(Wide).dtype == np.uint32
    Wide.positions, Wide.indices = Wide.positions[1:], np.array([[0, 1, 65534]], np.uint32)
    assert geometry.compact_indices(Wide).dtype == np.uint16


def test_same_scene_same_bytes(scene, entry, variable):
    assert glb_bytes(scene, [entry], [variable]) == glb_bytes(scene, [entry], [variable])


def rotate(quaternion, vector):
    x, w = np.array(quaternion[:3]), quaternion[3]
    return vector + 2 * np.cross(x, np.cross(x, vector) + w * np.asarray(vector))


@pytest.mark.parametrize("direction", [(0, 0, -1), (0, 0, 1), (0, 1, 0), (0, -1, 0), (0.6, -0.8, 0), (1, 2, 3)])
def test_look_rotation(direction):
    quaternion = geometry.look_rotation(np.array(direction, float))
    expected = np.array(direction) / np.linalg.norm(direction)
    np.testing.assert_allclose(rotate(quaternion, [0, 0, -1]), expected, atol=1e-12)
    # Up leans to +Y as far as the direction lets it.
    assert rotate(quaternion, [0, 1, 0])[1] >= -1e-12


@pytest.mark.parametrize("scale", [(2.0, 0.5), (-1.0, 3.0), (0.0, 2.0)])
def test_texture_transform_is_offset_rotation_scale(scale):
    rotation, (su, sv) = 0.3, scale
    c, s = np.cos(rotation), np.sin(rotation)
    matrix = ((c * su, s * sv, 0.1), (-s * su, c * sv, 0.2), (0, 0, 1))
    got = texture_transform(matrix)
    c, s = np.cos(got.get("rotation", 0)), np.sin(got.get("rotation", 0))
    su, sv = got["scale"]
    again = ((c * su, s * sv, got["offset"][0]), (-s * su, c * sv, got["offset"][1]), (0, 0, 1))
    np.testing.assert_allclose(again, matrix, atol=1e-12)


def test_sheared_texture_transform_warns():
    with pytest.warns(UserWarning, match="texture transform is sheared"):
        texture_transform(((1, 0.5, 0), (0, 1, 0), (0, 0, 1)))


def test_broken_geometry_is_refused(scene, entry, variable):
    scene.meshes[0].positions[0, 0] = np.nan
    with pytest.raises(ValueError, match="mesh 'floor': positions contains NaN or infinity; repair"):
        glb_bytes(scene, [entry], [variable])


def test_wrong_extension_is_refused_before_writing(tmp_path, scene, entry, variable):
    variable["kind"] = "torch"
    with pytest.raises(
        ValueError, match=r"variables\[0\]\.kind: 'torch' is not one of \['point', 'sun', 'environment'\]"
    ):
        write_glb(tmp_path / "room.glb", scene, [entry], [variable])
    assert list(tmp_path.iterdir()) == []


def test_the_exposure_is_declared_in_place_of_an_earlier_one(tmp_path, scene, entry, variable):
    path = tmp_path / "scene.glb"
    write_glb(path, scene, [entry], [variable])
    before = unpack(path.read_bytes())
    for exposure in (2.5, 0.25):
        assert declare_exposure(path, exposure) == path.stat().st_size
    document, binary = unpack(path.read_bytes())
    assert document["extensions"][EXTENSION].pop("exposure") == 0.25
    assert (document, binary) == before


def test_a_file_is_written_with_its_exposure(tmp_path, scene, entry, variable):
    path = tmp_path / "scene.glb"
    assert declared_exposure(path) is None
    for exposure in (None, 2.5):
        write_glb(path, scene, [entry], [variable], exposure=exposure)
        assert declared_exposure(path) == exposure


@pytest.mark.parametrize("exposure", [0.0, -1.0, float("nan"), float("inf")])
def test_an_exposure_that_is_no_positive_number_is_refused(tmp_path, exposure):
    with pytest.raises(ValueError, match="expected a positive number"):
        declare_exposure(tmp_path / "scene.glb", exposure)
