"""Sequences survive being killed; the denoiser runs on a real picture."""

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, settings_of
from lightwell.cache.settings import parse_options
from lightwell.rendering.nrc import Film
from lightwell.rendering.sequence import render_sequence
from lightwell.rendering.settings import RenderSettings

from .scenes import SMALL as LITTLE
from .scenes import room

SMALL = ["levels=2", "entries_log2=8", "batch=512", "steps=1", "train_fraction_max=1", "max_vertices=4"]


def _command(folder, *more):
    words = [sys.executable, "-m", "lightwell.cli", "render", "cornell", "-o", str(folder), "--integrator", "nrc"]
    words += ["--size", "24x16", "--spp", "2", "--frames", "12", "--format", "png", *more]
    return words + [w for option in SMALL for w in ("--nrc", option)]


def _bytes(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("frame-*.png"))}


def _sequence(folder, frames, resume=False, progress=None, intensity=None, **options):
    """Render in this process: steps of ten degrees, so that frames see the inside of the box."""
    degrees = 10.0 * frames
    settings = parse_options([*SMALL, *(f"{name}={value}" for name, value in options.items())])
    asked = {"integrator": "nrc", "options": {"frames": frames, "format": "png", "resume": resume}}
    asked |= {"intensity": intensity}
    return render_sequence(RenderSettings("cornell", folder, (24, 16), 2, **asked), settings, degrees, progress)


class InterruptAt:
    """A progress display that interrupts the work when so many frames are done."""

    def __init__(self, frames):
        self.frames = frames

    @contextmanager
    def stage(self, *_):
        yield self

    def move_to(self, done):
        if done == self.frames:
            raise KeyboardInterrupt


@pytest.mark.slow
def test_a_sequence_killed_in_the_middle_ends_with_the_same_bytes(tmp_path):
    folder, whole = tmp_path / "killed", tmp_path / "whole"
    first = subprocess.Popen(_command(folder), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 240
    while not (folder / "frame-0001.png").exists() and first.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    assert len(_bytes(folder)) >= 2
    again = subprocess.run(_command(folder, "--resume"), capture_output=True, text=True, timeout=300, check=False)
    assert again.returncode == 0, again.stderr
    subprocess.run(_command(whole), capture_output=True, timeout=300, check=True)
    assert len(_bytes(whole)) == 12 and _bytes(folder) == _bytes(whole)
    assert (folder / "radiance-cache.npz").read_bytes() == (whole / "radiance-cache.npz").read_bytes()
    assert not (folder / ".lightwell.lock").exists()


@pytest.mark.parametrize(
    "options",
    [
        {"first_hit": "restir-di", "replay": 0.2},
        {"denoise": "true", "denoise_frames": 3},
        pytest.param({"guide": "always"}, marks=pytest.mark.slow),
        pytest.param({"first_hit": "restir-di"}, marks=pytest.mark.slow),
        pytest.param({"replay": 0.2}, marks=pytest.mark.slow),
    ],
)
def test_all_that_a_frame_depends_on_is_in_the_checkpoint(tmp_path, options):
    """Stopped after the second frame of five; guide, reservoirs and the pool of rays are more than weights."""
    _sequence(tmp_path / "whole", 5, **options)
    with pytest.raises(KeyboardInterrupt):
        _sequence(tmp_path / "cut", 5, progress=InterruptAt(2), **options)
    assert len(_bytes(tmp_path / "cut")) == 2
    assert _sequence(tmp_path / "cut", 5, resume=True, **options)["rendered"] == 3
    assert _bytes(tmp_path / "cut") == _bytes(tmp_path / "whole")


def test_without_a_sound_checkpoint_a_sequence_begins_anew(tmp_path, caplog):
    whole = tmp_path / "whole"
    _sequence(whole, 3)
    data = (whole / "radiance-cache.npz").read_bytes()
    for name, damage in {"damaged": data[:2000], "empty": b""}.items():
        shutil.copytree(whole, tmp_path / name)
        (tmp_path / name / "radiance-cache.npz").write_bytes(damage)
        (tmp_path / name / "frame-0001.png").write_bytes(b"another picture")
        caplog.clear()
        assert _sequence(tmp_path / name, 3, resume=True)["rendered"] == 3
        assert "the sequence begins anew" in caplog.text and "\n" not in caplog.messages[-1]
        assert _bytes(tmp_path / name) == _bytes(whole)
    (tmp_path / "damaged" / "frame-0000.png").unlink()
    assert _sequence(tmp_path / "damaged", 3, resume=True)["rendered"] == 3
    assert "frame-0000.png is missing" in caplog.text and _bytes(tmp_path / "damaged") == _bytes(whole)


def test_a_sequence_that_begins_anew_keeps_the_exposure_of_its_lamp(tmp_path):
    """Interrupted before its first checkpoint; with ``intensity`` no frame is exposed by itself."""
    _sequence(tmp_path / "whole", 2, intensity=3.0)
    with pytest.raises(KeyboardInterrupt):
        _sequence(tmp_path / "cut", 2, progress=InterruptAt(0), intensity=3.0)
    assert _sequence(tmp_path / "cut", 2, resume=True, intensity=3.0)["rendered"] == 2
    assert _bytes(tmp_path / "cut") == _bytes(tmp_path / "whole")


def test_frames_of_others_stay(tmp_path):
    (tmp_path / "frame-0000.png").write_bytes(b"mine")
    with pytest.raises(ValueError, match=r"'frame-0000.png', which lightwell did not write"):
        _sequence(tmp_path, 3)
    assert [path.name for path in tmp_path.iterdir()] == ["frame-0000.png"]


def test_the_denoiser_brings_a_picture_nearer_to_the_truth():
    scene = room(64)
    truth = np.array(mi.render(scene, integrator=mi.load_dict({"type": "path", "max_depth": -1}), spp=256, seed=9))
    options = {"mode": "frames", "batch": 512, "levels": 3, "entries_log2": 10}
    errors = {}
    for denoise in (False, True):
        nrc = NrcIntegrator(settings=settings_of({**options, "denoise": denoise, "termination_c": "inf"}))
        image = np.array(mi.render(scene, integrator=nrc, spp=4, seed=1))
        assert image.shape == (64, 64, 3) and np.isfinite(image).all()
        errors[denoise] = float(np.mean((image - truth) ** 2 / (truth**2 + 0.01)))
    assert errors[True] < 0.5 * errors[False]


def test_a_denoised_still_is_path_traced_unless_it_is_blended():
    """The denoiser does not remove the blur of the cache: nothing is trained, and no path ends in it."""
    scene = room(16)
    for blends in (False, True):
        nrc = NrcIntegrator(settings=settings_of({**LITTLE, "mode": "still", "denoise": True, "denoise_cache": blends}))
        mi.render(scene, integrator=nrc, spp=8, seed=1)
        assert nrc.last.caching == blends and bool(nrc.last.stats) == blends


def test_a_scene_without_light_has_a_lamp_in_free_air(tmp_path):
    # The middle of a scene, where it once was, may lie in a wall: pictures were black.
    film = Film(RenderSettings("two-rooms", tmp_path / "a.png", (16, 12), 4, integrator="nrc"))
    np.testing.assert_allclose(film.live.lamp.place, film.shot.good_light)
    assert film.render(mi.load_dict({"type": "path"}), 1).mean() > 1e-3
