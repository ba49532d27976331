"""A bake that is killed loses nothing but the last interval, and ends with the same bytes."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lightwell.baking.pipeline import bake
from lightwell.core.work import FOLDER, Work, WorkPart, store_of
from lightwell.scenes import load

from .conftest import small

# A child process that bakes until it is killed.
CHILD = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from tests.baking.conftest import small
from lightwell.baking.pipeline import bake
bake(small(Path(sys.argv[2]), steps=int(sys.argv[3]), views=1, resume=True))
"""

ROOT = Path(__file__).parents[2]
# Long enough that the kill arrives in the middle of the training.
STEPS = 300


def _start(out: Path) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-c", CHILD, str(ROOT), str(out), str(STEPS)], stderr=subprocess.PIPE)


def _stored(out: Path, name: str) -> bool:
    """Whether the store of a bake holds a result."""
    return any(entry.function == name for entry in store_of(out).entries())


def _wait_for(out: Path, name: str, child: subprocess.Popen, seconds: float = 300) -> None:
    end = time.monotonic() + seconds
    while not _stored(out, name):
        assert child.poll() is None, child.stderr.read().decode()
        assert time.monotonic() < end, f"{name} did not appear"
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["plan.samples"])
def test_killed_and_resumed(tmp_path, moment, uninterrupted):
    out = tmp_path / "out"
    child = _start(out)
    _wait_for(out, moment, child)
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    assert not (out / "scene.glb").exists()
    bake(small(out, steps=STEPS, views=1, resume=True))
    assert (out / "scene.glb").read_bytes() == uninterrupted
    assert not (out / FOLDER).exists()


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """The asset of the same bake, never killed."""
    out = tmp_path_factory.mktemp("whole") / "out"
    bake(small(out, steps=STEPS, views=1))
    return (out / "scene.glb").read_bytes()


@pytest.fixture
def ctrl_c():
    """Ctrl-C is heard: jobs in the background start with it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.slow
@pytest.mark.usefixtures("ctrl_c")
def test_interrupted_by_the_keyboard(tmp_path, baked, monkeypatch):
    """Ctrl-C is an interrupt like any other: the checkpoint stays, and the bake goes on from it to the same bytes."""
    put = WorkPart.put

    def pressed(self, name, *arguments):
        put(self, name, *arguments)
        if name == "fit.checkpoint":
            signal.raise_signal(signal.SIGINT)

    with monkeypatch.context() as patch:
        patch.setattr(WorkPart, "put", pressed)
        with pytest.raises(KeyboardInterrupt):
            bake(small(tmp_path, views=1))
    assert _stored(tmp_path, "fit.checkpoint") and not (tmp_path / "scene.glb").exists()
    bake(small(tmp_path, views=1, resume=True))
    assert (tmp_path / "scene.glb").read_bytes() == (baked[0] / "scene.glb").read_bytes()


def test_other_settings_are_not_resumed(tmp_path):
    settings = small(tmp_path, views=1, steps=10)
    # As a bake leaves it that was ended right after its beginning.
    assert not list(Work(settings, load(settings.scene).digest).store.entries())
    with pytest.raises(ValueError, match="other settings or another scene"):
        bake(small(tmp_path, views=1, steps=10, seed=5, resume=True))
