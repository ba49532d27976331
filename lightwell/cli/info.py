"""The verb ``info``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from typing import Any

from lightwell.cli.arguments import add_json, add_options, given_options
from lightwell.core.scene_options import SceneOptions
from lightwell.core.units import size_text


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
        for line in table(facts):
            print(line)
    return 0


def table(facts: Mapping[str, Any]) -> list[str]:
    """Lay facts out for people: names on the left; lists of records as tables; sizes and lengths with units.

    Args:
        facts: JSON values by name.

    Returns:
        Lines of text.
    """
    lines = []
    for name, value in facts.items():
        title = name.replace("_", " ")
        if isinstance(value, list) and value and isinstance(value[0], Mapping):
            lines += ["", title, *_records(value)]
        elif isinstance(value, list) and name != "bounds":
            lines += [f"{title:<18}{value[0] if len(value) == 1 else len(value)}"]
            lines += [f"  {entry}" for entry in value] if len(value) > 1 else []
        else:
            lines.append(f"{title:<18}{_text(name, value)}")
    return lines


def _records(rows: list[Mapping[str, Any]]) -> list[str]:
    names = list(dict.fromkeys(name for row in rows for name in row))
    cells = [
        [name.replace("_", " ") for name in names],
        *([_text(name, row.get(name, "")) for name in names] for row in rows),
    ]
    widths = [max(len(row[k]) for row in cells) for k in range(len(names))]
    return ["  " + "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths)).rstrip() for row in cells]


def _text(name: str, value: Any) -> str:
    if name == "bounds":
        low, high = value
        size = " x ".join(f"{b - a:.4g}" for a, b in zip(low, high))
        return f"{size} m, from {_number(low)} to {_number(high)}"
    if name.endswith("bytes"):
        return size_text(value)
    return _number(value)


def _number(value: Any) -> str:
    """Four digits of what is measured; what is counted as it is."""
    if isinstance(value, (list, tuple)):
        return "(" + ", ".join(map(_number, value)) + ")"
    if isinstance(value, float):
        return f"{value:.4g}"
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)
