"""Every file of ../shared/hostile ends as its expect.tsv says: one line, soon, in little memory, nothing written."""

import csv
import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fuzz_run import Outcome, Worker

ROOT = Path(__file__).parents[2]
HOSTILE = ROOT.parent / "shared" / "hostile"
# What each file may take: bytes beyond an idle interpreter, seconds. The seconds are those of the processor, so that a
# busy machine does not fail the test; a file that waits for ever is ended by the other limit.
MOST_BYTES, MOST_SECONDS, MOST_WAIT = 2 << 30, 15, 240
# Address space of a process that has imported everything and read nothing, bytes (LLVM and its threads map much).
IDLE_BYTES = 4 << 30

CALLS = {
    "python lightwell probes reader": "from lightwell.probes.file import read; read(PATH)",
    "python RadianceCache.load": "from lightwell.cache.radiance_cache import RadianceCache; RadianceCache.load(PATH)",
}
# The readers of tests/fuzz, by how expect.tsv says that a file is read.
READERS = {"info": "scene", "export": "export", "lens": "frame", **dict(zip(CALLS, ("probes", "cache")))}
# Files that every run opens through the command line too; the others are opened so in long runs.
FEW = ("xml/plugin_cwd.xml", "truncated.exr", "asset_png_bomb.glb")
CALLER = """
import sys
PATH = sys.argv[1]
try:
    {call}
except ValueError as error:
    print(error, file=sys.stderr)
    sys.exit(2)
"""


def _rows() -> list[dict[str, str]]:
    if not HOSTILE.is_dir():
        return []
    with open(HOSTILE / "expect.tsv", newline="") as stream:
        return [row for row in csv.DictReader(stream, delimiter="\t") if row["expect"] != "helper"]


def _command(how: str, file: Path, out: Path) -> list[str]:
    lightwell = [sys.executable, "-m", "lightwell.cli"]
    if how in CALLS:
        return [sys.executable, "-c", CALLER.format(call=CALLS[how]), str(file)]
    if how == "lens":
        return [*lightwell, "lens", str(file), "-o", str(out / "out.exr"), "--focus", "2m"]
    if how == "export":
        return [*lightwell, "export", str(file), "--to", "glsl", "-o", str(out / "out.glsl")]
    return [*lightwell, "info", str(file)]


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (IDLE_BYTES + MOST_BYTES,) * 2)
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _copied(row: dict[str, str], folder: Path) -> Path:
    """Copy what lies beside a file, with what it needs made; returns the copied file."""
    shutil.copytree(HOSTILE / Path(row["file"]).parent, folder)
    for path in (folder, *folder.rglob("*")):
        path.chmod(path.stat().st_mode | 0o200)
    file = folder / Path(row["file"]).name
    if file.name == "plugin_cwd.xml":
        _build_plugin(folder)
    if file.name == "plyhuge.xml":
        # The folder holds the mesh as it was before its header was changed.
        mesh = folder / "tri.ply"
        mesh.write_bytes(mesh.read_bytes().replace(b"element vertex 3", b"element vertex 400000000"))
    return file


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory) -> dict[str, Outcome]:
    """How each file ends in the readers themselves: one limited process for each kind of file."""
    found = {}
    for how, reader in READERS.items():
        with Worker(reader, MOST_SECONDS, MOST_BYTES) as worker:
            for row in (row for row in _rows() if row["how"] == how):
                folder = tmp_path_factory.mktemp("hostile") / "files"
                found[row["file"]] = worker.open(_copied(row, folder))
                shutil.rmtree(folder)
    return found


@pytest.mark.skipif(not HOSTILE.is_dir(), reason="../shared/hostile is not here")
def test_readers_end_as_expected(outcomes):
    wanted = {row["file"]: "accepted" if row["expect"] == "accept" else "refused" for row in _rows()}
    assert outcomes.keys() == wanted.keys() and len(wanted) > 30
    assert {file: o for file, o in outcomes.items() if o.kind != wanted[file]} == {}


@pytest.mark.skipif(not HOSTILE.is_dir(), reason="../shared/hostile is not here")
@pytest.mark.parametrize(
    "row",
    [pytest.param(row, marks=() if row["file"] in FEW else pytest.mark.slow, id=row["file"]) for row in _rows()],
)
def test_the_command_line_ends_as_expected(row, tmp_path):
    folder, out = tmp_path / "hostile", tmp_path / "out"
    file = _copied(row, folder)
    out.mkdir()
    before = sorted(path.name for path in folder.rglob("*"))
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "DRJIT_THREADS": "1"}
    begin = time.monotonic()
    done = subprocess.run(
        _command(row["how"], file, out),
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment,
        timeout=MOST_WAIT,
        preexec_fn=_limited,
    )
    said = f"{done.stderr[-600:]} ({time.monotonic() - begin:.0f} s)"
    assert done.returncode == (0 if row["expect"] == "accept" else 2), said
    assert "Traceback" not in done.stderr, said
    if row["expect"] == "refuse":
        assert len(done.stderr.strip().splitlines()) == 1, said
        assert file.stem in done.stderr, said
    after = sorted(path.name for path in folder.rglob("*"))
    assert after == before
    assert not list(out.iterdir())


def _build_plugin(folder: Path) -> None:
    """The library that the scene names, beside it; it creates a file when it is loaded."""
    compiler = shutil.which("cc")
    if compiler:
        command = [compiler, "-shared", "-fPIC", "-o", str(folder / "evil.so"), str(folder / "evil.c")]
        subprocess.run(command, check=True, timeout=60)
