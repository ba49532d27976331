"""`lightwell validate`: the shipped example passes, and each planted fault is named."""

import json
from pathlib import Path

import pytest

from lightwell.asset.container import pack, unpack
from lightwell.cli import main

ASSET = Path(__file__).parents[2] / "web/test/fixtures/lightmap.glb"
NAME = "LIGHTWELL_neural_radiance"


def buffers(document):
    return document["extensions"][NAME]["fields"][0]["graph"]["buffers"]


def test_the_example_follows_the_specification(capsys):
    assert main(["validate", str(ASSET)]) == 0
    assert "follows the specification" in capsys.readouterr().out
    assert main(["validate", str(ASSET), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"path": str(ASSET), "valid": True, "problems": []}


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
