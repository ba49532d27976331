"""A user's mistake is one line that names the thing and the cure, exit code 2, and nothing half-written."""

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lightwell.cli import main
from lightwell.core.output import output_folder


def _refused(capsys, *argv: str) -> str:
    """The one line that a refused command prints."""
    assert main([str(a) for a in argv]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1 and "Traceback" not in captured.err
    return lines[0]


def _glb(document: dict, binary: bytes = b"") -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        body += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body


def test_missing_file(capsys, tmp_path):
    line = _refused(capsys, "bake", tmp_path / "no.glb", "-o", tmp_path / "out")
    assert "no.glb" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "argv, said",
    [
        (("bake", "cornell"), "-o/--out"),
        (("bake", "cornell", "-o", "out", "--spacing", "-1m"), "--name=-value"),
        (("bake", "cornell", "-o", "out", "--sede", "1"), "--sede"),
    ],
)
def test_arguments_that_do_not_parse(capsys, argv, said):
    with pytest.raises(SystemExit) as stop:
        main(argv)
    captured = capsys.readouterr()
    assert stop.value.code == 2 and captured.out == ""
    line = captured.err.strip()
    assert "\n" not in line and said in line and "--help" in line


def test_unknown_verb(capsys):
    assert "did you mean 'bake'" in _refused(capsys, "bakke", "cornell")


def test_unknown_field_and_preset(capsys, tmp_path):
    line = _refused(capsys, "bake", "cornell", "-o", tmp_path / "out", "--field", "magic")
    assert "unknown field 'magic'" in line and "mlp" in line
    line = _refused(capsys, "bake", "cornell", "-o", tmp_path / "out", "--preset", "magic")
    assert "no preset 'magic'" in line
    assert not (tmp_path / "out").exists()


def test_unknown_builtin_scene(capsys, tmp_path):
    assert "cornel" in _refused(capsys, "bake", "cornel", "-o", tmp_path / "out")


def test_bad_budget_and_bad_vary(capsys, tmp_path):
    assert "--budget" in _refused(capsys, "bake", "cornell", "-o", tmp_path / "out", "--budget", "soon")
    line = _refused(capsys, "bake", "cornell", "-o", tmp_path / "out", "--vary", "light.position=ball(1)")
    assert "light.position" in line


def test_light_box_where_no_light_can_stand(capsys, tmp_path):
    """In the partition of the two rooms, and far outside of them: refused before anything is traced."""
    for box in ("-0.02,0.5,-0.02,0.02,1,0.02", "90,90,90,91,91,91"):
        line = _refused(capsys, "bake", "two-rooms", "-o", tmp_path / "out", "--vary", f"light.position=box({box})")
        assert line.startswith("lightwell: vary") and "box" in line


def test_truncated_glb(capsys, tmp_path):
    whole = _glb({"asset": {"version": "2.0"}, "meshes": []})
    (tmp_path / "cut.glb").write_bytes(whole[: len(whole) // 2])
    assert "cut.glb" in _refused(capsys, "bake", tmp_path / "cut.glb", "-o", tmp_path / "out")


def test_scene_without_geometry(capsys, tmp_path):
    (tmp_path / "empty.glb").write_bytes(_glb({"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "scene": 0}))
    line = _refused(capsys, "bake", tmp_path / "empty.glb", "-o", tmp_path / "out")
    assert "empty.glb" in line


def test_output_is_a_file(capsys, tmp_path):
    (tmp_path / "out").write_text("mine")
    assert "is a file" in _refused(capsys, "bake", "cornell", "-o", tmp_path / "out")
    assert (tmp_path / "out").read_text() == "mine"


def test_unwritable_output(capsys, tmp_path):
    """Root may write everywhere but where the kernel says what exists."""
    tmp_path.chmod(0o500)
    place = Path("/sys") if os.geteuid() == 0 else tmp_path
    assert "cannot create output folder" in _refused(capsys, "bake", "cornell", "-o", place / "out")


def test_full_disk(capsys):
    """/dev/full refuses every byte, as a full disk does; a folder cannot be made there."""
    assert "cannot create output folder" in _refused(capsys, "bake", "cornell", "-o", "/dev/full/out")


def test_a_folder_in_use(capsys, tmp_path):
    with output_folder(tmp_path / "out", "bake", ()):
        for words in (("bake", "cornell"), ("compare", "cornell", "--fields", "mlp")):
            told = _refused(capsys, *words, "-o", tmp_path / "out")
            assert f"in use by 'lightwell bake', process {os.getpid()} on " in told and " since 2" in told


def test_files_of_others(capsys, tmp_path):
    (tmp_path / "scene.glb").write_bytes(b"mine")
    assert "overwrite with --force" in _refused(capsys, "bake", "cornell", "-o", tmp_path)
    assert "overwrite with --force" in _refused(capsys, "demo", "cornell", "-o", tmp_path, "--no-open")
    assert [path.name for path in tmp_path.iterdir()] == ["scene.glb"]


@pytest.mark.slow
def test_a_disk_that_fills_up_later(capsys, tmp_path, monkeypatch):
    """The first shard that does not fit: one line, exit code 2, no result."""
    import errno

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device", "shard_00000")

    monkeypatch.setattr(np, "save", full)
    assert main(["bake", "cornell", "-o", str(tmp_path / "out"), "--shards", "1", "--steps", "1", "--json"]) == 2
    assert "free some space" in capsys.readouterr().err
    assert not (tmp_path / "out/scene.glb").exists()


def test_view_and_compare_of_a_folder_without_a_bake(capsys, tmp_path):
    assert "index.html" in _refused(capsys, "view", tmp_path)
    assert "report.json" in _refused(capsys, "compare", tmp_path)


def test_render_refusals(capsys, tmp_path):
    out = tmp_path / "x.png"
    assert "--size" in _refused(capsys, "render", "cornell", "-o", out, "--size", "big")
    assert "--camera" in _refused(capsys, "render", "cornell", "-o", out, "--camera", "99")
    assert "--light" in _refused(capsys, "render", "cornell", "-o", out, "--light", "here", "or", "there")
    assert ".png" in _refused(capsys, "render", "cornell", "-o", tmp_path / "x.gif")
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_be_written_is_told_before_the_scene_is_loaded(capsys, tmp_path):
    # The scene is no scene: what is said of the file comes first.
    (tmp_path / "bad.glb").write_bytes(b"no scene")
    (tmp_path / "x.png").mkdir()
    (tmp_path / "x.npz").mkdir()
    cure = "the folder does not exist; create it first"
    for verb, name in (("render", "x.png"), ("samples", "x.npz")):
        line = _refused(capsys, verb, tmp_path / "bad.glb", "-o", tmp_path / "no" / name)
        assert f"cannot write '{tmp_path / 'no' / name}'" in line and line.endswith(cure) and line.count(cure) == 1
        line = _refused(capsys, verb, tmp_path / "bad.glb", "-o", tmp_path / name)
        assert "a folder of that name exists; choose another file name" in line
    for integrator in ("nrc", "vpl"):
        more = ("-o", tmp_path / "no/x.png", "--integrator", integrator)
        assert "cannot write" in _refused(capsys, "render", tmp_path / "bad.glb", *more)


def test_help_teaches_every_verb():
    text = subprocess.run(
        [sys.executable, "-m", "lightwell.cli", "--help"], capture_output=True, text=True, check=True
    ).stdout
    for verb in ("bake", "demo", "view", "render", "compare", "info", "doctor", "examples"):
        assert verb in text


def test_doctor_reports(capsys):
    assert main(["doctor", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert {check["name"] for check in report["checks"]} >= {"python", "backend", "kernel", "viewer", "disk"}


def test_doctor_survives_a_broken_backend():
    """A variant that does not exist: the finding and the cure, not a traceback."""
    environment = os.environ | {"LIGHTWELL_VARIANT": "abacus"}
    done = subprocess.run(
        [sys.executable, "-m", "lightwell.cli", "doctor"], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 1 and "abacus" in done.stdout and "Traceback" not in done.stderr


def test_render_writes_a_picture(tmp_path, capsys):
    for name in ("a.png", "a.exr"):
        assert main(["render", "cornell", "-o", str(tmp_path / name), "--size", "32x20", "--spp", "2", "--json"]) == 0
        facts = json.loads(capsys.readouterr().out)
        assert (facts["width"], facts["height"]) == (32, 20) and facts["mean_radiance"] > 0
        assert Path(tmp_path / name).stat().st_size > 100


@pytest.mark.parametrize("text", ["", "std::bad_alloc", "Unable to allocate 7.45 GiB\nfor an array"])
def test_memory_that_runs_out_is_one_line(monkeypatch, capsys, text):
    from lightwell.cli import doctor

    def run(arguments):
        raise MemoryError(text)

    monkeypatch.setattr(doctor, "run", run)
    assert main(["doctor"]) == 2
    line = capsys.readouterr().err
    assert line.startswith("lightwell: needs more memory than this machine has") and line.count("\n") == 1
    assert "bad_alloc" not in line and ("7.45 GiB" in line) == ("7.45" in text)
