"""The verb ``view``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    parser.add_argument("out", metavar="OUT", help="a folder written by bake")
    parser.add_argument("--port", type=int, default=0, help="port on 127.0.0.1 (default: any free one)")
    parser.add_argument("--no-open", action="store_true", help="only serve")


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until interrupted.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    from lightwell.serving.folder import view

    view(arguments.out, arguments.port, not arguments.no_open)
    return 0
