"""glTF files: geometry, nodes, compression, lights and cameras."""

import base64
import math

import DracoPy
import meshopt
import numpy as np
import pytest
from gltf_builder import SQUARE, SQUARE_INDICES, SQUARE_UV, Builder

from lightwell.scenes import SceneError, load
from lightwell.scenes.gltf_geometry import triangles


def face_normals(mesh):
    a, b, c = (mesh.positions[mesh.indices[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def test_nodes_compose_and_mirrored_instances_stay_the_right_way_out(tmp_path):
    file = Builder()
    number = file.mesh(normals=np.tile([0, 0, 1], (4, 1)), node=False)
    half = math.sqrt(0.5)
    file.json["nodes"] = [
        {"name": "parent", "translation": [0, 0, 5], "rotation": [0, half, 0, half], "children": [1, 2]},
        {"name": "plain", "mesh": number, "scale": [2, 1, 1], "translation": [1, 0, 0]},
        {"name": "mirrored", "mesh": number, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 3, 0, 1]},
    ]
    scene = load(file.save(tmp_path))
    plain, mirrored = scene.meshes
    assert [m.name for m in scene.meshes] == ["plain", "mirrored"]
    # A quarter turn about Y takes +X to -Z and +Z to +X.
    corner = np.array([-1 * 2 + 1, -1, 0])
    np.testing.assert_allclose(plain.positions[0], [corner[2], corner[1], -corner[0] + 5], atol=1e-6)
    for mesh in (plain, mirrored):
        np.testing.assert_allclose(mesh.normals, np.tile([1, 0, 0], (4, 1)), atol=1e-6)
        np.testing.assert_allclose(face_normals(mesh), np.tile([1, 0, 0], (2, 1)), atol=1e-6)
    np.testing.assert_allclose(mirrored.positions[:, 1], SQUARE[:, 1] + 3, atol=1e-6)


def test_a_skinned_mesh_stands_where_its_joints_hold_it(tmp_path):
    file = Builder()
    joints = file.accessor(np.tile(np.uint8([0, 1, 0, 0]), (4, 1)))
    weights = file.accessor(np.float32([[1, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0]]))
    bind = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    bind[:, 3, 1] = -1  # column-major: a step of -1 along y
    inverse = file.accessor(bind.reshape(2, 16)[:, :4])
    file.json["accessors"][inverse].update(bufferView=file.view(bind.tobytes()), type="MAT4")
    skin = file.add("skins", {"joints": [1, 2], "inverseBindMatrices": inverse})
    number = file.mesh(attributes={"JOINTS_0": joints, "WEIGHTS_0": weights}, node=False)
    file.json["nodes"] = [
        {"mesh": number, "skin": skin, "translation": [100, 0, 0]},
        {"translation": [0, 1, 0], "children": [2]},
        {"translation": [0, 0, 4], "scale": [2, 1, 1]},
    ]
    (mesh,) = load(file.save(tmp_path)).meshes
    # The first joint undoes its bind step; the second also stretches x and moves along z.
    expected = SQUARE * [[1, 1, 1], [1, 1, 1], [2, 1, 1], [1.5, 1, 1]] + [[0, 0, 0], [0, 0, 0], [0, 0, 4], [0, 0, 2]]
    np.testing.assert_allclose(mesh.positions, expected, atol=1e-6)


def test_a_vertex_without_weights_is_held_by_its_first_joint(tmp_path):
    file = Builder()
    joints = file.accessor(np.tile(np.uint8([0, 0, 0, 0]), (4, 1)))
    weights = file.accessor(np.float32([[1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [0, 0, 0, 0]]))
    skin = file.add("skins", {"joints": [1]})
    number = file.mesh(attributes={"JOINTS_0": joints, "WEIGHTS_0": weights}, node=False)
    file.json["nodes"] = [{"mesh": number, "skin": skin}, {"translation": [0, 0, 9]}]
    (mesh,) = load(file.save(tmp_path)).meshes
    np.testing.assert_allclose(mesh.positions, SQUARE + np.array([0, 0, 9]), atol=1e-6)


def test_all_eight_joints_hold_a_vertex(tmp_path):
    file = Builder()
    first, more = (file.accessor(np.tile(np.uint8([joint, 0, 0, 0]), (4, 1))) for joint in (0, 1))
    half = [file.accessor(np.tile(np.float32([0.5, 0, 0, 0]), (4, 1))) for _ in range(2)]
    attributes = {"JOINTS_0": first, "WEIGHTS_0": half[0], "JOINTS_1": more, "WEIGHTS_1": half[1]}
    number, skin = file.mesh(attributes=attributes, node=False), file.add("skins", {"joints": [1, 2]})
    file.json["nodes"] = [{"mesh": number, "skin": skin}, {}, {"translation": [0, 0, 8]}]
    (mesh,) = load(file.save(tmp_path)).meshes
    np.testing.assert_allclose(mesh.positions, SQUARE + np.array([0, 0, 4]), atol=1e-6)


def test_morph_targets_have_the_weights_of_the_node_or_else_of_the_mesh(tmp_path):
    file = Builder()
    steps = [np.tile(np.float32(step), (4, 1)) for step in ([0, 0, 2], [8, 0, 0])]
    number = file.mesh(targets=[{"POSITION": file.accessor(step)} for step in steps])
    file.json["meshes"][number]["weights"] = [0.5, 0]
    file.json["nodes"].append({"mesh": number, "weights": [0, 1], "translation": [0, 5, 0]})
    scene = load(file.save(tmp_path))
    np.testing.assert_allclose(scene.meshes[0].positions, SQUARE + np.array([0, 0, 1]), atol=1e-6)
    np.testing.assert_allclose(scene.meshes[1].positions, SQUARE + np.array([8, 5, 0]), atol=1e-6)
    assert "mesh 0 primitive 0: morph targets are kept as they are at rest" in scene.warnings


def test_hidden_nodes_are_not_shown(tmp_path):
    file = Builder()
    file.mesh()
    hidden = {"KHR_node_visibility": {"visible": False}}
    file.json["nodes"] += [{"extensions": hidden, "children": [2]}, {"mesh": 0, "name": "below"}]
    file.json["nodes"].append({"mesh": 0, "name": "seen", "extensions": {"KHR_node_visibility": {}}})
    file.json["extensionsUsed"] = ["KHR_node_visibility"]
    scene = load(file.save(tmp_path))
    assert [mesh.name for mesh in scene.meshes] == ["node 0", "seen"]
    assert not any("KHR_node_visibility" in w for w in scene.warnings)


def test_strips_and_fans():
    assert triangles(np.arange(5, dtype=np.uint32), 5).tolist() == [[0, 1, 2], [1, 3, 2], [2, 3, 4]]
    assert triangles(np.arange(5, dtype=np.uint32), 6).tolist() == [[1, 2, 0], [2, 3, 0], [3, 4, 0]]
    assert triangles(np.arange(7, dtype=np.uint32), 4).tolist() == [[0, 1, 2], [3, 4, 5]]
    assert triangles(np.arange(2, dtype=np.uint32), 5).shape == (0, 3)


def test_other_modes_are_skipped_with_a_warning(tmp_path):
    file = Builder()
    file.mesh()
    file.mesh(mode=1)
    scene = load(file.save(tmp_path))
    assert len(scene.meshes) == 1
    assert "mesh 1 primitive 0: lines are skipped, only triangles are loaded" in scene.warnings


def test_sparse_and_quantized_attributes(tmp_path):
    file = Builder()
    quantized = (SQUARE * 127).astype(np.int8)
    position = file.accessor(np.concatenate([quantized, np.zeros((4, 1), np.int8)], axis=1), normalized=True)
    file.json["accessors"][position]["type"] = "VEC3"
    file.json["bufferViews"][0]["byteStride"] = 4
    uv = file.accessor((SQUARE_UV * 65535).astype(np.uint16), normalized=True)
    moved = file.view(np.uint16([2]).tobytes()), file.view(np.int8([127, 127, 64, 0]).tobytes())
    file.json["accessors"][position]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": moved[0], "componentType": 5123},
        "values": {"bufferView": moved[1]},
    }
    file.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    file.mesh(attributes={"POSITION": position, "TEXCOORD_0": uv})
    mesh = load(file.save(tmp_path)).meshes[0]
    expected = SQUARE.copy()
    expected[2, 2] = 64 / 127
    np.testing.assert_allclose(mesh.positions, expected, atol=1e-6)
    np.testing.assert_allclose(mesh.uv0, SQUARE_UV, atol=1e-6)


def test_draco(tmp_path):
    rng = np.random.default_rng(1)
    points = rng.random((30, 3)).astype(np.float32)
    faces = np.arange(30, dtype=np.uint32).reshape(10, 3)
    uv = rng.random((30, 2))
    data = DracoPy.encode(points, faces, quantization_bits=16, preserve_order=True, tex_coord=uv)
    ids = {a["attribute_type"]: a["unique_id"] for a in DracoPy.decode(data).attributes}
    file = Builder()
    view = file.view(data)
    attributes = {}
    for name, width in (("POSITION", "VEC3"), ("TEXCOORD_0", "VEC2")):
        attributes[name] = file.add("accessors", {"componentType": 5126, "count": 30, "type": width})
    names = {"POSITION": ids[DracoPy.AttributeType.POSITION], "TEXCOORD_0": ids[DracoPy.AttributeType.TEX_COORD]}
    extension = {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": names}}
    file.add("meshes", {"primitives": [{"attributes": attributes, "extensions": extension}]})
    file.add("nodes", {"mesh": 0})
    file.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    mesh = load(file.save(tmp_path)).meshes[0]
    # 16 bits over a range of 1 are off by at most 2^-17, plus rounding.
    np.testing.assert_allclose(mesh.positions[mesh.indices], points[faces], atol=2e-5)
    np.testing.assert_allclose(mesh.uv0[mesh.indices], uv[faces], atol=2e-5)
    # Copies are counted by what the accessors say.
    file.json["accessors"][0]["count"] = 3
    with pytest.raises(SceneError, match="has 30 POSITION in its compressed data, but accessor 0 says 3"):
        load(file.save(tmp_path))


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt(tmp_path, name):
    file = Builder()
    indices = SQUARE_INDICES.astype(np.uint32)
    packed = [
        (meshopt.encode_gltf_buffer(SQUARE, "ATTRIBUTES"), "ATTRIBUTES", 4, 12),
        (meshopt.encode_gltf_buffer(indices, "TRIANGLES"), "TRIANGLES", 6, 2),
    ]
    file.data += b""
    for data, mode, count, stride in packed:
        number = file.view(bytes(data))
        view = file.json["bufferViews"][number]
        view["extensions"] = {name: {**view, "mode": mode, "count": count, "byteStride": stride}}
        view.update(buffer=1, byteOffset=0, byteLength=count * stride)
    file.add("accessors", {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"})
    file.add("accessors", {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"})
    file.add("meshes", {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]})
    file.add("nodes", {"mesh": 0})
    file.json["extensionsRequired"] = [name]
    mesh = load(file.save(tmp_path)).meshes[0]
    corners, expected = (np.sort(m.reshape(2, -1), axis=1) for m in (mesh.positions[mesh.indices], SQUARE[indices]))
    np.testing.assert_array_equal(corners, expected)


def test_meshopt_octahedral_normals(tmp_path):
    # Octahedral normals of 8 bits: x, y, and the scale of 1 (127) in the third component.
    packed = np.int8([[0, 0, 127, 0]] * 4)
    data = meshopt.encode_gltf_buffer(packed, "ATTRIBUTES")
    file = Builder()
    number = file.view(bytes(data))
    view = file.json["bufferViews"][number]
    view["extensions"] = {
        "EXT_meshopt_compression": {**view, "mode": "ATTRIBUTES", "filter": "OCTAHEDRAL", "count": 4, "byteStride": 4}
    }
    view.update(byteLength=16, byteStride=4)
    normal = file.add(
        "accessors", {"bufferView": number, "componentType": 5120, "normalized": True, "count": 4, "type": "VEC3"}
    )
    file.mesh(attributes={"NORMAL": normal})
    np.testing.assert_allclose(load(file.save(tmp_path)).meshes[0].normals, np.tile([0, 0, 1], (4, 1)), atol=1e-6)


def test_data_uri_and_external_buffers(tmp_path):
    file = Builder()
    file.mesh()
    data = bytes(file.data)
    file.bytes()
    import json

    for uri in ("data:application/octet-stream;base64," + base64.b64encode(data).decode(), "a%20mesh.bin"):
        (tmp_path / "a mesh.bin").write_bytes(data)
        file.json["buffers"] = [{"byteLength": len(data), "uri": uri}]
        path = tmp_path / "room.gltf"
        path.write_text(json.dumps(file.json))
        np.testing.assert_array_equal(load(path).meshes[0].positions, SQUARE)


def test_the_digest_follows_external_files(tmp_path):
    import json

    file = Builder()
    file.mesh()
    data = bytearray(file.data)
    file.bytes()
    file.json["buffers"] = [{"byteLength": len(data), "uri": "mesh.bin"}]
    (tmp_path / "room.gltf").write_text(json.dumps(file.json))
    digests = []
    for last in (0, 0, 1):
        data[0] = last  # the lowest bits of the first coordinate
        (tmp_path / "mesh.bin").write_bytes(data)
        digests.append(load(tmp_path / "room.gltf").digest)
    assert digests[0] == digests[1] != digests[2]
    assert len(digests[0]) == 64


def test_cameras_and_lights(tmp_path):
    file = Builder()
    file.mesh()
    file.add("cameras", {"type": "perspective", "perspective": {"yfov": math.radians(40), "znear": 0.1}})
    file.add("cameras", {"type": "orthographic", "orthographic": {}})
    half = math.sqrt(0.5)
    down = [-half, 0, 0, half]
    file.json["nodes"] += [
        {"name": "eye", "camera": 0, "translation": [0, 0, 4]},
        {"name": "plan", "camera": 1},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 2, 0], "rotation": down},
        {"name": "sun", "extensions": {"KHR_lights_punctual": {"light": 1}}, "rotation": down},
    ]
    lights = [
        {"type": "spot", "name": "lamp", "intensity": 30, "color": [1, 0.5, 0.25], "spot": {"outerConeAngle": 0.5}},
        {"type": "directional", "intensity": 7},
    ]
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    scene = load(file.save(tmp_path))
    (eye,) = scene.cameras
    assert (eye.name, eye.position, eye.target) == ("eye", (0, 0, 4), (0, 0, 3))
    assert eye.fov_y == pytest.approx(40)
    lamp, sun = scene.lights
    assert (lamp.name, lamp.intensity, lamp.color, lamp.position) == ("lamp", 30, (1, 0.5, 0.25), (0, 2, 0))
    np.testing.assert_allclose([lamp.direction, sun.direction], [[0, -1, 0]] * 2, atol=1e-6)
    assert (sun.name, sun.kind, sun.intensity) == ("sun", "directional", 7)
    assert "camera 'plan': only perspective cameras are loaded" in scene.warnings


def test_an_outline_hull_is_left_out(tmp_path):
    file = Builder()
    file.mesh()
    file.mesh(material=file.add("materials", {"name": "Outline"}))
    scene = load(file.save(tmp_path))
    assert len(scene.meshes) == 1
    assert any(w.startswith("material 'Outline': a drawn outline") for w in scene.warnings)
