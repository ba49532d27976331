"""The verb ``bake``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lightwell.baking.settings import BakeSettings
from lightwell.cli.arguments import add_json, add_options, add_scene, given_options
from lightwell.cli.run_bake import run_bake
from lightwell.core.options import options_of
from lightwell.fields.registry import BUILT_IN, DEFAULT, OPTIONS, PRESETS, options_type

if TYPE_CHECKING:
    pass

DESCRIPTION = """\
Path-trace a scene, fit a small network to its indirect light, and write
  OUT/scene.glb     an ordinary glTF that carries the learned light
  OUT/index.html    a page in which you orbit and move the light
  OUT/report.html   how far it is from the reference
  OUT/report.json   the same as numbers
Ctrl-C keeps a checkpoint; --resume goes on. --field NAME --help shows what that field takes.
--field factored+probes adds light probes to scene.glb, for what a page adds or moves."""


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    add_scene(parser)
    parser.add_argument("-o", "--out", required=True, help="folder to write")
    add_preview_options(parser)
    parser.add_argument(
        "--watch", action="store_true", help="bake again whenever the scene's file is saved, until Ctrl-C"
    )
    add_bake_options(parser, argv)


def add_preview_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--preview``, ``--port`` and ``--no-open``.

    Args:
        parser: Parser to add to.
    """
    group = parser.add_argument_group("looking while it learns")
    group.add_argument(
        "--preview", action="store_true", help="open a page that shows the light at once and while it is learned"
    )
    group.add_argument("--port", type=int, default=0, help="port of the page on 127.0.0.1 (default: any free one)")
    group.add_argument("--no-open", action="store_true", help="do not open the page in a browser")


def add_bake_options(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the options that ``bake`` and ``demo`` share besides scene and folder.

    Args:
        parser: Parser to add to.
        argv: Words after the verb; help shows the options of the field in them.
    """
    parser.add_argument(
        "--field",
        help=f"learned representation: {', '.join(BUILT_IN)}, or one that a plug-in adds "
        f"(default: {DEFAULT}, or the one that has the preset)",
    )
    add_options(parser, BakeSettings)
    add_json(parser, "print report.json to standard output, no progress bars")
    chosen = _chosen(argv)
    parser.epilog = _presets(chosen)
    known: set[str] = set()
    for field in dict.fromkeys([*([chosen] if chosen else []), *OPTIONS]):
        group = parser.add_argument_group(f"options of --field {field}")
        add_options(group, options_type(field), without=known, shown=chosen in (None, field))
        known |= set(options_of(options_type(field)))


def _presets(chosen: str | None) -> str:
    """List the presets of the chosen field, or of all of lightwell's."""
    shown = {name: presets for name, presets in PRESETS.items() if chosen in (None, name)}
    return "\n".join(["presets of each field:", *(f"  {name:<17}{', '.join(shown[name])}" for name in shown)])


def _chosen(argv: Sequence[str]) -> str | None:
    """Return the field that is named in the words, if any."""
    first = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    first.add_argument("--field", nargs="?")
    return first.parse_known_args(list(argv))[0].field


def settings(arguments: argparse.Namespace, **defaults: Any) -> BakeSettings:
    """Make the settings of a bake from parsed arguments.

    Args:
        arguments: Parsed arguments.
        **defaults: Values of options that were not given.

    Returns:
        The settings.
    """
    given = defaults | given_options(arguments, BakeSettings, "bake")
    options: dict[str, Any] = {}
    for field in dict.fromkeys([*([arguments.field] if arguments.field else []), *OPTIONS]):
        options |= given_options(arguments, options_type(field), "bake")
    field = arguments.field or ""
    return BakeSettings(arguments.scene, Path(arguments.out), field=field, options=options, **given)


def run(arguments: argparse.Namespace) -> int:
    """Bake.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.

    Raises:
        ValueError: ``--watch`` and ``--preview`` are both given.
    """
    if arguments.watch and arguments.preview:
        raise ValueError("bake: --watch and --preview do not go together; leave one of them out")
    if arguments.watch:
        from lightwell.cli.watched import bake_and_watch

        return bake_and_watch(arguments, settings(arguments))
    if arguments.preview:
        from lightwell.cli.previewed import bake_with_page

        return bake_with_page(arguments, settings(arguments))
    return run_bake(arguments, settings(arguments))
