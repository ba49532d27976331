"""Arguments of the verb ``lens``. This module imports nothing slow, so that ``--help`` answers at once."""

from __future__ import annotations

import argparse

DESCRIPTION = """\
lightwell lens FRAME.exr -o OUT.exr --focus 2.5m --fstop 1.8 --focal 50mm     one frame
lightwell lens 'shot.####.exr' --frames 1-48 -o 'out.####.exr' …              a sequence
lightwell lens FRAME.png --depth-file DEPTH.png --depth-range 1,20 -o OUT.png …

FRAME holds colour, depth along the camera axis and, for motion blur, vectors in pixels per frame. The names that
Blender, Mitsuba and Nuke give these channels are known; the options say what the file does not.

Libraries of spreadlets are baked by themselves when a frame needs them. To bake or check one by hand:
  lightwell lens bake --help
  lightwell lens check --help"""
# The tools for libraries, which are words after the verb, and what each does.
TOOLS = {
    "bake": "Bake a library of spreadlets with all its nodes into a file.",
    "check": "Integrate a library of spreadlets back, and print its errors; exit code 1 when a limit is broken.",
}

# Distance of the near plane where a file's depth begins there and none is given, scene units: Mitsuba's default.
NEAR = 0.01


def add(parser: argparse.ArgumentParser, tool: str = "") -> None:
    """Add the options of the verb, or those of one of its tools.

    Args:
        parser: Parser to extend.
        tool: 'bake' or 'check'; '': the options for frames.
    """
    if tool:
        parser.prog = f"{parser.prog} {tool}"
        parser.description = TOOLS[tool]
        parser.usage = f"{parser.prog} LIBRARY [options]"
        parser.add_argument("frame", choices=(tool,), help=argparse.SUPPRESS)
        parser.add_argument("library", metavar="LIBRARY", help=f"library to {_DONE[tool]}: a .lwsp file")
        _TOOL_OPTIONS[tool](parser)
        parser.add_argument("--json", action="store_true", help="print what was found as JSON, no progress bars")
        return
    parser.add_argument("frame", metavar="FRAME", help="picture to blur: .exr or .png; #### for sequences")
    parser.add_argument("-o", "--out", help="picture to write: .exr (linear) or .png (sRGB)")
    camera = parser.add_argument_group("camera")
    _camera(camera)
    _aperture(camera)
    quality = parser.add_argument_group("quality")
    _quality(quality)
    _preset(quality)
    _channels(parser.add_argument_group("what the file means"))
    parser.add_argument(
        "--store", metavar="DIR", help="folder of the store (default: LIGHTWELL_STORE, else the platform's for caches)"
    )
    parser.add_argument("--json", action="store_true", help="print what was done as JSON, no progress bars")


def _camera(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--focus", metavar="LENGTH", help="distance in focus, for example 2.5m")
    group.add_argument("--focus-at", metavar="X,Y", help="focus on the surface under a pixel instead")
    group.add_argument("--fstop", metavar="N", type=float, default=2.8, help="f-number (default: %(default)s)")
    group.add_argument("--focal", metavar="LENGTH", default="50mm", help="focal length (default: %(default)s)")
    group.add_argument("--sensor", metavar="LENGTH", default="36mm", help="sensor width (default: %(default)s)")
    group.add_argument(
        "--shutter",
        metavar="S",
        type=float,
        default=0.5,
        help="share of the frame it is open, 0.5 is 180° (default: %(default)s)",
    )
    group.add_argument(
        "--scene-unit", metavar="LENGTH", default="1m", help="length of one unit of depth (default: %(default)s)"
    )


def _aperture(group: argparse._ActionsContainer, cats_eye: float | None = 0.0, without: str = "0") -> None:
    group.add_argument(
        "--aperture",
        metavar="SHAPE",
        default="disc",
        help="disc, triangle … octagon, or a PNG of its shape (default: %(default)s)",
    )
    group.add_argument("--blades", metavar="N", type=int, help="number of blades of a polygon")
    group.add_argument(
        "--blade-angle",
        metavar="DEGREES",
        type=float,
        default=0.0,
        help="rotation of the polygon, degrees (default: %(default)s)",
    )
    group.add_argument(
        "--cats-eye",
        type=float,
        default=cats_eye,
        metavar="S",
        help=f"vignetting of the corners' bokeh, 0 or more, below 1.8 (default: {without})",
    )


def _preset(group: argparse._ActionsContainer) -> None:
    group.add_argument(
        "--preset", metavar="NAME", default="default", help="default, best or paper (default: %(default)s)"
    )


def _quality(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--prescription", metavar="FILE", help="bokeh of a real lens: a text file of its surfaces; without motion"
    )
    group.add_argument(
        "--layers", metavar="N", type=int, default=2, help="depth layers; 4 for complex depth (default: %(default)s)"
    )
    group.add_argument(
        "--antialiased", action="store_true", help="divide the light of pixels at depth edges between both sides"
    )
    group.add_argument(
        "--edges", metavar="KIND", default="extend", help="extend, renormalise or dark (default: %(default)s)"
    )
    group.add_argument(
        "--overscan", type=int, default=0, metavar="PX", help="crop this band afterwards; --sensor is of the rest"
    )
    group.add_argument("--solver", metavar="NAME", default="", help="dst, fft, 7/5 or 5/3 (default: the preset's)")
    group.add_argument(
        "--choice", metavar="NAME", default="auto", help="auto, stochastic or nearest node (default: %(default)s)"
    )
    group.add_argument("--largest", metavar="PX", type=float, help="cut blur to this radius, pixels")
    group.add_argument("--deterministic", action="store_true", help="add in integers: the same bytes on every machine")


def _channels(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--view", help="view of a stereo file, also of --depth-file (default: its first)")
    group.add_argument("--depth-channel", metavar="NAME", help="channel of depth, for example ViewLayer.Depth.Z")
    group.add_argument(
        "--depth-file", metavar="FILE", help="depth from another file: .exr, .png with --depth-range (#### as in FRAME)"
    )
    group.add_argument("--depth-range", metavar="NEAR,FAR", help="depths that black and white mean in a PNG")
    group.add_argument(
        "--depth", dest="depth_kind", default="auto", help="planar, ray, ray-from-near or inverse (default: by name)"
    )
    group.add_argument("--near", type=float, help=f"near plane for ray-from-near, scene units (default: {NEAR})")
    group.add_argument("--motion-channels", metavar="X,Y", help="two channels of motion, joined by a comma")
    group.add_argument(
        "--motion", dest="motion_kind", default=None, help="auto, none, or words of: pixels ndc uv backward y-up"
    )
    group.add_argument("--frames", metavar="A-B", help="frames of a sequence; #### stands for the number")


def _bake(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--family", metavar="NAME", default="depth", help="depth, depth-speed, shaped-speed or cats-eye"
    )
    parser.add_argument("--largest", metavar="PX", type=float, help="largest blur radius baked, pixels (default: 32)")
    parser.add_argument(
        "--longest",
        metavar="PX",
        type=float,
        help="longest motion baked, pixels, of the families with speed (default: 64)",
    )
    parser.add_argument(
        "--noise",
        metavar="N",
        type=float,
        help="noise that the radius axis allows in flat areas: of the family depth (default: 0.0025), of others 0.03",
    )
    _aperture(parser, cats_eye=None, without="1, of the family cats-eye")
    _preset(parser)
    parser.add_argument("--two-arrays", metavar="FOLDER", help="also write the published layout as two .npy files")


def _check(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--node", metavar="N", type=int, help="check one node only")
    parser.add_argument("--plot", metavar="PNG", help="picture of kernel, points, reconstruction and difference")
    parser.add_argument(
        "--limit-error", metavar="N", type=float, default=0.2, help="relative L2 allowed (default: %(default)s)"
    )
    parser.add_argument(
        "--limit-leak", metavar="N", type=float, default=0.05, help="leak allowed (default: %(default)s)"
    )
    parser.add_argument(
        "--aperture", metavar="PNG", default="disc", help="shape of the aperture that the library was baked for"
    )


_TOOL_OPTIONS = {"bake": _bake, "check": _check}
# What happens to the library, for its help.
_DONE = {"bake": "write", "check": "check"}
