"""The verb ``samples``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from lightwell.baking.sample_file import SampleSettings
from lightwell.cli.arguments import add_json, add_options, add_scene, given_options

DESCRIPTION = """\
Path-trace samples of a scene's indirect light into an .npz of plain arrays: surface points with views, the light's
place, and the radiance that leaves them as two independent means. docs/python.md describes each column."""


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    add_scene(parser)
    parser.add_argument("-o", "--out", required=True, help="file to write, .npz")
    add_options(parser, SampleSettings)
    add_json(parser, "print what was written as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Trace and write the samples.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    given = given_options(arguments, SampleSettings, "samples")
    settings = SampleSettings(arguments.scene, Path(arguments.out), **given)
    from lightwell.baking.sample_file import write_samples

    facts = write_samples(settings)
    print(json.dumps(facts, indent=1) if arguments.json else f"{facts['file']}: {facts['samples']} samples")
    return 0
