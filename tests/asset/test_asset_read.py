"""Reading learned light back: what was written comes back, and a hostile file is refused in one line."""

import copy
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lightwell.asset import EXTENSION, FieldEntry, info, read_fields, write_glb
from lightwell.asset.container import pack, unpack
from lightwell.graph import evaluate, graph_to_json

ROOT = Path(__file__).parents[2]


@pytest.fixture
def baked(tmp_path, scene, entry, variable):
    path = tmp_path / "room.glb"
    write_glb(path, scene, [entry, FieldEntry("static", "static", entry.graph)], [variable])
    return path


@pytest.fixture
def broken(baked):
    """Writes the baked file again after a change to its document; returns the message of the refusal."""
    document, binary = unpack(baked.read_bytes())

    def message(change) -> str:
        altered = copy.deepcopy(document)
        change(altered)
        baked.write_bytes(pack(altered, binary))
        with pytest.raises(ValueError) as caught:
            read_fields(baked)
        text = str(caught.value)
        assert text.startswith(f"asset: '{baked}': ") and "\n" not in text and len(text) < 700
        return text

    return message


def extension(document):
    return document["extensions"][EXTENSION]


def first_buffer(document):
    return next(iter(extension(document)["fields"][0]["graph"]["buffers"].values()))


def first_accessor(document):
    return document["accessors"][first_buffer(document)["accessor"]]


def test_round_trip(baked, entry, variable):
    fields, variables = read_fields(baked)
    assert variables == [variable]
    assert [(f.name, f.role, f.variable) for f in fields] == [("indirect", "indirect", 0), ("static", "static", None)]
    document, arrays = graph_to_json(entry.graph)
    document_again, arrays_again = graph_to_json(fields[0].graph)
    assert document_again == document
    assert {a.dtype.name for a in arrays.values()} == {"int8", "uint8", "float16", "float32"}
    for name, array in arrays.items():
        assert arrays_again[name].dtype == array.dtype
        np.testing.assert_array_equal(arrays_again[name], array)
    inputs = {name: np.random.default_rng(5).random((9, 3), np.float32) for name in ("position", "light")}
    np.testing.assert_array_equal(
        evaluate(fields[0].graph, inputs)["radiance"], evaluate(entry.graph, inputs)["radiance"]
    )


def test_info(baked, entry):
    facts = info(baked)
    assert facts["triangles"] == 8 and facts["vertices"] == 16 and facts["materials"] == 4 and facts["lights"] == 3
    assert facts["bytes"] == baked.stat().st_size and facts["field_bytes"] == 2 * entry.graph.nbytes
    assert facts["fields"][0]["macs"] == entry.graph.macs == facts["macs_per_pixel"] // 2
    assert facts["fields"][0]["nodes"] == len(entry.graph.nodes)
    assert facts["generator"].startswith("lightwell")


def test_info_of_an_ordinary_glb(baked):
    document, binary = unpack(baked.read_bytes())
    del extension(document)["fields"], document["extensions"][EXTENSION], document["cameras"]
    baked.write_bytes(pack(document, binary))
    facts = info(baked)
    assert facts["fields"] == [] and facts["macs_per_pixel"] == 0 and facts["cameras"] == 0


@pytest.mark.parametrize(
    "change", [{"extensions": 3}, {"meshes": 3}, {"meshes": [{}]}, {"asset": []}, {"accessors": 0}]
)
def test_info_refuses_nonsense(baked, change):
    document, binary = unpack(baked.read_bytes())
    baked.write_bytes(pack({**document, **change}, binary))
    with pytest.raises(ValueError, match=r"asset: '.*room.glb': "):
        info(baked)


def test_the_schema_of_the_contract_is_the_shipped_one():
    name = f"{EXTENSION}.schema.json"
    assert (ROOT / "format" / name).read_bytes() == (ROOT / "lightwell/asset" / name).read_bytes()


def remove_field_variable(document):
    del extension(document)["fields"][0]["variable"]


def rename_second(document):
    extension(document)["fields"][1]["name"] = "indirect"


SUN = {"name": "sun", "kind": "sun", "start": [1, 0, 0], "middle": [0, 0, 0], "end": [-1, 0, 0]}
SUN |= {"initial": [0, 1, 0], "intensity": 1, "color": [1, 1, 1]}

REFUSALS = [
    (lambda d: d["extensions"].pop(EXTENSION), "has no LIGHTWELL_neural_radiance; bake the scene"),
    (lambda d: d.update(extensions=[]), "has no LIGHTWELL_neural_radiance"),
    (lambda d: extension(d).update(version=3), "version: 3 is not one of [1, 2]"),
    (lambda d: extension(d).update(fields=[]), "fields: "),
    (lambda d: extension(d).update(extra=1), "'extra' was unexpected"),
    (lambda d: extension(d)["fields"][0].update(role="magic"), r"fields[0].role: 'magic' is not one of"),
    (lambda d: extension(d)["fields"][0].update(variable=1), "fields[0].variable: there is no light 1"),
    (lambda d: extension(d)["variables"][0].update(low=[0, 0]), "variables[0].low: [0, 0] is too short"),
    (lambda d: extension(d)["variables"][0].update(low=[0, 9, 0]), "variables[0].low: expected no number above"),
    (lambda d: extension(d)["variables"].append(SUN), "variables[1].middle: expected a direction, found zero"),
    (remove_field_variable, "'variable' is a required property"),
    (rename_second, "two entries have the same name"),
    (lambda d: first_buffer(d).update(accessor=10_000), "accessors[10000] does not exist"),
    (lambda d: first_buffer(d).pop("accessor"), "'accessor' is a required property"),
    (lambda d: first_buffer(d).update(accessor=0), "its accessor has type VEC3, expected SCALAR"),
    (lambda d: first_buffer(d).update(shape=[2**22]), "its accessor has count 120, expected 4194304"),
    (lambda d: first_accessor(d).update(componentType=5126), "has componentType 5126, expected 5120"),
    (lambda d: first_accessor(d).update(byteOffset=-4), "byteOffset is -4, expected a non-negative integer"),
    (lambda d: first_accessor(d).update(byteOffset=8), "do not lie inside the file"),
    (lambda d: first_accessor(d).update(sparse={}), "sparse or normalized"),
    (lambda d: first_accessor(d).update(bufferView=None), "bufferViews[None] does not exist"),
    (lambda d: d["bufferViews"][first_accessor(d)["bufferView"]].update(byteOffset=10**9), "do not lie inside"),
    (lambda d: d["bufferViews"][first_accessor(d)["bufferView"]].update(byteLength=10**9), "do not lie inside"),
    (lambda d: d["bufferViews"][first_accessor(d)["bufferView"]].update(buffer=1), "must be packed"),
    (lambda d: d["bufferViews"][first_accessor(d)["bufferView"]].update(byteStride=4), "must be packed"),
    (lambda d: d.update(accessors=3), "does not exist"),
    (lambda d: extension(d)["fields"][0]["graph"]["nodes"][0].update(op="exec"), "'exec' is not one of"),
    (lambda d: extension(d)["fields"][0]["graph"]["outputs"].clear(), "'radiance' is a required property"),
    (lambda d: extension(d)["fields"][0]["graph"]["outputs"].update(radiance="n0"), "has width 6, expected 3"),
    (lambda d: extension(d)["fields"][0]["graph"]["inputs"].update(mood=3), "'mood' was unexpected"),
]


@pytest.mark.parametrize("change, expected", REFUSALS, ids=[text for _, text in REFUSALS])
def test_refusals(broken, change, expected):
    assert expected in broken(change)


@pytest.mark.parametrize(
    "data, expected",
    [
        (b"", "not a GLB file"),
        (b"glTF" + struct.pack("<II", 1, 20) + bytes(8), "GLB version 1"),
        (b"glTF" + struct.pack("<II", 2, 2**32 - 1) + bytes(8), "truncated: the header promises"),
        (b"glTF" + struct.pack("<IIII", 2, 20, 2**32 - 1, 0x4E4F534A), "truncated: a chunk"),
        (b"glTF" + struct.pack("<IIII", 2, 20, 0, 7), "first chunk is not JSON"),
        (b"glTF" + struct.pack("<IIII", 2, 22, 2, 0x4E4F534A) + b"[]", "not an object"),
        (b"glTF" + struct.pack("<IIII", 2, 22, 2, 0x4E4F534A) + b"\xff\xff", "not UTF-8"),
        (b"glTF" + struct.pack("<IIII", 2, 29, 9, 0x4E4F534A) + b'{"a":NaN}', "the number NaN is not finite"),
        (b"glTF" + struct.pack("<IIII", 2, 31, 11, 0x4E4F534A) + b'{"a":1e999}', "the number 1e999 is not finite"),
        (b"glTF" + struct.pack("<IIII", 2, 100020, 100000, 0x4E4F534A) + b"[" * 100000, "nested too deeply"),
    ],
)
def test_containers_that_are_refused(tmp_path, data, expected):
    path = tmp_path / "bad.glb"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=expected):
        read_fields(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"'.*none.glb' cannot be opened: No such file"):
        read_fields(tmp_path / "none.glb")


def test_weights_that_are_not_finite_are_refused(baked):
    document, binary = unpack(baked.read_bytes())
    buffers = extension(document)["fields"][0]["graph"]["buffers"]
    half = next(b for b in buffers.values() if b["type"] == "float16")
    start = document["bufferViews"][document["accessors"][half["accessor"]]["bufferView"]]["byteOffset"]
    altered = bytearray(binary)
    altered[start : start + 2] = np.float16(np.nan).tobytes()
    baked.write_bytes(pack(document, bytes(altered)))
    with pytest.raises(ValueError, match=r"field 'indirect': buffer 'w.*': contains NaN or infinity"):
        read_fields(baked)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_bytes_never_do_worse_than_a_value_error(baked, data):

    damaged = bytearray(baked.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    path = baked.with_name("damaged.glb")
    path.write_bytes(damaged[: data.draw(st.integers(len(damaged) // 2, len(damaged)))])
    for read in (read_fields, info):
        try:
            read(path)
        except ValueError as error:
            assert "\n" not in str(error)
