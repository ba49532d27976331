"""Arguments of the radiance cache's verbs. Outside its room, because entering that starts Mitsuba; help is instant."""

from __future__ import annotations

import argparse

from lightwell import limit_arguments

LIVE_SUMMARY = "a page in which the radiance cache learns while you move camera and lights"


def add_render(parser: argparse.ArgumentParser) -> None:
    """Options of ``render --integrator nrc``."""
    parser.add_argument(
        "--integrator", choices=("path", "nrc"), default="path", help="nrc: the radiance cache (the scene's own light)"
    )
    _add_options(parser)
    parser.add_argument("--frames", type=int, help="nrc: an orbit of so many frames; OUT is then a folder")
    parser.add_argument("--format", choices=("exr", "png"), default="exr", help="nrc: format of the frames")
    parser.add_argument("--resume", action="store_true", help="nrc: keep the frames that are there")
    parser.add_argument(
        "--force", action="store_true", help="nrc: overwrite frames in OUT that lightwell did not write"
    )


def add_live(parser: argparse.ArgumentParser) -> None:
    """Options of ``live``."""
    parser.add_argument("scene", metavar="SCENE", help="a .glb, .gltf or Mitsuba .xml, or a built-in name")
    parser.add_argument("--size", type=int, default=256, help="edge of the square pictures, pixels (default: 256)")
    parser.add_argument("--port", type=int, default=0, help="port on 127.0.0.1 (default: any free one)")
    parser.add_argument("--no-open", action="store_true", help="only serve")
    _add_options(parser)
    limit_arguments.add_scene(parser)


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--nrc",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="an option of the radiance cache, such as seconds=10, preset=paper, estimator=residual, view=cache",
    )
