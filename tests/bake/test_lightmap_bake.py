"""The bake of a light map, end to end and small."""

import json

import numpy as np
import pytest

from lightwell.asset import read_fields
from lightwell.asset.container import unpack
from lightwell.bake import BakeSettings, Budget, bake
from lightwell.cli import main

SMALL = dict(
    field="lightmap", budget=Budget(1.0), size=64, mips=0, paths=4, views=1, view_size=(24, 16), shards=1, steps=20
)


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Few samples: the shards of a test are small."""
    from lightwell.bake import lightmap, lightmap_score

    monkeypatch.setattr(lightmap_score, "RATE", 3e3)
    monkeypatch.setattr(lightmap, "EYE_PATHS", 2)
    monkeypatch.setattr(lightmap, "SHARD", 1 << 10)


def test_default(tmp_path):
    report = bake(BakeSettings("cornell", tmp_path, **SMALL))
    fields, variables = read_fields(tmp_path / "scene.glb")
    assert [f.role for f in fields] == ["static"] and variables == []
    assert {"e", "d", "f0", "f1"} <= set(fields[0].graph.buffers)
    assert report["field"] == "lightmap" and np.isfinite(report["psnr_db"])
    assert report["facts"]["atlas"]["charts"] > 5
    assert any("white sky" in w for w in report["warnings"])
    assert json.loads((tmp_path / "report.json").read_text())["bytes"] == report["bytes"]
    document, _ = unpack((tmp_path / "scene.glb").read_bytes())
    assert all("MOZ_lightmap" in m["extensions"] for m in document["materials"])
    assert (tmp_path / "index.html").stat().st_size > 1000


def test_a_light_that_moves(tmp_path):
    vary = ("light.position=box(-0.5,1.2,-0.5,0.5,1.6,0.5)",)
    bake(BakeSettings("cornell", tmp_path, vary=vary, **SMALL))
    fields, variables = read_fields(tmp_path / "scene.glb")
    assert [f.role for f in fields] == ["indirect"] and variables[0]["kind"] == "point"
    assert {"light", "uv1"} <= set(fields[0].graph.inputs)


def test_plain_has_no_network(tmp_path):
    report = bake(BakeSettings("cornell", tmp_path, preset="plain", **SMALL))
    assert report["macs_per_pixel"] == 0


def test_a_killed_bake_ends_with_the_same_bytes(tmp_path, monkeypatch):
    from lightwell.fields import lightmap as field

    whole, halved = tmp_path / "whole", tmp_path / "halved"
    bake(BakeSettings("cornell", whole, **SMALL))
    phase, calls = field.LightmapFit._phase, []

    def killed(self, *arguments):
        calls.append(0)
        if len(calls) == 2:
            raise KeyboardInterrupt
        phase(self, *arguments)

    monkeypatch.setattr(field.LightmapFit, "_phase", killed)
    with pytest.raises(KeyboardInterrupt):
        bake(BakeSettings("cornell", halved, **SMALL))
    monkeypatch.setattr(field.LightmapFit, "_phase", phase)
    kept = {p.name for p in (halved / ".lightwell" / "lightmap").iterdir()}
    assert {"sides.npz", "counts.npz", "light.npz", "eyes.npz", "noise.npz"} <= kept
    bake(BakeSettings("cornell", halved, resume=True, **SMALL))
    assert (halved / "scene.glb").read_bytes() == (whole / "scene.glb").read_bytes()


def test_max_bytes_are_kept(tmp_path):
    report = bake(BakeSettings("cornell", tmp_path, max_bytes=4800, **SMALL))
    assert report["bytes"] <= 4800


def test_too_few_bytes_are_refused(tmp_path):
    with pytest.raises(ValueError, match="--max-bytes 100 is too few for this light map, whose smallest form takes"):
        bake(BakeSettings("cornell", tmp_path, max_bytes=100, **SMALL))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--preset", "nonsense"], "no preset 'nonsense'; choose one of default, report"),
        (["--max-bytes", "many"], "--max-bytes 'many' is not a size; write 1MB, 250kB"),
        (["--size", "1000"], "--size 1000 is not a power of two"),
        (["--mips", "-1"], "--mips -1 is too small"),
    ],
)
def test_mistakes_are_one_line(tmp_path, capsys, arguments, words):
    code = main(["bake", "cornell", "-o", str(tmp_path), "--field", "lightmap", *arguments])
    text = capsys.readouterr().err
    assert code == 2 and words in text and text.count("\n") == 1
