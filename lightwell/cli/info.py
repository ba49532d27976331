"""The verb ``info``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

from lightwell.cli.arguments import add_json, add_options, given_options
from lightwell.core.scene_options import SceneOptions


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    parser.add_argument("path", metavar="ASSET|SCENE", help="OUT, OUT/scene.glb, or any scene")
    add_options(parser, SceneOptions)
    add_json(parser, "print the facts as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Print the facts.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    from lightwell.baking.information import describe

    options = SceneOptions(**given_options(arguments, SceneOptions, "info"))
    facts = describe(arguments.path, **options.loading)
    if arguments.json:
        print(json.dumps(facts, indent=1))
    else:
        for key, value in facts.items():
            print(f"{key:<14} {value}")
    return 0
