"""The documentation site builds without a warning: no broken link, no page that is left out."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_site_builds(tmp_path):
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-b",
        "html",
        "-c",
        "docs",
        ".",
        str(tmp_path),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "radiance" in (tmp_path / "docs/glossary.html").read_text()
    assert "docs/index.html" in (tmp_path / "index.html").read_text()
    assert "--spacing" in (tmp_path / "docs/reference/command-line.html").read_text()
