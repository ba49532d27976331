"""The verb ``live``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from lightwell.cli.arguments import add_options, add_scene, given_options
from lightwell.cli.interrupts import INTERRUPTED
from lightwell.core.options import flag_of, options_of
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
    parser.add_argument(
        "--size", type=int, default=512, help="edge of the square picture, pixels (default: %(default)s)"
    )
    parser.add_argument("--port", type=int, default=0, help="port on 127.0.0.1 (default: any free one)")
    parser.add_argument("--no-open", action="store_true", help="only serve")
    parser.add_argument("--field", help="show this learned representation while it is baked, not the radiance cache")
    parser.add_argument(
        "-o", "--out", default="live", help="folder that bakes of the page write (default: %(default)s)"
    )
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
    if arguments.field:
        return _bake(arguments)
    if not SMALLEST <= arguments.size <= LARGEST:
        raise ValueError(f"live: --size {arguments.size}, expected {SMALLEST} ... {LARGEST} pixels")
    from lightwell.cache.live_bake import ChildBake
    from lightwell.cache.live_server import live
    from lightwell.cache.settings import parse_options

    scene = SceneOptions(**given_options(arguments, SceneOptions, "live"))
    cache = parse_options(getattr(arguments, "nrc", ()))
    start = NrcOptions(cache_from=getattr(arguments, "cache_from", None)).cache_from
    baker = partial(ChildBake.start, arguments.scene, Path(arguments.out), _scene_words(arguments))
    shown = (arguments.size, arguments.port, not arguments.no_open)
    try:
        live(arguments.scene, cache, *shown, start, baker, **scene.loading)
    except KeyboardInterrupt:
        # Kernels may be running or be compiled in other threads; Python's orderly end would crash in them.
        sys.stdout.flush()
        os._exit(INTERRUPTED)
    return 0


def _scene_words(arguments: argparse.Namespace) -> list[str]:
    """Options of the scene as they were given."""
    words = []
    for name, (_, known) in options_of(SceneOptions).items():
        given = getattr(arguments, name, ())
        for value in given if isinstance(given, (list, tuple)) else [given]:
            words += [flag_of(name, known), str(value)]
    return words


def _bake(arguments: argparse.Namespace) -> int:
    """Bake a field with the page of ``bake --preview``."""
    from lightwell.cli import bake
    from lightwell.cli.previewed import bake_with_page

    names = ("verb", "started", "scene", "out", "field", "port", "no_open", *options_of(SceneOptions))
    kept = {name: getattr(arguments, name) for name in names if hasattr(arguments, name)}
    told = argparse.Namespace(json=False, **kept)
    return bake_with_page(told, bake.settings(told))
