"""The verb ``export``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from lightwell.cli.arguments import add_options, given_options
from lightwell.core.scene_options import LimitOptions
from lightwell.core.suggest import did_you_mean
from lightwell.core.units import size_text

TARGETS_HELP = (
    "a language: glsl, wgsl, shadertoy, hlsl; msl (checked by clang, never compiled by Apple's compiler) or gdshader "
    "(checked against Godot's grammar, never compiled by Godot). An engine: threejs, playcanvas, babylon; "
    "godot, unity, unreal, bevy (written from their documentation, never run in them)"
)


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    parser.add_argument("path", metavar="OUT", help="a folder written by bake, or a .glb")
    parser.add_argument("--to", required=True, metavar="TARGET", help=TARGETS_HELP)
    parser.add_argument("-o", "--out", help="file of a language, folder of an engine (default: beside the asset)")
    parser.add_argument("--field", default="", help="name of the field, or probes:NAME (default: the first field)")
    parser.add_argument("--name", default="lightwell", help="name of the function (default: %(default)s)")
    parser.add_argument(
        "--weights", default="", help="inline (literals) or table (default: by the size of the network)"
    )
    add_options(parser, LimitOptions)


def run(arguments: argparse.Namespace) -> int:
    """Write a shader or the files of an engine, and print their names.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    from lightwell.engines import ENGINES

    files = _engine(arguments) if arguments.to in ENGINES else _language(arguments)
    for written in files:
        print(f"{written}: {size_text(written.stat().st_size)}")
    return 0


def _language(arguments: argparse.Namespace) -> list[Path]:
    """Write one field as a shader."""
    from lightwell.asset.export import ENDINGS, TARGETS, export_field, write_export
    from lightwell.engines import ENGINES

    if arguments.to not in TARGETS:
        known = ", ".join([*TARGETS, *ENGINES])
        cure = did_you_mean(arguments.to, [*TARGETS, *ENGINES], "choose one of them")
        raise ValueError(f"export: expected --to {known}, found '{arguments.to}'; {cure}")
    path = Path(arguments.path)
    asset = path / "scene.glb" if path.is_dir() else path
    if arguments.out and Path(arguments.out).exists() and asset.exists() and Path(arguments.out).samefile(asset):
        raise ValueError(f"export: -o '{arguments.out}' is the asset itself, which would be lost; give another file")
    names = {"field": arguments.field, "name": arguments.name, "weights": arguments.weights}
    exported = export_field(path, arguments.to, **names, **given_options(arguments, LimitOptions, "export"))
    out = Path(arguments.out) if arguments.out else _beside(path) / f"{arguments.name}{ENDINGS[arguments.to]}"
    return write_export(out, exported)


def _engine(arguments: argparse.Namespace) -> list[Path]:
    """Write the files of an engine."""
    from lightwell.engines import export_engine

    for name, default in (("field", ""), ("name", "lightwell"), ("weights", "")):
        if getattr(arguments, name) != default:
            raise ValueError(f"export: --{name} is for languages; an engine is given all fields, so drop it")
    path = Path(arguments.path)
    out = Path(arguments.out) if arguments.out else _beside(path) / arguments.to
    return export_engine(path, arguments.to, out, **given_options(arguments, LimitOptions, "export"))


def _beside(path: Path) -> Path:
    return path if path.is_dir() else path.parent
