"""The verb ``render``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lightwell.cli.arguments import add_json, add_options, add_scene, given_options
from lightwell.rendering.settings import INTEGRATORS, RenderSettings, check_picture


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    add_scene(parser)
    parser.add_argument("-o", "--out", required=True, help="picture to write: .png (tone-mapped) or .exr (linear)")
    add_options(parser, RenderSettings)
    for name, kind in INTEGRATORS.items():
        add_options(parser.add_argument_group(f"options of --integrator {name}"), kind)
    add_json(parser, "print what was rendered as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Render, and print facts about the picture.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    options: dict[str, Any] = {}
    for kind in INTEGRATORS.values():
        options |= given_options(arguments, kind, "render")
    given = given_options(arguments, RenderSettings, "render")
    settings = RenderSettings(scene=arguments.scene, out=Path(arguments.out), options=options, **given)
    if getattr(settings.options, "frames", None) is None:
        check_picture(settings.out)
    from lightwell.rendering.integrators import render

    facts = render(settings, quiet=arguments.json)
    width, height = settings.size
    print(
        json.dumps(facts, indent=1)
        if arguments.json
        else f"{arguments.out}: {width}x{height}, {facts['seconds']:.1f} s"
    )
    return 0
