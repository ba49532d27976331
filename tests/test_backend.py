"""The door to Mitsuba: which files of which folders it may load."""

import subprocess
import sys
from pathlib import Path

import pytest

from lightwell.backend import cure

PROGRAM = """
import sys; sys.path[:] = sys.argv[1:]
from lightwell.backend import mi
print(mi.load_dict({"type": "diffuse"}).class_name(), mi.file_resolver())
"""


def test_plugins_of_the_working_folder_are_not_loaded(tmp_path):
    (tmp_path / "plugins").mkdir()
    for suffix in (".so", ".dylib", ".dll"):
        (tmp_path / "plugins" / f"diffuse{suffix}").write_text("a stranger's code")
    path = [str(Path(__file__).parents[1]), *filter(None, sys.path)]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *path], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.startswith("SmoothDiffuse"), done.stderr
    assert str(tmp_path) not in done.stdout


@pytest.mark.parametrize(
    "system, processor, what",
    [
        ("linux", "x86_64", "pip install karellen-llvm-core"),
        ("linux", "aarch64", "apt-get install llvm-18"),
        ("darwin", "arm64", "brew install llvm"),
        ("win32", "AMD64", "LLVM-C.dll"),
    ],
)
def test_the_cure_of_each_platform_is_one_line_and_in_the_docs(system, processor, what):
    line = cure(system, processor)
    assert what in line and "\n" not in line and "DRJIT_LIBLLVM_PATH" in line
    table = (Path(__file__).parents[1] / "docs/tutorials/install.md").read_text()
    assert (what.removeprefix("pip install ") if system != "win32" else "the LLVM installer") in table
