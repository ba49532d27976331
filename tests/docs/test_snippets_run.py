"""Every shell command and Python snippet of README and docs runs, in the order of its page, with a small budget."""

import os
import runpy
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from lightwell.cli import main

from .found_files import provide
from .snippets import PAGES, ROOT, commands, lowered, small_python, snippets

LIGHTWELL = [sys.executable, "-m", "lightwell"]
SERVERS = ("view", "live")
# A line that says that a server answers, or that a bake has ended.
ANSWERS, ENDED = "http://127.0.0.1", "open "
# Their exit code is 1 where they find something: a small library of spreadlets breaks its limits.
FINDERS = ("doctor", "lens")
# Commands that set up a machine, or are run by tests of their own (tests of the web package, of the wheel, of make).
LEFT_OUT = (
    "make",
    "npm",
    "npx",
    "node",
    "pip",
    "docker",
    "curl",
    "git",
    "cd",
    "sudo",
    "apt",
    "brew",
    "eval",
    "export",
    "man",
    "dask",
    "kubectl",
)
# Pages whose commands trace and train nothing: they run in every `make test`, on a bake that is kept in the repository.
QUICK = {
    *(f"docs/how-to/{verb}.md" for verb in ("completion", "doctor", "info", "man", "store", "validate", "view")),
    *("docs/reference/command-line.md", "docs/tutorials/install.md", "docs/web.md"),
}


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT))


RUN = [
    pytest.param(page, id=_name(page), marks=[] if _name(page) in QUICK else pytest.mark.slow)
    for page in PAGES
    if any(s.language in ("sh", "python") for s in snippets(page))
]


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    out = tmp_path_factory.mktemp("docs") / "out"
    assert main(lowered(["lightwell", "bake", "cornell", "-o", str(out)])[1:]) == 0
    return out


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    out = tmp_path_factory.mktemp("kept") / "out"
    out.mkdir()
    shutil.copy(ROOT / "tests/compatibility/0.1.0/factored.glb", out / "scene.glb")
    shutil.copy(ROOT / "lightwell/viewer/index.html", out)
    return out


def test_quick_pages_exist():
    assert {param.id for param in RUN} >= QUICK


@pytest.mark.parametrize("page", RUN)
def test_snippets_run(page, request, tmp_path, monkeypatch, capfd):
    """As a reader would paste them: one after the other, in one folder, in a Python session that goes on."""
    out = request.getfixturevalue("kept" if _name(page) in QUICK else "fresh")
    provide(tmp_path, out, settings=page.name == "batch.md")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LIGHTWELL_STORE", str(tmp_path.parent / "store"))
    session = ""
    for snippet in snippets(page):
        if snippet.language == "sh":
            for words in commands(snippet):
                _command(snippet.where, words, tmp_path, capfd)
        elif snippet.language == "python":
            session += f"\n# {snippet.where}\n{small_python(snippet.text)}\n"
    if session:
        (tmp_path / "session.py").write_text(session)
        runpy.run_path(str(tmp_path / "session.py"), run_name="__main__")


def _command(where: str, words: list[str], folder: Path, capfd) -> None:
    program = words[0]
    if program in LEFT_OUT or (program == "python" and words[1].startswith(("benchmarks/", "tools/", "-m"))):
        return
    if program == "python":
        _run([sys.executable, str(ROOT / words[1]), *words[2:]], folder)
    elif "--cluster" in words and not words[words.index("--cluster") + 1].startswith("local:"):
        return  # other machines
    elif len(words) > 1 and words[1] in SERVERS:
        _serve([*LIGHTWELL, *words[1:], "--no-open", "--port", "0"], folder, ANSWERS)
    elif "--watch" in words:
        _serve([*LIGHTWELL, *lowered(words)[1:]], folder, ENDED)
    else:
        allowed = (0, 1) if words[1:2] and words[1] in FINDERS else (0,)
        code = _exit_code(lowered(words)[1:])
        assert code in allowed, f"{where}: {' '.join(words)}: exit code {code}\n{capfd.readouterr().err[-1500:]}"


def _exit_code(argv: list[str]) -> int:
    try:
        return main(argv)
    except SystemExit as ended:
        return int(ended.code or 0)


def _environment(folder: Path) -> dict[str, str]:
    paths = os.pathsep.join([str(folder), str(ROOT), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"PYTHONPATH": paths, "LIGHTWELL_STORE": str(folder.parent / "store")}


def _run(argv: list[str], folder: Path, allowed: tuple[int, ...] = (0,)) -> subprocess.CompletedProcess:
    done = subprocess.run(argv, cwd=folder, env=_environment(folder), capture_output=True, text=True, timeout=900)
    assert done.returncode in allowed, f"{' '.join(argv[1:])}\n{done.stderr[-1500:]}"
    return done


def _serve(argv: list[str], folder: Path, sign: str) -> None:
    """Start what runs until it is ended, wait for a line with a sign, and end it by Ctrl-C."""
    with subprocess.Popen(
        argv, cwd=folder, env=_environment(folder), stderr=subprocess.STDOUT, stdout=subprocess.PIPE, text=True
    ) as server:
        lines = []
        for line in server.stdout:
            lines.append(line)
            if sign in line:
                break
        server.send_signal(signal.SIGINT)
        assert server.wait(120) == 130, "".join(lines)
