"""Sequences survive being killed; the denoiser runs on a real picture."""

import os
import signal
import subprocess
import sys
import time

import numpy as np

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, settings_of

from .scenes import room

SMALL = ["levels=2", "entries_log2=8", "batch=512", "steps=1", "train_fraction_max=1", "max_vertices=4"]


def _command(folder, *more):
    words = [sys.executable, "-m", "lightwell.cli", "render", "cornell", "-o", str(folder), "--integrator", "nrc"]
    words += ["--size", "24x16", "--spp", "2", "--frames", "12", "--format", "png", *more]
    return words + [w for option in SMALL for w in ("--nrc", option)]


def test_a_sequence_killed_in_the_middle_is_finished_by_resume(tmp_path):
    first = subprocess.Popen(_command(tmp_path), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 240
    while not (tmp_path / "frame-0003.png").exists() and first.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    done = sorted(p.name for p in tmp_path.glob("frame-*.png"))
    assert len(done) >= 4
    stamps = {name: (tmp_path / name).stat().st_mtime_ns for name in done}
    again = subprocess.run(_command(tmp_path, "--resume"), capture_output=True, text=True, timeout=300, check=False)
    assert again.returncode == 0, again.stderr
    assert len(list(tmp_path.glob("frame-*.png"))) == 12
    assert all((tmp_path / name).stat().st_mtime_ns == stamp for name, stamp in stamps.items())
    from PIL import Image

    pictures = [np.array(Image.open(p)) for p in sorted(tmp_path.glob("frame-*.png"))]
    assert all(p.shape == (16, 24, 3) for p in pictures) and pictures[0].std() > 5
    assert float((tmp_path / "exposure.txt").read_text()) > 0  # the second half is exposed like the first
    assert not list(tmp_path.glob(".*.part")) or len(done) < 12  # what the kill left behind is no picture


def test_the_denoiser_brings_a_picture_nearer_to_the_truth():
    scene = room(64)
    truth = np.array(mi.render(scene, integrator=mi.load_dict({"type": "path", "max_depth": -1}), spp=1024, seed=9))
    options = {"mode": "frames", "batch": 512, "levels": 3, "entries_log2": 10}
    errors = {}
    for denoise in (False, True):
        nrc = NrcIntegrator(settings=settings_of({**options, "denoise": denoise, "termination_c": "inf"}))
        image = np.array(mi.render(scene, integrator=nrc, spp=4, seed=1))
        assert image.shape == (64, 64, 3) and np.isfinite(image).all()
        errors[denoise] = float(np.mean((image - truth) ** 2 / (truth**2 + 0.01)))
    assert errors[True] < 0.5 * errors[False]
