"""`lightwell validate`: the shipped example passes, and each planted fault is named."""

import json
from pathlib import Path

import pytest

from lightwell.asset.container import pack, unpack
from lightwell.asset.validate import WEB_BUFFERS, WEB_ENTRIES, WEB_NUMBERS
from lightwell.cli import main

ASSET = Path(__file__).parents[2] / "web/test/fixtures/lightmap.glb"
NAME = "LIGHTWELL_neural_radiance"


def buffers(document):
    return document["extensions"][NAME]["fields"][0]["graph"]["buffers"]


def test_the_example_follows_the_specification(capsys):
    assert main(["validate", str(ASSET)]) == 0
    assert "follows the specification" in capsys.readouterr().out
    assert main(["validate", str(ASSET), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"path": str(ASSET), "valid": True, "problems": [], "notes": []}


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda d: d["extensionsUsed"].remove(NAME), "extensionsUsed: LIGHTWELL_neural_radiance is missing"),
        (lambda d: d.update(extensionsRequired=[NAME]), "must be optional"),
        (lambda d: d["meshes"][0]["primitives"][0]["attributes"].pop("TEXCOORD_1"), "no TEXCOORD_1"),
        (lambda d: d["extensions"][NAME].update(version=3), "version"),
        (lambda d: buffers(d)["e"].update(shape=[8, 16, 3]), "buffer 'e': its picture is RGB (16, 16)"),
        (lambda d: buffers(d)["e"].update(texture=99), "textures[99] does not exist"),
        (lambda d: buffers(d)["e"].update(accessor=0), "buffers.e"),
        (lambda d: d["extensions"].pop(NAME), "has no LIGHTWELL_neural_radiance"),
    ],
)
def test_planted_faults_are_named(tmp_path, capsys, spoil, message):
    document, binary = unpack(ASSET.read_bytes())
    document = json.loads(json.dumps(document))
    spoil(document)
    path = tmp_path / "spoilt.glb"
    path.write_bytes(pack(document, binary))
    assert main(["validate", str(path)]) == 1
    assert message in capsys.readouterr().out
    assert main(["validate", str(path), "--json"]) == 1
    (said,) = [one for one in json.loads(capsys.readouterr().out)["problems"] if message in one]
    assert said


def test_what_pages_do_not_take_is_a_note(tmp_path, capsys):
    document, binary = unpack(ASSET.read_bytes())
    (field,) = document["extensions"][NAME]["fields"]
    document["extensions"][NAME]["fields"] = [field | {"name": f"field {k}"} for k in range(8)]
    path = tmp_path / "many.glb"
    path.write_bytes(pack(document, binary))
    assert main(["validate", str(path)]) == 0
    assert "note" not in capsys.readouterr().out
    document["extensions"][NAME]["fields"].append(field | {"name": "field 8"})
    sun = {"kind": "sun", "start": [1, 1, 0], "middle": [0, 1, 0], "end": [0, 1, 1], "initial": [0, 1, 0]}
    sun |= {"intensity": 1.0, "color": [1, 1, 1]}
    document["extensions"][NAME]["variables"] = [sun | {"name": f"sun {k}"} for k in range(5)]
    path.write_bytes(pack(document, binary))
    assert main(["validate", str(path)]) == 0
    out = capsys.readouterr().out
    assert "note: variables: 5, more than the 4 that the web runtime takes; pages refuse the file" in out
    assert "note: fields: 9, more than the 8" in out


def test_the_limits_of_pages_are_those_of_the_runtime():
    source = Path(__file__).parents[2] / "web/runtime/src"
    text = (source / "most.ts").read_text() + (source / "extension.ts").read_text()
    assert f"MAX_VARIABLES = {WEB_ENTRIES['variables']};" in text
    assert f"MAX_FIELDS = {WEB_ENTRIES['fields']};" in text
    assert f"MAX_BUFFERS = {WEB_BUFFERS};" in text
    assert WEB_NUMBERS == 1 << 26 and "MAX_ELEMENTS = 1 << 26;" in text
