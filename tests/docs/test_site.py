"""The documentation site builds without a warning (no broken link), and its pages are accessible and fit a phone."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-c", "docs", ".", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


def test_the_site_has_its_parts(site):
    assert "radiance" in (site / "docs/glossary.html").read_text()
    assert "docs/index.html" in (site / "index.html").read_text()
    assert "--spacing" in (site / "docs/reference/command-line.html").read_text()


def test_pages_are_accessible_and_do_not_scroll_sideways(site):
    pages = sorted(str(path.relative_to(site)) for path in site.rglob("*.html") if "_static" not in path.parts)
    pages.remove("index.html")  # leads on to docs/index.html at once
    done = subprocess.run(
        ["node", "tools/check-site.mjs", str(site), *pages], cwd=ROOT, capture_output=True, text=True, timeout=1800
    )
    wrong = [line for line in done.stdout.splitlines() if '"violations":[],"sideways":0' not in line]
    assert not wrong and done.returncode == 0, done.stderr[-1000:]
