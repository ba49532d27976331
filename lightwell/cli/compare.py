"""The verb ``compare``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from lightwell.baking.settings import Compared
from lightwell.cli.arguments import add_json, add_options, given_options

DESCRIPTION = """\
lightwell compare OUT OUT …                      reports of bakes side by side
lightwell compare --fields A,B,… SCENE -o OUT    train each field on the same samples and write
  OUT/compare.html   table, charts and pictures of all fields
  OUT/compare.json   the same as numbers
  OUT/FIELD/         scene.glb, page and report of each field, as bake writes them
Ctrl-C keeps what is done; --resume goes on."""
# Options of a bake without meaning here: each field has its own preset, and only the variable light is compared.
WITHOUT = ("preset", "static", "lamps")


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    parser.add_argument("targets", metavar="OUT|SCENE", nargs="+", help="folders written by bake, or one scene")
    parser.add_argument(
        "--fields", metavar="FIELD[:PRESET],…", help="fields to train, for example mlp,mlp:report-20,factored"
    )
    parser.add_argument("-o", "--out", help="folder to write")
    add_options(parser, Compared, without=WITHOUT)
    add_json(parser, "print the rows or compare.json, no progress bars")


def run(arguments: argparse.Namespace) -> int:
    """Train and compare fields, or print a table of reports.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.

    Raises:
        ValueError: Options of ``--fields`` were given without it.
    """
    if arguments.fields is not None:
        return _compare_fields(arguments)
    from lightwell.baking.side_by_side import comparison, table

    given = given_options(arguments, Compared, "compare")
    if arguments.out or given:
        name = "-o" if arguments.out else "--" + next(iter(given)).replace("_", "-")
        raise ValueError(
            f"compare: {name} needs --fields; name the fields to train, for example --fields mlp,mlp:report-20"
        )
    rows = comparison([Path(out) for out in arguments.targets])
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))
    return 0


def _compare_fields(arguments: argparse.Namespace) -> int:
    if len(arguments.targets) != 1:
        raise ValueError(f"compare: --fields wants one scene, not {len(arguments.targets)}; name it once")
    if not arguments.out:
        raise ValueError("compare: --fields wants a folder to write; name it with -o")
    from lightwell.baking.comparison import CompareSettings, compare_fields, parse_fields, table
    from lightwell.core.progress import Progress

    settings = CompareSettings(
        arguments.targets[0],
        Path(arguments.out),
        parse_fields(arguments.fields),
        **given_options(arguments, Compared, "compare"),
    )
    numbers = compare_fields(settings, Progress(quiet=arguments.json))
    print(json.dumps(numbers, indent=1) if arguments.json else table(numbers["fields"]))
    return 0
