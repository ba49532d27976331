"""Command-line arguments, made from options that are declared once (``lightwell.core.options``)."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any

from lightwell.core.options import Option, flag_of, options_of, parsed
from lightwell.core.scene_options import BUILTINS, SCENE_SUFFIXES

# How plain numbers and words are read, by the type of an option as it is written.
_TYPES = {"int": int, "float": float, "str": str}


def add_options(
    parser: argparse._ActionsContainer, kind: type, without: Iterable[str] = (), shown: bool = True
) -> None:
    """Add the options of a dataclass.

    Args:
        parser: Parser or group.
        kind: The dataclass.
        without: Names of options that this command line does not have.
        shown: Whether help lists them.
    """
    groups: dict[str, argparse._ActionsContainer] = {"": parser}
    for name, (field, known) in options_of(kind).items():
        if name in without:
            continue
        if known.group not in groups:
            groups[known.group] = _group(parser, known.group)
        settings: dict[str, Any] = {"dest": name, "default": argparse.SUPPRESS}
        settings["help"] = known.help if shown else argparse.SUPPRESS
        if isinstance(field.default, bool):
            settings |= {"action": "store_const", "const": not field.default}
        else:
            settings |= _valued(str(field.type), known)
        groups[known.group].add_argument(flag_of(name, known), **settings)


def _group(parser: argparse._ActionsContainer, title: str) -> argparse._ArgumentGroup:
    """Return the group of a title; it is added where it is missing."""
    found = [group for group in parser._action_groups if group.title == title]
    return found[0] if found else parser.add_argument_group(title)


def _valued(kind: str, known: Option) -> dict[str, Any]:
    settings: dict[str, Any] = {"action": "append"} if known.repeat else {}
    if known.metavar:
        settings["metavar"] = known.metavar
    if isinstance(known.metavar, tuple):
        settings["nargs"] = len(known.metavar)
    if known.parse is None and not known.repeat:
        settings["type"] = _TYPES[kind.split("|")[0].strip()]
    if known.choices:
        settings["choices"] = known.choices
    return settings


def given_options(arguments: argparse.Namespace, kind: type, verb: str) -> dict[str, Any]:
    """Convert the options that were given on the command line; others are left out.

    A text that cannot be converted is a ``ValueError`` of one line that names the verb and the option.

    Args:
        arguments: Parsed arguments.
        kind: Dataclass of the options.
        verb: Verb of the command line.

    Returns:
        Values by name of the option.
    """
    given = {}
    for name, (_, known) in options_of(kind).items():
        if not hasattr(arguments, name):
            continue
        value = getattr(arguments, name)
        if known.parse is not None:
            value = parsed(verb, flag_of(name, known), value, known.parse)
        elif known.repeat:
            value = tuple(value)
        given[name] = value
    return given


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add the argument for the scene.

    Args:
        parser: Parser to add to.
    """
    parser.add_argument(
        "scene",
        metavar="SCENE",
        help=f"a {', '.join(SCENE_SUFFIXES)} file (.xml: Mitsuba), or {', '.join(BUILTINS)}",
    )


def add_json(parser: argparse.ArgumentParser, what: str) -> None:
    """Add ``--json``.

    Args:
        parser: Parser to add to.
        what: Help of the option.
    """
    parser.add_argument("--json", action="store_true", help=what)
