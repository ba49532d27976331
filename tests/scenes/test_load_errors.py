"""What loading says about files that cannot be used: one line each, never a traceback of something else."""

import json
import struct

import numpy as np
import pytest
from gltf_builder import SQUARE, SQUARE_UV, Builder, glb
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lightwell.scenes import SceneError, load

DAMAGED = "the file is truncated or damaged, export it again"


def whole() -> Builder:
    file = Builder()
    texture = file.texture(np.full((2, 2, 3), 200))
    file.mesh(uv=SQUARE_UV, material=file.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": texture}}))
    file.json["nodes"][0].update(translation=[0, 1, 0], rotation=[0, 0, 0, 1])
    return file


def message(path) -> str:
    with pytest.raises(SceneError) as caught:
        load(path)
    text = str(caught.value)
    assert "\n" not in text
    return text


def broken(tmp_path, change, file=None) -> str:
    file = file or whole()
    change(file.json)
    return message(file.save(tmp_path))


def test_what_is_no_scene(tmp_path):
    assert message(tmp_path / "room.glb") == (
        f"scene 'room.glb': there is no file '{tmp_path / 'room.glb'}'; check the path"
    )
    assert message("room.fbx") == (
        "scene 'room.fbx': '.fbx' is not a scene; give a .glb, .gltf, .usd, .obj, .ply, .blend or Mitsuba .xml file "
        "or one of cornell, courtyard, courtyard-day, doorway, loft, two-rooms"
    )
    (tmp_path / "text.glb").write_text("hello")
    assert message(tmp_path / "text.glb") == (
        f"scene 'text.glb': does not begin with 'glTF', so it is no GLB file; {DAMAGED}"
    )
    (tmp_path / "text.gltf").write_text("hello")
    assert message(tmp_path / "text.gltf").startswith("scene 'text.gltf': its JSON cannot be read (Expecting value")


def test_a_short_file(tmp_path):
    path = whole().save(tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[:100])
    assert message(path) == f"scene 'room.glb': has 100 bytes, but its header says {len(data)}; {DAMAGED}"


@pytest.mark.parametrize(
    "change,expected",
    [
        (lambda j: j["asset"].update(version="1.0"), "is glTF version '1.0', expected 2.0; convert it to glTF 2.0"),
        (
            lambda j: j["accessors"][0].update(count=400),
            f"accessor 0 reads bytes 0..4800 of bufferView 1, which has 48; {DAMAGED}",
        ),
        (
            lambda j: j["accessors"][0].update(count=10**12),
            "node 0: 1000000000000 vertices, more than the limit of 32000000; make it smaller or raise the limit of a "
            "file that you trust with --limit vertices=1e+12",
        ),
        (
            lambda j: (j["accessors"][0].pop("bufferView"), j["accessors"][0].update(count=10**12)),
            "node 0: 1000000000000 vertices, more than the limit of 32000000; ",
        ),
        (
            lambda j: j["accessors"][0].update(count=-1),
            f"accessor 0 has count -1, expected a whole number >= 1; {DAMAGED}",
        ),
        (
            lambda j: j["bufferViews"][1].update(byteLength=9999),
            "bufferView 1 reads bytes ",
        ),
        (
            lambda j: j["meshes"][0]["primitives"][0].update(indices=17),
            f"mesh 0 primitive 0 names accessor 17, but there are 3; {DAMAGED}",
        ),
        (
            lambda j: (j["nodes"][0].update(children=[0]), j.update(scenes=[{"nodes": [0]}])),
            f"node 0 is reached twice; nodes must form a tree; {DAMAGED}",
        ),
        (
            lambda j: j["nodes"][0].update(scale=[1, "x", 1]),
            f"node 0 has scale [1, 'x', 1], expected 3 finite numbers; {DAMAGED}",
        ),
        (
            lambda j: j.update(extensionsRequired=["OMI_physics_body"]),
            "requires the extension 'OMI_physics_body', which lightwell does not read; export without it",
        ),
        (
            lambda j: j["nodes"][0].pop("mesh"),
            "has no triangles in its default scene; export its meshes too",
        ),
        (lambda j: j.update(meshes=7), f"the glTF document has meshes 7, expected a list; {DAMAGED}"),
    ],
)
def test_damage_is_named(tmp_path, change, expected):
    text = broken(tmp_path, change)
    assert text.startswith("scene 'room.glb': ")
    assert expected in text


def test_vertices_must_be_numbers(tmp_path):
    file = Builder()
    positions = SQUARE.copy()
    positions[1, 2] = np.nan
    file.mesh(positions)
    assert message(file.save(tmp_path)) == (
        "scene 'room.glb': mesh 0 primitive 0 has POSITION that are not finite numbers; "
        "repair the mesh and export it again"
    )


def test_a_scene_of_slivers_has_no_triangles(tmp_path):
    file = Builder()
    file.mesh(SQUARE * [1, 0, 0])
    assert message(file.save(tmp_path)) == (
        "scene 'room.glb': has no triangles; a scene needs at least one surface, export its meshes too"
    )


@pytest.mark.parametrize(
    "uri,expected",
    [
        ("../secret.bin", "buffer 0 names '../secret.bin' outside the folder of the file; move it beside the file"),
        ("/etc/hostname", "buffer 0 names '/etc/hostname' outside the folder of the file"),
        ("%2e%2e/secret.bin", "buffer 0 names '%2e%2e/secret.bin' outside the folder of the file"),
        ("http://example.org/a.bin", "buffer 0 names 'http://example.org/a.bin'; only files beside"),
        ("gone.bin", "buffer 0 names the file 'gone.bin', which is missing; put it beside the glTF file"),
        ("data:;base64,@@", f"buffer 0 has a data URI that is not valid base64; {DAMAGED}"),
    ],
)
def test_only_files_beside_the_scene_are_read(tmp_path, uri, expected):
    (tmp_path / "secret.bin").write_bytes(bytes(1000))
    folder = tmp_path / "inner"
    folder.mkdir()
    file = whole()
    file.bytes()
    file.json["buffers"][0]["uri"] = uri
    (folder / "room.gltf").write_text(json.dumps(file.json))
    assert expected in message(folder / "room.gltf")


def test_a_link_out_of_the_folder_is_not_followed(tmp_path):
    (tmp_path / "secret.bin").write_bytes(bytes(1000))
    folder = tmp_path / "inner"
    folder.mkdir()
    (folder / "a.bin").symlink_to(tmp_path / "secret.bin")
    file = whole()
    file.bytes()
    file.json["buffers"][0]["uri"] = "a.bin"
    (folder / "room.gltf").write_text(json.dumps(file.json))
    assert "outside the folder" in message(folder / "room.gltf")


def loads_or_explains(path) -> None:
    try:
        load(path)
    except SceneError as error:
        assert "\n" not in str(error)
        assert str(error).startswith("scene 'fuzz.glb': ")


FUZZ = settings(
    max_examples=120, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@FUZZ
@given(data=st.data())
def test_truncated_and_flipped_bytes(tmp_path, data):
    good = bytearray(whole().bytes())
    for _ in range(data.draw(st.integers(0, 6))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "fuzz.glb"
    path.write_bytes(good[: data.draw(st.integers(0, len(good)))] if data.draw(st.booleans()) else good)
    loads_or_explains(path)


VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-2, 70),
    st.integers(2**31 - 2, 2**64),
    st.floats(),
    st.text(max_size=5),
    st.lists(st.integers(-1, 5), max_size=4),
    st.just({}),
)


def places(value, path=()):
    """Every (container, key) inside a JSON value."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in list(pairs):
        yield value, key
        yield from places(inner, (*path, key))


@FUZZ
@given(data=st.data())
def test_changed_json(tmp_path, data):
    file = whole()
    file.bytes()
    document = json.loads(json.dumps(file.json))
    for _ in range(data.draw(st.integers(1, 3))):
        container, key = data.draw(st.sampled_from(list(places(document))))
        container[key] = data.draw(VALUES)
    path = tmp_path / "fuzz.glb"
    path.write_bytes(glb(document, bytes(file.data)))
    loads_or_explains(path)


def test_lying_chunk_lengths(tmp_path):
    data = bytearray(whole().bytes())
    struct.pack_into("<I", data, 12, 2**32 - 1)
    path = tmp_path / "room.glb"
    path.write_bytes(data)
    assert message(path) == f"scene 'room.glb': chunk 0 reads bytes 20..4294967315 of a file of {len(data)}; {DAMAGED}"
