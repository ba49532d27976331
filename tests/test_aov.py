"""Output variables of a picture: right values, and names that the lens finds."""

import numpy as np

from lightwell.cli import main
from lightwell.lens import exr, frames
from lightwell.rendering.aov import channels
from lightwell.scenes import load


def test_the_lens_finds_depth_and_motion_by_itself(tmp_path):
    picture = tmp_path / "a.exr"
    argv = ["render", "cornell", "-o", str(picture), "--size", "32x20", "--spp", "2"]
    assert main([*argv, "--aov", "depth,motion,albedo,normal"]) == 0
    frame = frames.read(picture)
    assert frame.depth_kind == "planar" and frame.motion is not None and not frame.motion.any()
    names = exr.read(picture).names
    assert {"R", "depth.Z", "motion.X", "albedo.G", "normal.Y"} <= names.keys()
    assert main(["render", "cornell", "-o", str(tmp_path / "b.exr"), "--size", "32x20", "--spp", "2"]) == 0
    assert np.abs(exr.read(tmp_path / "b.exr").names["G"] - names["G"]).max() < 1e-3  # the same picture (half floats)


def test_depth_is_along_the_axis_of_the_camera():
    """The back wall of the box is parallel to the picture: one depth for all of its pixels."""
    scene = load("cornell")
    found = channels(scene, scene.cameras[0], 64, 40, ("depth", "normal", "albedo"))
    depth, seen = found["depth.Z"], np.isfinite(found["depth.Z"])
    wall = seen & (np.abs(found["normal.Z"]) > 0.99) & (depth > depth[seen].max() - 0.1)
    assert wall.sum() > 50 and np.ptp(depth[wall]) < 0.02
    lengths = sum(found[f"normal.{axis}"] ** 2 for axis in "XYZ")[seen]
    assert np.allclose(lengths, 1, atol=1e-4)
    assert found["albedo.R"].max() <= 1.05 and np.array_equal(~seen, found["albedo.R"] == 0)
