"""The parser of the whole command line, with all verbs: for shell completion and the manual page."""

from __future__ import annotations

import argparse

from lightwell.cli.main import VERBS, verb_parser


def whole_parser() -> argparse.ArgumentParser:
    """Make one parser with a subparser for each verb.

    Returns:
        The parser; it is only read, never used to parse.
    """
    parser = argparse.ArgumentParser(prog="lightwell", description="learns the indirect light of a scene")
    parser.add_argument("--version", action="store_true", help="print the version")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB")
    for verb, summary in VERBS.items():
        verbs.add_parser(verb, help=summary, description=summary, parents=[verb_parser(verb)], add_help=False)
    return parser
