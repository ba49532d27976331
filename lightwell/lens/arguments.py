"""Arguments of the verb ``lens``. This module imports nothing slow, so that ``--help`` answers at once."""

from __future__ import annotations

import argparse

DESCRIPTION = """\
lightwell lens FRAME.exr -o OUT.exr --focus 2.5m --fstop 1.8 --focal 50mm     one frame
lightwell lens 'shot.####.exr' --frames 1-48 -o 'out.####.exr' …              a sequence
lightwell lens FRAME.png --depth-file DEPTH.png --depth-range 1,20 -o OUT.png …
lightwell lens bake LIBRARY.lwsp [--family depth --largest 32]                write a library of spreadlets
lightwell lens check LIBRARY.lwsp [--node N] [--plot OUT.png]                 integrate it back, print its errors

FRAME holds colour, depth along the camera axis and, for motion blur, vectors in pixels per frame. The names that
Blender, Mitsuba and Nuke give these channels are known; the options say what the file does not."""


def add(parser: argparse.ArgumentParser) -> None:
    """Add all options of the verb.

    Args:
        parser: Parser to extend.
    """
    parser.add_argument("frame", metavar="FRAME|bake|check", help="picture to blur: .exr or .png; #### for sequences")
    parser.add_argument("library", metavar="LIBRARY", nargs="?", help="library to write or check")
    parser.add_argument("-o", "--out", help="picture to write: .exr (linear) or .png (sRGB)")
    _camera(parser.add_argument_group("camera"))
    _quality(parser.add_argument_group("quality"))
    _channels(parser.add_argument_group("what the file means"))
    _library(parser.add_argument_group("bake and check"))
    parser.add_argument(
        "--store", metavar="DIR", help="folder of the store (default: LIGHTWELL_STORE, else the platform's for caches)"
    )
    parser.add_argument("--json", action="store_true", help="print what was done as JSON, no progress bars")


def _camera(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--focus", help="distance in focus, for example 2.5m")
    group.add_argument("--focus-at", metavar="X,Y", help="focus on the surface under a pixel instead")
    group.add_argument("--fstop", type=float, default=2.8, help="f-number (default: %(default)s)")
    group.add_argument("--focal", default="50mm", help="focal length (default: %(default)s)")
    group.add_argument("--sensor", default="36mm", help="sensor width (default: %(default)s)")
    group.add_argument(
        "--shutter", type=float, default=0.5, help="share of the frame it is open, 0.5 is 180° (default: %(default)s)"
    )
    group.add_argument(
        "--aperture", default="disc", help="disc, triangle … octagon, or a PNG of its shape (default: %(default)s)"
    )
    group.add_argument("--blades", type=int, help="number of blades of a polygon")
    group.add_argument("--blade-angle", type=float, default=0.0, help="its rotation, degrees (default: %(default)s)")
    group.add_argument(
        "--cats-eye", type=float, default=0.0, metavar="S", help="vignetting of the corners' bokeh, 0 to 1.8"
    )
    group.add_argument("--scene-unit", default="1m", help="length of one unit of depth (default: %(default)s)")


def _quality(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--layers", type=int, default=2, help="depth layers; 4 for complex depth (default: %(default)s)")
    group.add_argument("--preset", default="default", help="default, best or paper (default: %(default)s)")
    group.add_argument("--edges", default="extend", help="extend, renormalise or dark (default: %(default)s)")
    group.add_argument("--overscan", type=int, default=0, metavar="PX", help="crop this band from the blurred frame")
    group.add_argument("--solver", default="", help="dst, fft, 7/5 or 5/3 (default: the preset's)")
    group.add_argument("--choice", default="auto", help="auto, stochastic or nearest node (default: %(default)s)")
    group.add_argument("--largest", type=float, help="cut blur to this radius, pixels; with bake: largest baked")
    group.add_argument("--deterministic", action="store_true", help="add in integers: the same bytes on every machine")


def _channels(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--view", help="view of a stereo file (default: its first)")
    group.add_argument("--depth-channel", metavar="NAME", help="channel of depth, for example ViewLayer.Depth.Z")
    group.add_argument("--depth-file", metavar="FILE", help="depth from another file: .exr, or .png with --depth-range")
    group.add_argument("--depth-range", metavar="NEAR,FAR", help="depths that black and white mean in a PNG")
    group.add_argument(
        "--depth", dest="depth_kind", default="auto", help="planar, ray, ray-from-near or inverse (default: by name)"
    )
    group.add_argument("--near", type=float, default=0.01, help="near plane for ray-from-near (default: %(default)s)")
    group.add_argument("--motion-channels", metavar="X,Y", help="two channels of motion, joined by a comma")
    group.add_argument(
        "--motion", dest="motion_kind", default=None, help="auto, none, or words of: pixels ndc uv backward y-up"
    )
    group.add_argument("--frames", metavar="A-B", help="frames of a sequence; #### stands for the number")


def _library(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--family", default="depth", help="depth, depth-speed, shaped-speed or cats-eye")
    group.add_argument(
        "--longest", type=float, default=64.0, help="longest motion baked, pixels (default: %(default)s)"
    )
    group.add_argument("--noise", type=float, help="noise that the radius axis allows in flat areas (default: 0.0025)")
    group.add_argument("--node", type=int, help="check one node only")
    group.add_argument("--plot", metavar="PNG", help="picture of kernel, points, reconstruction and difference")
    group.add_argument("--limit-error", type=float, default=0.2, help="relative L2 allowed (default: %(default)s)")
    group.add_argument("--limit-leak", type=float, default=0.05, help="leak allowed (default: %(default)s)")
    group.add_argument("--two-arrays", metavar="FOLDER", help="also write the published layout as two .npy files")
