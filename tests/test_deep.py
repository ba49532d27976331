"""Deep pictures, end to end: rendered, written, read by the lens."""

import numpy as np
import pytest

from lightwell.cli import main
from lightwell.lens import exr, frames
from lightwell.rendering.deep import write_deep
from lightwell.rendering.settings import RenderSettings


def test_deep_samples_come_back_in_order(tmp_path):
    radiance = np.random.default_rng(0).random((3, 4, 5, 3)).astype(np.float32)
    depth = np.sort(np.random.default_rng(1).random((3, 4, 5)).astype(np.float32) + 1, axis=0)
    depth[2, :, :3], depth[1, 0, 0], radiance[:, 3, 4], depth[:, 3, 4] = np.inf, np.inf, 0, np.inf
    write_deep(tmp_path / "a.exr", radiance, depth)
    found = exr.read(tmp_path / "a.exr").deep
    counts, z = found["Z"]
    assert counts[0, 0] == 1 and counts[1, 1] == 2 and counts[1, 4] == 3 and counts[3, 4] == 0
    np.testing.assert_array_equal(z[:1], depth[0, 0, 0])
    start = int(counts.ravel()[:9].sum())
    np.testing.assert_array_equal(found["G"][1][start : start + 3], radiance[:, 1, 4, 1])


def test_the_lens_sees_what_is_behind(tmp_path):
    path = tmp_path / "deep.exr"
    argv = ["render", "cornell", "-o", str(path), "--size", "24x16", "--spp", "2", "--deep", "3"]
    assert main(argv) == 0
    frame = frames.read(path, layers=2)
    counts, z = exr.read(path).deep["Z"]
    # The boxes hide walls, and walls hide nothing or their own backs.
    assert counts.max() >= 2 and len(frame.behind) == 1
    first = np.concatenate([[0], np.cumsum(counts.ravel())[:-1]])[counts.ravel() > 1]
    # The underside of a box and the floor that it stands on are one place.
    assert (z[first + 1] > z[first] - 1e-3).all() and (z[first + 1] > z[first] + 0.1).mean() > 0.5
    rgba, depth = frame.behind[0]
    assert rgba[..., 3].max() > 0 and np.isfinite(depth).any()


def test_deep_is_for_exr_alone(tmp_path):
    with pytest.raises(ValueError, match=r"--deep writes an .exr without --aov, not '.*a.png'"):
        RenderSettings(scene="cornell", out=tmp_path / "a.png", options={"deep": 2})
