"""The verb ``validate``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

from lightwell.cli.arguments import add_json, add_options, given_options
from lightwell.core.scene_options import LimitOptions


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    parser.add_argument("path", metavar="OUT", help="a folder written by bake, or a .glb")
    add_options(parser, LimitOptions)
    add_json(parser, "print the violations as JSON: path, valid, problems, notes")


def run(arguments: argparse.Namespace) -> int:
    """Print violations of the specification.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code: 0, or 1 where there is a violation.
    """
    from lightwell.asset.validate import validate_file, web_notes

    options = given_options(arguments, LimitOptions, "validate")
    problems = validate_file(arguments.path, **options)
    notes = [] if problems else web_notes(arguments.path, **options)
    if arguments.json:
        found = {"path": arguments.path, "valid": not problems, "problems": problems, "notes": notes}
        print(json.dumps(found, indent=1))
    else:
        print("\n".join(problems) or f"{arguments.path}: follows the specification")
        for note in notes:
            print(f"note: {note}")
    return 1 if problems else 0
