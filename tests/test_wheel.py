"""A fresh environment, installed from a folder of wheels without a network, runs `lightwell demo`."""

import os
import subprocess
import sys
import venv

import pytest

SMALL = ["--shards", "1", "--steps", "4", "--paths", "2", "--views", "1", "--truth", "0.1s", "--no-open"]


@pytest.mark.slow
def test_the_wheel_alone_runs_the_demo(tmp_path, wheel, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wheels, home = tmp_path / "wheels", tmp_path / "venv"
    _run(sys.executable, "-m", "pip", "download", "-q", "-d", wheels, wheel)
    venv.create(home, with_pip=True)
    programs = home / ("Scripts" if sys.platform == "win32" else "bin")
    install = ["-m", "pip", "install", "-q", "--no-compile", "--no-index", "--find-links", wheels, "lightwell"]
    _run(programs / "python", *install, without=("PYTHONPATH", "PIP_FIND_LINKS"))
    _run(programs / "lightwell", "demo", "two-rooms", "-o", tmp_path / "demo", *SMALL)
    names = {path.name for path in (tmp_path / "demo").iterdir()}
    assert {"scene.glb", "index.html", "report.html", "report.json"} <= names
    _run(programs / "lightwell", "doctor")
    _run(programs / "lightwell", "completion", "bash")


def _run(*words, without=("PYTHONPATH",)):
    """Run a program without the checkout on its path."""
    environment = {name: value for name, value in os.environ.items() if name not in without}
    done = subprocess.run([str(w) for w in words], env=environment, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr[-2000:]
