"""``--limit``, ``--scene-unit`` and ``--allow-path``, options of verbs that read files. Cheap to import."""

from __future__ import annotations

import argparse
import math
from typing import Any

from lightwell.limits import NAMES, Limits

# Metres per unit of length.
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}


def add_limit(parser: argparse.ArgumentParser) -> None:
    """Add ``--limit``; ``limits`` reads it."""
    parser.add_argument(
        "--limit",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help=f"what a file may ask for, such as vertices=5e7 (repeatable): {', '.join(NAMES)}",
    )


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add the options of verbs that load a scene; ``scene_options`` reads them."""
    add_limit(parser)
    parser.add_argument(
        "--scene-unit",
        default="m",
        metavar="UNIT",
        help=f"length of one unit in a glTF scene: {', '.join(UNITS)}, or a number of metres (default: %(default)s)",
    )
    parser.add_argument(
        "--allow-path",
        action="append",
        default=[],
        metavar="DIR",
        help="a folder beside the scene's own whose files a Mitsuba scene may name (repeatable)",
    )


def allow_paths(arguments: argparse.Namespace) -> tuple[str, ...]:
    """The folders that ``--allow-path`` names."""
    return tuple(arguments.allow_path)


def limits(arguments: argparse.Namespace) -> Limits:
    """The limits that the options say."""
    return Limits.parse(arguments.limit)


def scene_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Arguments ``limits``, ``unit`` and ``allow_paths`` of ``lightwell.scenes.load``."""
    return {
        "limits": limits(arguments),
        "unit": metres_per_unit(arguments.scene_unit),
        "allow_paths": allow_paths(arguments),
    }


def metres_per_unit(text: str) -> float:
    """Metres in ``mm``, ``cm``, … or a plain number; ValueError for anything else."""
    try:
        unit = UNITS[text] if text in UNITS else float(text)
    except ValueError:
        unit = math.nan
    if not 0 < unit < math.inf:
        raise ValueError(
            f"--scene-unit '{text[:40]}' is not a length; write one of {', '.join(UNITS)} or a number of metres"
        )
    return unit
