"""The verb ``live``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from lightwell.cli.arguments import add_options, add_scene, given_options
from lightwell.cli.interrupts import INTERRUPTED
from lightwell.core.scene_options import SceneOptions
from lightwell.rendering.settings import NrcOptions

SMALLEST, LARGEST = 16, 2048


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    add_scene(parser)
    parser.add_argument("--size", type=int, default=256, help="edge of the square pictures, pixels (default: 256)")
    parser.add_argument("--port", type=int, default=0, help="port on 127.0.0.1 (default: any free one)")
    parser.add_argument("--no-open", action="store_true", help="only serve")
    add_options(parser, NrcOptions, without=("frames", "format", "resume", "force"))
    add_options(parser, SceneOptions)


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until interrupted.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.

    Raises:
        ValueError: The size is out of range.
    """
    if not SMALLEST <= arguments.size <= LARGEST:
        raise ValueError(f"live: --size {arguments.size}, expected {SMALLEST} ... {LARGEST} pixels")
    from lightwell.cache.live_server import live
    from lightwell.cache.settings import parse_options

    scene = SceneOptions(**given_options(arguments, SceneOptions, "live"))
    cache = parse_options(getattr(arguments, "nrc", ()))
    try:
        live(arguments.scene, cache, arguments.size, arguments.port, not arguments.no_open, **scene.loading)
    except KeyboardInterrupt:
        # Kernels may be running or be compiled in other threads; Python's orderly end would crash in them.
        sys.stdout.flush()
        os._exit(INTERRUPTED)
    return 0
