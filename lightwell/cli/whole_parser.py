"""The parser of the whole command line, with all verbs: for shell completion and the manual page."""

from __future__ import annotations

import argparse

from lightwell.cli.lens import TOOLS
from lightwell.cli.main import verb_parser
from lightwell.cli.verbs import VERBS


def whole_verbs() -> list[list[str]]:
    """List the verbs, and the tools of ``lens`` after it.

    Returns:
        The words before the arguments of each.
    """
    return [words for verb in VERBS for words in ([verb], *([verb, tool] for tool in TOOLS if verb == "lens"))]


def whole_parser() -> argparse.ArgumentParser:
    """Make one parser with a subparser for each verb.

    Returns:
        The parser; it is only read, never used to parse.
    """
    parser = argparse.ArgumentParser(prog="lightwell", description="learns the indirect light of a scene")
    parser.add_argument("--version", action="store_true", help="print the version")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB")
    for verb, *tool in whole_verbs():
        arguments = verb_parser(verb, tool)
        if tool:
            _add_missing(verbs.choices[verb], arguments)
        else:
            verbs.add_parser(verb, help=VERBS[verb], description=VERBS[verb], parents=[arguments], add_help=False)
    return parser


def _add_missing(parser: argparse.ArgumentParser, other: argparse.ArgumentParser) -> None:
    for action in other._actions:
        if action.option_strings and not parser._option_string_actions.keys() & action.option_strings:
            parser._add_action(action)
