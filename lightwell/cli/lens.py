"""The verb ``lens``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from lightwell.cli.arguments import add_options
from lightwell.core.scene_options import LimitOptions
from lightwell.lens import arguments as lens

DESCRIPTION = lens.DESCRIPTION
# Words after the verb that have options of their own.
TOOLS = tuple(lens.TOOLS)


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb; 'bake' or 'check' among them means a tool for libraries.
    """
    tool = next((word for word in argv if word in TOOLS), "")
    lens.add(parser, tool)
    if tool != "bake":  # It reads no file that could ask for anything.
        add_options(parser, LimitOptions)


def run(arguments: argparse.Namespace) -> int:
    """Blur, bake or check.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    from lightwell.lens.command import run as run_lens

    return run_lens(arguments)
