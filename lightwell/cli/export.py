"""The verb ``export``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from lightwell.cli.arguments import add_options, given_options
from lightwell.core.scene_options import LimitOptions
from lightwell.core.units import size_text

LANGUAGES = (
    "glsl, wgsl, shadertoy or hlsl; msl (checked by clang, never compiled by Apple's compiler) or gdshader (checked "
    "against Godot's grammar, never compiled by Godot)"
)


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    parser.add_argument("path", metavar="OUT", help="a folder written by bake, or a .glb")
    parser.add_argument("--to", required=True, metavar="LANGUAGE", help=LANGUAGES)
    parser.add_argument("-o", "--out", help="file to write, and what it binds beside it (default: beside the asset)")
    parser.add_argument("--field", default="", help="name of the field (default: the first)")
    parser.add_argument("--name", default="lightwell", help="name of the function (default: %(default)s)")
    parser.add_argument(
        "--weights", default="", help="inline (literals) or table (default: by the size of the network)"
    )
    add_options(parser, LimitOptions)


def run(arguments: argparse.Namespace) -> int:
    """Write the shader, and print the names of the files.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    from lightwell.asset.export import ENDINGS, export_field, write_export

    path = Path(arguments.path)
    names = {"field": arguments.field, "name": arguments.name, "weights": arguments.weights}
    exported = export_field(path, arguments.to, **names, **given_options(arguments, LimitOptions, "export"))
    folder = path if path.is_dir() else path.parent
    out = Path(arguments.out) if arguments.out else folder / f"{arguments.name}{ENDINGS[arguments.to]}"
    for written in write_export(out, exported):
        print(f"{written}: {size_text(written.stat().st_size)}")
    return 0
