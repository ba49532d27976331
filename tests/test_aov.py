"""Output variables of a picture: right values, and names that the lens finds."""

import numpy as np

from lightwell.cli import main
from lightwell.lens import exr, frames
from lightwell.rendering.aov import channels
from lightwell.rendering.path import render_path
from lightwell.rendering.settings import RenderSettings
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


def test_channels_and_the_point_light_are_as_set_says(tmp_path):
    """A node that --set moves is there in all channels; a colour of the point light is not its brightest number."""

    def shown(name: str, *state: str, **more) -> dict[str, np.ndarray]:
        given = {"size": (32, 20), "spp": 1, "aov": ("depth",), "set": state, **more}
        render_path(RenderSettings("doorway", tmp_path / name, **given))
        return exr.read(tmp_path / name).names

    rest, moved = shown("a.exr"), shown("b.exr", "node:Door.rotation=80")
    assert np.array_equal(moved["depth.Z"], shown("c.exr", "node:Door.rotation=80", "light=0")["depth.Z"])
    there = np.isfinite(rest["depth.Z"]) & np.isfinite(moved["depth.Z"])
    assert np.abs(rest["depth.Z"] - moved["depth.Z"])[there].max() > 0.1
    dark = {"lamps": ("all",)}
    red = shown("d.exr", "lights=0", "light=1,0,0", **dark)
    assert red["R"].max() > 0 and not red["G"].any() and not red["B"].any()
    green = shown("e.exr", "lights=0", vary=("light.color=0,1,0", "light.intensity=2"), **dark)
    assert green["G"].max() > 0 and not green["R"].any()


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
