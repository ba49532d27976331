"""``import lightwell``: instant, typed, documented; no submodule hides a function; fields of others work."""

import inspect
import json
import os
import pkgutil
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import lightwell

ROOT = Path(__file__).parents[1]
FUNCTIONS = ("load", "bake", "compare", "render", "samples", "read")
TINY = {"shards": 1, "steps": 8, "paths": 2, "lights_per_shard": 8, "views": 1, "view_size": (24, 16), "truth": "0.2s"}


def test_importing_it_imports_nothing_heavy():
    code = "import lightwell, sys; print([m for m in ('numpy', 'mitsuba', 'PIL', 'rich', 'scipy') if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_top_level_help_imports_no_verb():
    code = (
        "import sys\nfrom lightwell.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
        "names = sorted(m for m in sys.modules if m.startswith('lightwell.cli.') or m in ('numpy', 'mitsuba'))\n"
        "print(names, file=sys.stderr)"
    )
    found = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    modules = [f"lightwell.cli.{name}" for name in ("interrupts", "main", "parser", "verbs")]
    assert found.stderr.strip() == str(modules)


def test_names_are_typed_and_listed():
    stub = (ROOT / "lightwell/__init__.py").read_text()
    named = set(re.findall(r"^    from \S+ import (\w+) as \1$", stub, re.MULTILINE))
    assert named == set(lightwell.__all__) - {"__version__"} and set(lightwell.__all__) <= set(dir(lightwell))
    assert (ROOT / "lightwell/py.typed").exists()
    with pytest.raises(AttributeError, match="no attribute 'bakke'"):
        _ = lightwell.bakke


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_say_what_they_take_and_give(name):
    function = getattr(lightwell, name)
    text = inspect.getdoc(function)
    assert all(section in text for section in ("Args:", "Returns:", "Raises:", "Example:"))
    signature = inspect.signature(function)
    assert signature.return_annotation is not inspect.Signature.empty
    for parameter in signature.parameters.values():
        assert f"{parameter.name}:" in text and parameter.annotation is not inspect.Parameter.empty


def test_no_submodule_takes_the_place_of_a_function(tmp_path):
    """Every module is imported; then each function is called."""
    for found in pkgutil.walk_packages(lightwell.__path__, "lightwell."):
        if not found.name.endswith("__main__"):
            import_module(found.name)
    assert ">triangles</td>" in (shown := lightwell.load("cornell")._repr_html_()) and "data:image/png" in shown
    scene = lightwell.load("cornell")
    assert repr(scene) == "<Scene cornell: 40 triangles, 4 materials, 2.03 x 2 x 2.04 m>"
    assert repr(scene.meshes[0]) == "<Mesh green_wall: 2 triangles, material 2>"
    report = lightwell.bake("cornell", tmp_path / "out", field="mlp", preset="small", **TINY)
    assert report["bytes"] > 0 and report.page.exists() and report.verdict
    shown = report._repr_html_()
    assert "Relative error" in shown and shown.count("data:image/jpeg") == 2
    assert json.loads((tmp_path / "out/report.json").read_text()) == dict(report)
    assert repr(report) == f"<Report {tmp_path / 'out'}: {report.verdict}>"
    asset = lightwell.read(tmp_path / "out")
    assert repr(asset).startswith(f"<Asset {asset.path}: <FieldEntry indirect (indirect): <Graph of position [3]")
    assert all(len(repr(thing)) < 300 for thing in (asset, *asset.fields[0].graph.buffers.values()))
    assert [field.role for field in asset.fields] == ["indirect"] and len(asset.variables) == 1
    assert asset._repr_html_().count("data:image/jpeg") == 2 and "MAC" in asset.fields[0]._repr_html_()
    picture = lightwell.render("cornell", tmp_path / "a.png", size=(16, 10), spp=1)
    assert picture["width"] == 16 and (tmp_path / "a.png").exists()
    facts = lightwell.samples("cornell", tmp_path / "s.npz", samples=64, paths=2)
    assert facts["samples"] == 64
    with np.load(tmp_path / "s.npz") as columns:
        assert {"position", "radiance", "shading_normal"} <= set(columns)
        assert all(len(columns[name]) == 64 for name in columns)
    found = lightwell.compare("cornell", tmp_path / "fields", ["tree"], **TINY)
    assert [field["name"] for field in found["fields"]] == ["tree"] and "tree" in found._repr_html_()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"size": 64}, "--size is an option of the field 'lightmap', not of 'factored'; add --field lightmap"),
        (
            {"field": "lightmap", "spacing": "1m"},
            "--spacing is an option of the field 'probes' or 'volume' or 'factored+probes', not of 'lightmap'",
        ),
        ({"field": "probes", "spacing": "far"}, "--spacing 'far' is not a length"),
        ({"field": "lightmap", "sise": 64}, "no option --sise of the field 'lightmap'; did you mean size"),
        ({"budget": "soon"}, "--budget 'soon' is not a time"),
        ({"field": "magic"}, "unknown field 'magic'"),
        ({"field": "probes", "box": "0,0,0,1,1,1"}, "belong together"),
    ],
)
def test_mistakes_are_one_line_with_the_cure(tmp_path, options, said):
    with pytest.raises(ValueError, match=re.escape(said)) as error:
        lightwell.bake("cornell", tmp_path / "out", **options)
    assert "\n" not in str(error.value) and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["bake", "cornell", "-o", "x", "--field", "lightmap", "--no-static"], "--no-static leaves nothing to learn"),
        (["bake", "cornell", "-o", "x", "--mips", "2"], "--mips is an option of the field 'lightmap'"),
        (
            ["samples", "doorway", "-o", "x.npz", "--vary", "node:Door.rotation=y:0..90"],
            "the scene stands still here; drop 'node:Door.rotation' from --vary",
        ),
        (["render", "cornell", "-o", "x.png", "--frames", "2"], "--frames is an option of the integrator 'nrc'"),
        (["render", "cornell", "-o", "x.png", "--integrator", "nrc", "--resume"], "--resume is for sequences"),
        (["render", "cornell", "-o", "x.png", "--integrator", "nrc", "--camera", "99"], "--camera 99 is none of them"),
        (
            "render cornell -o x --integrator nrc --frames 2 --nrc mode=still".split(),
            "mode=still is for single pictures",
        ),
        (
            "render cornell -o x.png --integrator nrc --nrc estimator=two-level --nrc seconds=1".split(),
            "two-level keeps no time limit",
        ),
        (["bake", "cornell", "-o", "x", "--watch", "--preview"], "--watch and --preview do not go together"),
        (["live", "cornell", "--field", "factored", "--size", "64"], "--size is of the radiance cache"),
        (["live", "cornell", "--field", "factored", "--nrc", "levels=2"], "--nrc is of the radiance cache"),
        (["live", "cornell", "--field", "factored", "--cache-from", "x.glb"], "--cache-from is of the radiance cache"),
        (["compare", "a", "b", "--seed", "1"], "--seed needs --fields"),
    ],
)
def test_no_option_is_ignored(tmp_path, monkeypatch, capsys, argv, said):
    from lightwell.cli import main

    monkeypatch.chdir(tmp_path)
    assert main(argv) == 2
    line = capsys.readouterr().err.strip()
    assert said in line and "\n" not in line and not list(tmp_path.iterdir())


def test_help_shows_the_options_of_the_field(capsys):
    from lightwell.cli.main import verb_parser

    probes = verb_parser("bake", ["--field", "probes"]).format_help()
    assert "--spacing" in probes and "--mips" not in probes
    both = verb_parser("bake").format_help()
    assert "--spacing" in both and "--mips" in both


@pytest.mark.slow
def test_a_distribution_adds_a_field(tmp_path):
    """The field of docs/python.md, as it stands there, installed beside lightwell."""
    text = (ROOT / "docs/python.md").read_text()
    (snippet,) = [s for s in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "FIELD = SurfaceField" in s]
    entry = re.search(r'\[project\.entry-points\."lightwell\.fields"\]\n(.*?)```', text, re.DOTALL).group(1)
    (tmp_path / "mean_field.py").write_text(snippet)
    about = tmp_path / "mean_field-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: mean-field\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[lightwell.fields]\n" + entry.replace('"', ""))
    program = (
        "import ast, json, sys, lightwell\n"
        "report = lightwell.bake('cornell', sys.argv[1], field='mean', **ast.literal_eval(sys.argv[2]))\n"
        "print(json.dumps(dict(report)))"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "out"), str(TINY)]
    paths = os.pathsep.join([str(tmp_path), str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["field"] == "mean" and (tmp_path / "out/scene.glb").exists()
