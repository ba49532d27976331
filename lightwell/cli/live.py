"""The verb ``live``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from lightwell.cli.arguments import add_options, add_scene, given_options
from lightwell.cli.interrupts import INTERRUPTED
from lightwell.core.options import flag_of, options_of
from lightwell.core.scene_options import SceneOptions
from lightwell.rendering.settings import NrcOptions

if TYPE_CHECKING:
    from lightwell.cache.settings import CacheSettings

SMALLEST, LARGEST, SIZE = 16, 2048, 512
# Options that a baked field has no use for.
OF_CACHE = ("size", "nrc", "cache_from")
# Groups of options of the cache that are for pictures of `lightwell render`: the page has samples of its own.
OF_PICTURES = ("estimation", "guiding", "image")
# The same of single options.
OF_STILLS = ("still_unbiased",)
# Options of a bake that the page chooses, and those for somebody who looks at the bake itself.
CHOSEN = (
    "out", "quality", "edits", "config", "json", "log", "resume", "preview", "watch", "port", "no_open",
)  # fmt: skip


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    add_scene(parser)
    parser.add_argument("--size", type=int, help=f"edge of the square picture, pixels (default: {SIZE})")
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
        ValueError: The size is out of range, or an option would be ignored.
    """
    if arguments.field:
        return _bake(arguments)
    size = SIZE if arguments.size is None else arguments.size
    if not SMALLEST <= size <= LARGEST:
        raise ValueError(f"live: --size {size}, expected {SMALLEST} ... {LARGEST} pixels")
    from lightwell.cache.live_bake import ChildBake
    from lightwell.cache.live_server import live
    from lightwell.cache.settings import parse_options

    scene = SceneOptions(**given_options(arguments, SceneOptions, "live"))
    cache = parse_options(getattr(arguments, "nrc", ()))
    check_cache(cache)
    start = NrcOptions(cache_from=getattr(arguments, "cache_from", None)).cache_from
    baker = partial(ChildBake.start, arguments.scene, Path(arguments.out), bake_words(arguments))
    shown = (size, arguments.port, not arguments.no_open)
    try:
        live(arguments.scene, cache, *shown, start, baker, **scene.loading)
    except KeyboardInterrupt:
        # Kernels may be running or be compiled in other threads; Python's orderly end would crash in them.
        sys.stdout.flush()
        os._exit(INTERRUPTED)
    return 0


def check_cache(cache: CacheSettings) -> None:
    """Refuse options of the radiance cache that the page would ignore.

    Args:
        cache: Settings of the cache.

    Raises:
        ValueError: Nothing is learned, or an option is for pictures of ``lightwell render``.
    """
    from lightwell.cache.settings import OPTIONS

    if not cache.caching:
        raise ValueError(
            "live: with estimator=guided or termination_c=inf no cache is learned; leave them out, "
            "'Path tracing' on the page shows paths of any length"
        )
    for name, (group, field, _) in OPTIONS.items():
        if (group in OF_PICTURES or name in OF_STILLS) and getattr(getattr(cache, group), name) != field.default:
            raise ValueError(f"live: --nrc {name}=… is for 'lightwell render', the page ignores it; leave it out")


def bake_words(arguments: argparse.Namespace) -> list[str]:
    """Write the options of the bakes that the page starts: those of the scene, and of ``[bake]`` in the settings file.

    Args:
        arguments: Parsed arguments.

    Returns:
        Words; without options that would make the bake wait, as ``watch`` does.

    Raises:
        ValueError: The settings file holds an unknown option; one line.
    """
    from lightwell.cli.configuration import FILE, NO_FILE, option_words, read_configuration
    from lightwell.cli.main import verb_parser

    words: list[str] = []
    of_scene, asked = options_of(SceneOptions), arguments.config or FILE
    for name, (_, known) in of_scene.items():
        given = getattr(arguments, name, ())
        for value in given if isinstance(given, (list, tuple)) else [given]:
            words += [flag_of(name, known), str(value)]
    if asked != NO_FILE and Path(asked).is_file():
        path, left_out = Path(asked), {*CHOSEN, *(name for name in of_scene if hasattr(arguments, name))}
        options = read_configuration(path).options("bake", arguments.scene, verb_parser)
        words += option_words("bake", options, left_out, path, verb_parser)
    return [*words, f"--config={NO_FILE}"]


def _bake(arguments: argparse.Namespace) -> int:
    """Bake a field with the page of ``bake --preview``."""
    from lightwell.cli import bake
    from lightwell.cli.previewed import bake_with_page

    for name in OF_CACHE:
        if getattr(arguments, name, None) is not None:
            raise ValueError(f"live: --{name.replace('_', '-')} is of the radiance cache; leave it out, or --field")
    names = ("verb", "started", "scene", "out", "field", "port", "no_open", *options_of(SceneOptions))
    kept = {name: getattr(arguments, name) for name in names if hasattr(arguments, name)}
    told = argparse.Namespace(json=False, **kept)
    return bake_with_page(told, bake.settings(told))
