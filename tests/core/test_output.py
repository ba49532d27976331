"""Output folders have one writer at a time and keep files of others."""

import json
import os
import re
import signal
import socket
import subprocess
import sys

import pytest

from lightwell.core.output import BAKE_FILES, is_own, output_folder

HOLD = """
import sys, time
from pathlib import Path
from lightwell.core.output import output_folder
with output_folder(Path(sys.argv[1]), "bake", ()):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path):
    """A process that holds tmp_path/out."""
    with subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path / "out")], stdout=subprocess.PIPE) as child:
        assert child.stdout.readline() == b"held\n"
        yield child
        child.kill()


def test_the_second_writer_is_told_who_holds_the_folder(tmp_path, holder):
    who = rf"in use by 'lightwell bake', process {holder.pid} on {re.escape(socket.gethostname())}, since 2\d+-.* UTC;"
    with pytest.raises(ValueError, match=who) as caught, output_folder(tmp_path / "out", "bake", ()):
        pass
    assert "\n" not in str(caught.value)
    assert (tmp_path / "out" / ".lightwell.lock").exists(), "the first writer has lost its lock"


def test_a_killed_writer_blocks_nobody(tmp_path, holder):
    os.kill(holder.pid, signal.SIGKILL)
    holder.wait()
    with output_folder(tmp_path / "out", "bake", ()) as out:
        (out / "scene.glb").write_bytes(b"")
    assert [path.name for path in out.iterdir()] == ["scene.glb"]


def test_two_threads_of_a_process_exclude_each_other(tmp_path):
    with output_folder(tmp_path, "bake", ()):
        with pytest.raises(ValueError, match="in use by"), output_folder(tmp_path, "compare", ()):
            pass
    with output_folder(tmp_path, "compare", ()):
        pass


def test_files_of_others_stay(tmp_path):
    (tmp_path / "scene.glb").write_bytes(b"mine")
    with pytest.raises(ValueError, match=r"holds 'scene.glb', which lightwell did not write; .* with --force"):
        with output_folder(tmp_path, "bake", BAKE_FILES):
            raise AssertionError("the folder was given away")
    assert [path.name for path in tmp_path.iterdir()] == ["scene.glb"]
    with output_folder(tmp_path, "bake", BAKE_FILES, force=True):
        pass
    (tmp_path / "index.html").write_text("mine")
    with (
        pytest.raises(ValueError, match=r"'index.html' and 1 more, which"),
        output_folder(tmp_path, "bake", BAKE_FILES),
    ):
        pass


def test_other_files_are_no_obstacle(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with output_folder(tmp_path, "bake", BAKE_FILES):
        pass
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("content", ['{"versions": {"lightwell": "0.1.0"}}', None])
def test_its_own_folder_is_written_again(tmp_path, content):
    (tmp_path / "scene.glb").write_bytes(b"")
    if content is None:
        (tmp_path / ".lightwell").mkdir()
        (tmp_path / ".lightwell" / "bake.json").write_text(json.dumps({"signature": ""}))
    else:
        (tmp_path / "report.json").write_text(content)
    assert is_own(tmp_path)
    with output_folder(tmp_path, "bake", BAKE_FILES):
        pass


def test_a_report_of_another_program_is_no_mark(tmp_path):
    for text in ("[]", '{"error": 1}', "report", "[" * 100_000):
        (tmp_path / "report.json").write_text(text)
        assert not is_own(tmp_path)


def test_a_refused_command_leaves_no_folder(tmp_path):
    with pytest.raises(RuntimeError), output_folder(tmp_path / "a", "bake", ()):
        raise RuntimeError
    assert not (tmp_path / "a").exists()
