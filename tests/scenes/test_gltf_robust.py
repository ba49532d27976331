"""glTF files that are hostile or imperfect: limits refuse before memory is taken, repairable faults are warnings."""

import time

import numpy as np
import pytest
from gltf_builder import SQUARE, SQUARE_INDICES, SQUARE_UV, Builder
from PIL import Image as PillowImage

from lightwell import basisu
from lightwell.limits import Limits
from lightwell.scenes import SceneError, load
from lightwell.scenes.default_light import under_sky


def refused(path, **limits) -> str:
    with pytest.raises(SceneError) as caught:
        load(path, limits=Limits(**limits))
    text = str(caught.value)
    assert "\n" not in text
    return text


def square(**primitive) -> Builder:
    file = Builder()
    file.mesh(uv=SQUARE_UV, **primitive)
    return file


# ------------------------------------------------------------------ limits


@pytest.mark.parametrize("count", [10**8, 10**12])
def test_an_accessor_without_bytes_is_counted(tmp_path, count):
    file = square()
    for accessor in file.json["accessors"]:
        accessor.update(count=count)
        del accessor["bufferView"]
    assert "--limit vertices=" in refused(file.save(tmp_path))


def test_indices_of_instances_are_counted(tmp_path):
    file = square()
    file.json["nodes"] = [{"mesh": 0} for _ in range(400)]
    assert "--limit indices=" in refused(file.save(tmp_path), indices=2399)
    load(file.save(tmp_path), limits=Limits(indices=2400))


def test_gpu_instances_are_counted_before_they_are_read(tmp_path):
    file = square()
    places = file.add("accessors", {"componentType": 5126, "count": 10**9, "type": "VEC3"})
    file.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}
    assert "--limit instances=" in refused(file.save(tmp_path))


def test_a_picture_counts_once_and_its_size_before_it_is_decoded(tmp_path):
    file = Builder()
    texture = file.texture(np.full((32, 64, 3), 200))
    image = file.add("images", dict(file.json["images"][0]))
    other = file.add("textures", {"source": image})
    used = {"baseColorTexture": texture, "metallicRoughnessTexture": {"index": other}}
    file.mesh(uv=SQUARE_UV, material=file.add("materials", {"pbrMetallicRoughness": used, "normalTexture": texture}))
    path = file.save(tmp_path)
    load(path, limits=Limits(texels=32 * 64))
    assert "image 0: 2048 texels" in refused(path, texels=32 * 64 - 1)
    assert "picture_edge" in refused(path, picture_edge=63)


def test_many_nodes_are_joined_into_few_meshes(tmp_path):
    file = square()
    file.json["nodes"] = [
        {"mesh": 0, "translation": [3 * i, 0, 0], "scale": [1 - 2 * (i % 2), 1, 1]} for i in range(5000)
    ]
    scene = load(file.save(tmp_path))
    (mesh,) = scene.meshes
    assert len(mesh.indices) == 10_000 and mesh.uv0.shape == (20_000, 2)
    assert scene.bounds.tolist() == [[-1, -1, 0], [3 * 4999 + 1, 1, 0]]
    # Mirrored copies keep their front.
    a, b, c = (mesh.positions[mesh.indices[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_lack_of_memory_is_one_line(tmp_path, monkeypatch):
    def fail(*args):
        raise MemoryError

    monkeypatch.setattr("lightwell.scenes.gltf.load_gltf", fail)
    assert "needs more memory than this machine has" in refused(square().save(tmp_path))


@pytest.mark.parametrize(
    "change",
    [
        lambda j: j.update(extensionsUsed=[[]]),
        lambda j: j.update(extensionsRequired=[{}]),
        lambda j: j["nodes"][0].update(name=[]),
        lambda j: j["nodes"][0].update(extensions=[]),
        lambda j: j["nodes"][0].update(mesh=[0]),
        lambda j: j["meshes"][0]["primitives"][0].update(attributes=["POSITION"]),
        lambda j: j["meshes"][0]["primitives"][0].update(material={}),
        lambda j: j["accessors"][0].update(type=["VEC3"]),
        lambda j: j["accessors"][0].update(componentType={}),
        lambda j: j["accessors"][0].update(normalized="yes"),
        lambda j: j.update(nodes={"0": {}}),
    ],
)
def test_wrong_types_are_one_line(tmp_path, change):
    file = square(material=0)
    file.add("materials", {})
    file.bytes()
    change(file.json)
    text = refused(file.save(tmp_path))
    assert text.startswith("scene 'room.glb': ")


# ------------------------------------------------------------------ repairs


def test_normals_that_are_not_finite_become_those_of_the_triangles(tmp_path):
    normals = np.float32([[0, 0, 1]] * 4)
    normals[2] = np.nan
    scene = load(square(normals=normals).save(tmp_path))
    np.testing.assert_allclose(scene.meshes[0].normals, [[0, 0, 1]] * 4, atol=1e-6)
    assert "mesh 0 primitive 0: 1 of 4 NORMAL are not finite numbers; those of the triangles are used" in scene.warnings


def test_a_node_without_size_stands_as_its_animation_shows_it(tmp_path):
    file = square()
    file.mesh()
    file.json["nodes"][0].update(name="horn", scale=[0, 0, 0])
    times, scales = file.accessor(np.float32([0, 1, 2])), file.accessor(np.float32([[0, 0, 0], [2, 2, 2], [9, 9, 9]]))
    channel = {"sampler": 0, "target": {"node": 0, "path": "scale"}}
    file.add("animations", {"channels": [channel], "samplers": [{"input": times, "output": scales}]})
    scene = load(file.save(tmp_path))
    assert scene.bounds.tolist() == [[-2, -2, 0], [2, 2, 0]]
    assert any(w.startswith("nodes horn: have scale 0 at rest; they stand as") for w in scene.warnings)


def test_quantized_positions_of_a_small_scale_are_no_node_without_size(tmp_path):
    """The scale of whole numbers is that of one step."""
    file = square()
    steps = np.uint16([[0, 0, 0], [16383, 0, 0], [16383, 16383, 0], [0, 16383, 0]])
    file.mesh(attributes={"POSITION": file.accessor(steps)})
    file.json["nodes"][1].update(name="cup", scale=[0.1 / 16383] * 3, translation=[5, 0, 0])
    scene = load(file.save(tmp_path))
    assert scene.bounds[1].tolist() == pytest.approx([5.1, 1, 0])
    assert not any("scale 0" in warning for warning in scene.warnings)


def test_gpu_instances_are_placed(tmp_path):
    file = square()
    places = file.accessor(np.float32([[0, 0, 0], [10, 0, 0]]))
    turns = file.accessor(np.float32([[0, 0, 0, 1], [0, 0, 1, 0]]))
    sizes = file.accessor(np.float32([[1, 1, 1], [3, 3, 3]]))
    attributes = {"TRANSLATION": places, "ROTATION": turns, "SCALE": sizes}
    file.json["nodes"][0].update(
        translation=[0, 5, 0], extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    )
    scene = load(file.save(tmp_path))
    assert scene.bounds.tolist() == [[-1, 2, 0], [13, 8, 0]]


def test_ktx2_and_missing_pictures_are_warnings(tmp_path):
    file = Builder()
    ktx = file.add("images", {"bufferView": file.view(bytes.fromhex("ab4b5458203230bb0d0a1a0a") + bytes(64))})
    gone = file.add("images", {"uri": "gone.ktx2"})
    textures = [file.add("textures", t) for t in (
        {"source": ktx}, {"extensions": {"KHR_texture_basisu": {"source": gone}}})]  # fmt: skip
    pbr = {"baseColorTexture": {"index": textures[0]}, "metallicRoughnessTexture": {"index": textures[1]}}
    file.json["extensionsRequired"] = ["KHR_texture_basisu"]
    file.mesh(uv=SQUARE_UV, material=file.add("materials", {"pbrMetallicRoughness": pbr}))
    warnings = " ".join(load(file.save(tmp_path)).warnings)
    assert "image 0 ('image 0'): cannot be decoded (KTX2: " in warnings
    assert "its file 'gone.ktx2' is missing" in warnings


def test_ktx2_pictures_are_read(tmp_path):
    file = Builder()
    data = basisu.encode(np.tile(np.uint8([200, 100, 50]), (8, 8, 1)), "uastc")
    image = file.add("images", {"bufferView": file.view(data), "mimeType": "image/ktx2"})
    texture = file.add("textures", {"extensions": {"KHR_texture_basisu": {"source": image}}})
    pbr = {"baseColorTexture": {"index": texture}}
    file.json["extensionsRequired"] = ["KHR_texture_basisu"]
    file.mesh(uv=SQUARE_UV, material=file.add("materials", {"pbrMetallicRoughness": pbr}))
    path = file.save(tmp_path)
    picture = load(path).materials[0].base_color_texture.image
    assert picture.mime == "image/png" and picture.pixels.shape == (8, 8, 4)
    np.testing.assert_allclose(picture.pixels[3, 3], [200, 100, 50, 255], atol=3)
    assert "--limit picture_edge=" in refused(path, picture_edge=4)


def test_pictures_named_with_backslashes_are_found(tmp_path):
    (tmp_path / "textures").mkdir()
    PillowImage.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "textures" / "my wall.png")
    file = Builder()
    file.add("images", {"uri": "textures\\my%20wall.png"})
    pbr = {"baseColorTexture": {"index": file.add("textures", {"source": 0})}}
    file.mesh(uv=SQUARE_UV, material=file.add("materials", {"pbrMetallicRoughness": pbr}))
    assert load(file.save(tmp_path)).materials[0].base_color_texture is not None
    # What lies outside of the folder is missing, as before.
    file.json["images"][0]["uri"] = "..\\wall.png"
    assert load(file.save(tmp_path)).materials[0].base_color_texture is None


def test_a_camera_without_size_is_left_out(tmp_path):
    file = square()
    file.add("cameras", {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}})
    file.json["nodes"] += [{"camera": 0, "name": "flat", "scale": [0, 0, 0]}, {"camera": 0, "name": "eye"}]
    scene = load(file.save(tmp_path))
    assert [camera.name for camera in scene.cameras] == ["eye"]
    assert any(w.startswith("camera 'flat': a scale of 0") for w in scene.warnings)


def test_small_triangles_under_a_wide_dome_are_kept(tmp_path):
    file = Builder()
    file.mesh(SQUARE * 2e5)
    file.mesh(SQUARE * 0.005)
    scene = load(file.save(tmp_path))
    assert [len(mesh.indices) for mesh in scene.meshes] == [2, 2]
    assert not any("no area" in w for w in scene.warnings)


def test_what_an_unlit_material_shows_is_no_light(tmp_path):
    file = Builder()
    material = {"emissiveFactor": [1, 1, 1], "extensions": {"KHR_materials_unlit": {}}}
    file.mesh(material=file.add("materials", material))
    scene = load(file.save(tmp_path))
    assert not scene.has_static_light
    assert any("its emission is what it looks like and no light" in w for w in scene.warnings)


def _off(file: Builder) -> dict:
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 0}]}}
    file.add("nodes", {"extensions": {"KHR_lights_punctual": {"light": 0}}})
    return {}


def _black(file: Builder) -> dict:
    return {"emissiveFactor": [1, 1, 1], "emissiveTexture": file.texture(np.zeros((2, 2, 3)))}


@pytest.mark.parametrize("material", [_off, _black])
def test_lamps_that_are_off_are_no_light(tmp_path, material):
    """A bake would learn their light, find none and be refused."""
    file = Builder()
    file.mesh(uv=SQUARE_UV, material=file.add("materials", material(file)))
    scene = load(file.save(tmp_path))
    assert not scene.has_static_light
    assert under_sky(scene).has_static_light
    file.json["materials"][0]["emissiveFactor"] = [0, 0, 1e-3]
    file.json["materials"][0].pop("emissiveTexture", None)
    assert load(file.save(tmp_path)).has_static_light


@pytest.mark.parametrize(("intensity", "color"), [(1e38, 1.0), (1e300, 1e300), (1.0, 1e38)])
def test_intensities_beyond_every_light_are_cut_with_a_warning(tmp_path, intensity, color):
    file = Builder()
    file.mesh()
    light = {"type": "point", "intensity": intensity, "color": [color, color / 2, 0]}
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
    file.add("nodes", {"name": "lamp", "extensions": {"KHR_lights_punctual": {"light": 0}}})
    scene = load(file.save(tmp_path))
    assert scene.lights[0].intensity == 1e10 and scene.lights[0].color == (1.0, 0.5, 0.0)
    assert any("light 'lamp'" in w and "cut to 1e+10" in w for w in scene.warnings)


def test_emission_beyond_every_light_is_cut_with_a_warning(tmp_path):
    file = Builder()
    file.mesh(material=file.add("materials", {"emissiveFactor": [1e29, 0, 0]}))
    scene = load(file.save(tmp_path))
    assert scene.meshes[0].emission == (1e10, 0, 0)
    assert any("more than any light has" in w for w in scene.warnings)


def _processor_seconds(path) -> float:
    """Time that loading takes of the processor, so that a busy machine does not fail a test."""
    begin = time.process_time()
    load(path)
    return time.process_time() - begin


@pytest.mark.parametrize("count", [20_000, pytest.param(200_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("drawn", [1000, 1])
def test_many_nodes_load_in_time_that_grows_with_their_number(tmp_path, count, drawn):
    """200,000 take 4 s; ``drawn``: one node in so many shows a mesh."""
    file = square(node=False)
    for i in range(count):
        file.add("nodes", {"translation": [i % 100, i // 100, 0], **({} if i % drawn else {"mesh": 0})})
    assert _processor_seconds(file.save(tmp_path)) < 1 + 15 * count / 200_000


@pytest.mark.parametrize("count", [1200, pytest.param(12_000, marks=pytest.mark.slow)])
def test_many_meshes_over_one_buffer_load_in_time_that_grows_with_their_number(tmp_path, count):
    """12,000 accessors, each of a mesh of its own, take 4 s."""
    file = square(node=False)
    for _ in range(count):
        file.json["accessors"].append(file.json["accessors"][0])
        number = file.add("meshes", {"primitives": [{"attributes": {"POSITION": len(file.json["accessors"]) - 1}}]})
        file.add("nodes", {"mesh": number})
    assert _processor_seconds(file.save(tmp_path)) < 1 + 15 * count / 12_000


def test_units(tmp_path):
    file = Builder()
    file.mesh(SQUARE * 400, SQUARE_INDICES)
    path = file.save(tmp_path)
    large = load(path)
    assert (
        "the scene is 800 m long; if its file is not in metres, say so with --scene-unit (cm or mm)" in large.warnings
    )
    small = load(path, unit=0.01)
    assert small.extent == pytest.approx(8)
    assert not any("--scene-unit" in w for w in small.warnings)


def test_ignored_attributes_are_told(tmp_path):
    file = square()
    extra = file.accessor(np.zeros((4, 2), np.float32))
    file.json["meshes"][0]["primitives"][0]["attributes"].update(TEXCOORD_2=extra, TANGENT=extra, _WIND=extra)
    assert "vertex attributes are ignored: TEXCOORD_2, _WIND" in load(file.save(tmp_path)).warnings


def test_a_deep_chain_of_nodes_is_read(tmp_path):
    file = square()
    file.json["nodes"] = [{"children": [i + 1]} for i in range(20_000)] + [{"mesh": 0, "name": "leaf"}]
    assert load(file.save(tmp_path)).meshes[0].name == "leaf"
    assert "--limit depth=" in refused(tmp_path / "room.glb", depth=1000)


def test_a_light_of_an_extension_that_is_not_read_is_told(tmp_path):
    file = square()
    file.json["extensionsUsed"] = ["EXT_lights_ies", "KHR_materials_variants"]
    said = [line for line in load(file.save(tmp_path)).warnings if "extension" in line]
    assert said == ["the extension 'EXT_lights_ies' is ignored"]
