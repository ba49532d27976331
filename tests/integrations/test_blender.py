"""The Blender extension: what needs no Blender, and all of it in Blender 4.2, 4.5 and 5.0 without a window."""

import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

try:
    import tomllib
except ImportError:  # Python 3.10; pytest brings it there.
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
EXTENSION = ROOT / "integrations/blender"


@pytest.fixture(autouse=True)
def _path(monkeypatch):
    monkeypatch.syspath_prepend(str(EXTENSION / "lightwell_bake"))
    monkeypatch.syspath_prepend(str(EXTENSION))


def ended(job, seconds=20.0) -> int:
    """Exit code of a job, polled as the modal operator does."""
    until = time.monotonic() + seconds
    while (code := job.poll()) is None:
        assert time.monotonic() < until
        time.sleep(0.02)
    return code


def test_the_command_line_is_one_that_bake_takes():
    from command import Request, bake_command, lamp_box, sun_arc

    from lightwell.cli.main import verb_parser
    from lightwell.core.vary import parse_vary

    box = lamp_box((1, 2, 3), (0.5, 0.25, 0.125))
    assert box[0] == "light.position=box(0.5,2.875,-2.25,1.5,3.125,-1.75)"
    assert parse_vary(box[0]).values == (0.5, 2.875, -2.25, 1.5, 3.125, -1.75)
    assert parse_vary(box[1]).parameter == "clearance"
    assert parse_vary(sun_arc((1.5707963, 0.1745329), (4.712389, 0.1745329))[0]).values == pytest.approx(
        (90, 10, 270, 10)
    )
    request = Request(Path("a.glb"), Path("out"), "lightmap", "draft", 90, box, Path("log"))
    words = bake_command(["lightwell"], request)
    assert words[:6] == ["lightwell", "bake", "a.glb", "-o", "out", "--quality"]
    parsed = verb_parser("bake", words[2:]).parse_args(words[2:])
    assert parsed.field == "lightmap" and list(parsed.vary) == list(box) and str(parsed.log) == "log"


def test_a_job_says_what_it_does_and_how_it_ended(tmp_path):
    from job import Job

    program = (
        "import sys, time\n"
        "open(sys.argv[1], 'a').write('2026-11-23 10:00:00,123 INFO    training: 40 steps\\n')\n"
        "print('lightwell: no light; add one', file=sys.stderr)\n"
        "sys.exit(2)"
    )
    job = Job([sys.executable, "-c", program, str(tmp_path / "progress.log")], tmp_path)
    assert ended(job) == 2
    assert job.stage().strip() == "training: 40 steps" and job.message() == "lightwell: no light; add one"


def test_a_job_that_ignores_the_request_to_end_is_killed(tmp_path):
    from job import PATIENCE, Job

    program = (
        "import signal, sys, time\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "print('up', file=sys.stderr, flush=True)\n"
        "time.sleep(60)"
    )
    job = Job([sys.executable, "-c", program], tmp_path)
    until = time.monotonic() + 20
    while job.message() != "up" and time.monotonic() < until:
        time.sleep(0.02)
    job.cancel()
    asked = time.monotonic()
    assert ended(job) != 0 and time.monotonic() - asked >= 0.9 * PATIENCE
    job.cancel()


def test_a_program_that_is_missing_is_an_error_of_the_system(tmp_path):
    from job import Job, lost_in

    with pytest.raises(OSError):
        Job([str(tmp_path / "nothing")], tmp_path)
    assert lost_in(tmp_path / "report.json") == []
    (tmp_path / "report.json").write_text('{"warnings": ["a light is ignored"]}')
    assert lost_in(tmp_path / "report.json") == ["a light is ignored"]


def test_the_zip_holds_the_manifest_with_its_wheels(tmp_path):
    from build import PLATFORMS, build, manifest

    wheel = tmp_path / "lightwell-0.1.0-py3-none-any.whl"
    wheel.write_bytes(b"wheel")
    path = build(tmp_path / "out", "linux-x64", [wheel])
    with zipfile.ZipFile(path) as archive:
        names = set(archive.namelist())
        found = tomllib.loads(archive.read("blender_manifest.toml").decode())
    assert {"__init__.py", "operators.py", f"wheels/{wheel.name}"} < names
    assert found["wheels"] == [f"./wheels/{wheel.name}"] and found["platforms"] == ["linux-x64"]
    # Rules of Blender's extension schema 1.0.0.
    assert found["schema_version"] == "1.0.0" and found["type"] == "add-on" and len(found["tagline"]) <= 64
    assert not found["tagline"].endswith(".") and all(len(text) <= 64 for text in found["permissions"].values())
    assert set(found["permissions"]) <= {"files", "network", "clipboard", "camera", "microphone"}
    import lightwell

    assert found["version"] == lightwell.__version__ and set(PLATFORMS) >= {"linux-x64"}
    assert "wheels" not in tomllib.loads(manifest([], ""))
    assert build(tmp_path / "two", "linux-x64", [wheel]).read_bytes() == path.read_bytes()


@pytest.mark.slow
def test_in_blender(tmp_path, every_blender):
    """Registers, exports, bakes, cancels, applies, and reports every error, with events of a timer."""
    script = Path(__file__).with_name("in_blender.py")
    baked = ROOT / "web/test/fixtures/lightmap.glb"
    added = {"LIGHTWELL_PYTHON": sys.executable, "LIGHTWELL_BAKED": str(baked), "LIGHTWELL_BAKE": "1"}
    command = [every_blender, str(script), str(EXTENSION), str(tmp_path)]
    done = subprocess.run(command, env=os.environ | added, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "all of it works" in done.stdout
