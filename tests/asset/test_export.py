"""`lightwell export`: shader texts of baked fields. That they compile and equal NumPy: web/test/export.test.ts."""

import json
import re
import shutil
from pathlib import Path

import pytest

from lightwell.asset import export
from lightwell.cli import main

ASSET = Path(__file__).parents[2] / "web/test/fixtures/lightmap.glb"


@pytest.mark.parametrize(
    ("to", "word"),
    [
        ("glsl", "uniform highp sampler2D"),
        ("wgsl", "glow_picture0: texture_2d"),
        ("hlsl", "Texture2D<float4> glow_picture0, SamplerState glow_picture0_sampler"),
        ("msl", "texture2d<float> glow_picture0, sampler glow_picture0_sampler"),
        ("gdshader", "uniform sampler2D glow_picture0 : filter_linear"),
    ],
)
def test_a_light_map_becomes_a_text_and_pictures(tmp_path, to, word, capsys):
    assert main(["export", str(ASSET), "--to", to, "-o", str(tmp_path / "glow.txt"), "--name", "glow"]) == 0
    text = (tmp_path / "glow.txt").read_text()
    assert word in text
    assert "glow_picture0: 16 x 16 texels, RGBA8 UNORM (not sRGB)" in text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["glow.txt", "glow_picture0.png", "glow_picture1.png"]
    assert len(re.findall(r": [0-9.]+ k?B$", capsys.readouterr().out, re.MULTILINE)) == 3


def test_tables_go_beside_the_text(tmp_path):
    made = export.export_field(ASSET, "wgsl", weights="table")
    paths = export.write_export(tmp_path / "field.wgsl", made)
    assert {path.name for path in paths} > {"field.wgsl", "lightwell_texels.bin"}
    assert len(made.tables["lightwell_texels"]) % 16 == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--to", "cobol"], "export: expected --to glsl, wgsl, shadertoy, hlsl, msl, gdshader, godot, unity"),
        (["--to", "shadertoy"], "shadertoy: expected a field without textures or tables"),
        (["--to", "glsl", "--field", "sky"], "has no field 'sky'; it has 'lightmap'"),
        (["--to", "glsl", "--name", "a b"], "name: expected letters, digits and _"),
        (["--to", "glsl", "--weights", "texture"], "export: expected --weights inline or table, found 'texture'"),
        (["--to", "glsl", "--limit", "work=100"], "expected at most 100 operations per pixel, found"),
    ],
)
def test_mistakes_are_one_line(arguments, message, capsys):
    assert main(["export", str(ASSET), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_the_asset_is_not_written_over(tmp_path, capsys):
    shutil.copy(ASSET, tmp_path / "scene.glb")
    (tmp_path / "link.txt").symlink_to("scene.glb")
    for path in (tmp_path, tmp_path / "scene.glb"):
        for out in ("scene.glb", "link.txt"):
            assert main(["export", str(path), "--to", "glsl", "-o", str(tmp_path / out)]) == 2
            error = capsys.readouterr().err
            assert "is the asset itself, which would be lost" in error and error.count("\n") == 1
    assert (tmp_path / "scene.glb").read_bytes() == ASSET.read_bytes()


def test_no_engine_is_one_line_with_its_cure(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    try:
        import py_mini_racer  # noqa: F401
    except ImportError:
        with pytest.raises(RuntimeError, match=r"needs a JavaScript engine; install Node .*lightwell\[export\]"):
            export.run_exporter("{}")


def test_the_embedded_engine_gives_the_same_text(monkeypatch):
    with_node = export.export_field(ASSET, "glsl")
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert export.export_field(ASSET, "glsl") == with_node


def test_a_broken_request_is_an_error_not_a_crash():
    answer = json.loads(export.run_exporter('{"graph": 5, "arrays": {}, "pictures": {}, "options": {"to": "glsl"}}'))
    assert "expected an object" in answer["error"]
