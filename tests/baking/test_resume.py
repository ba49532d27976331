"""A bake that is killed loses nothing but the last interval, and ends with the same bytes."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lightwell.baking.pipeline import bake
from lightwell.core.work import FOLDER, Work, store_of
from lightwell.scenes import load

from .conftest import small

# A child process that bakes until it is killed; jobs in the background start with Ctrl-C ignored, and hand that on.
CHILD = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from tests.baking.conftest import small
from lightwell.baking.pipeline import bake
bake(small(Path(sys.argv[2]), steps=int(sys.argv[3]), views=1, resume=True))
"""

ROOT = Path(__file__).parents[2]
# Long enough that the kill arrives in the middle of the training.
STEPS = 300
# Those of the session's bake: its first checkpoint comes before the adaptive stage, and scoring is left.
FEW_STEPS = 60


def _start(out: Path, steps: int = STEPS) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-c", CHILD, str(ROOT), str(out), str(steps)], stderr=subprocess.PIPE)


def _stored(out: Path, name: str) -> bool:
    """Whether the store of a bake holds a result."""
    return any(entry.function == name for entry in store_of(out).entries())


def _wait_for(out: Path, name: str, child: subprocess.Popen, seconds: float = 300) -> None:
    end = time.monotonic() + seconds
    while not _stored(out, name):
        assert child.poll() is None, child.stderr.read().decode()
        assert time.monotonic() < end, f"{name} did not appear"
        time.sleep(0.02)


def _interrupt(child: subprocess.Popen) -> None:
    """Press Ctrl-C as people do: again when nothing happens. Python loses one that arrives in a finaliser."""
    while child.poll() is None:
        child.send_signal(signal.SIGINT)
        try:
            child.wait(timeout=1)
        except subprocess.TimeoutExpired:
            continue


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


def test_interrupted_by_the_keyboard(tmp_path, baked):
    """Ctrl-C is an interrupt like any other: the checkpoint stays, and the bake goes on from it to the same bytes."""
    for attempt in range(4):
        out = tmp_path / f"out-{attempt}"
        child = _start(out, FEW_STEPS)
        _wait_for(out, "fit.checkpoint", child)
        _interrupt(child)
        # On a busy machine a short bake may be over before the signal is seen; that says nothing.
        if not (out / "scene.glb").exists():
            break
    assert _stored(out, "fit.checkpoint") and not (out / "scene.glb").exists()
    bake(small(out, steps=FEW_STEPS, views=1, resume=True))
    assert (out / "scene.glb").read_bytes() == (baked[0] / "scene.glb").read_bytes()


def test_other_settings_are_not_resumed(tmp_path):
    settings = small(tmp_path, views=1, steps=10)
    # As a bake leaves it that was ended right after its beginning.
    assert not list(Work(settings, load(settings.scene).digest).store.entries())
    with pytest.raises(ValueError, match="other settings or another scene"):
        bake(small(tmp_path, views=1, steps=10, seed=5, resume=True))
