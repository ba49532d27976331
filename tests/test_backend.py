"""The door to Mitsuba: which files of which folders it may load."""

import subprocess
import sys
from pathlib import Path

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
