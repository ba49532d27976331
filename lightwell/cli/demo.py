"""The verb ``demo``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from lightwell.cli import bake
from lightwell.cli.run_bake import run_bake
from lightwell.fields.budget import Budget

# Wall seconds of the demo: less than three minutes also where a plan turns out a little long.
BUDGET, VIEWS = Budget(164.0), 3


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    parser.add_argument(
        "scene",
        nargs="?",
        default="courtyard",
        help="cornell, courtyard, courtyard-day, doorway, loft or two-rooms (default: %(default)s)",
    )
    parser.add_argument("-o", "--out", default="demo", help="folder to write (default: %(default)s)")
    parser.add_argument("--no-open", action="store_true", help="do not serve or open the page afterwards")
    bake.add_bake_options(parser, argv)


def run(arguments: argparse.Namespace) -> int:
    """Bake, then serve the page if the output is a terminal.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    # A quality that was asked for has a time of its own.
    defaults = {"views": VIEWS} if hasattr(arguments, "quality") else {"views": VIEWS, "budget": BUDGET}
    code = run_bake(arguments, bake.settings(arguments, **defaults))
    if arguments.no_open or not sys.stdout.isatty():
        return code
    from lightwell.serving.folder import view

    view(arguments.out)
    return code
