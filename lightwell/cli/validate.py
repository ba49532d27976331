"""The verb ``validate``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from lightwell.cli.arguments import add_options, given_options
from lightwell.core.scene_options import LimitOptions


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments."""
    parser.add_argument("path", metavar="OUT", help="a folder written by bake, or a .glb")
    add_options(parser, LimitOptions)


def run(arguments: argparse.Namespace) -> int:
    """Print what does not follow the specification; 1 if there is anything."""
    from lightwell.asset.validate import validate_file

    problems = validate_file(arguments.path, **given_options(arguments, LimitOptions, "validate"))
    print("\n".join(problems) or f"{arguments.path}: follows the specification")
    return 1 if problems else 0
