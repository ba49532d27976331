"""The verb ``man``: the manual page, made from the parsers."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

DESCRIPTION = """\
Print the manual page. To read it:
  lightwell man > lightwell.1
  man ./lightwell.1"""

EXIT_CODES = (
    "0: done. 1: a check found something, or a scene of a batch failed. 2: a mistake, told in one line. 130: Ctrl-C."
)


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments: none.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """


def run(arguments: argparse.Namespace) -> int:
    """Print the page.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    print("\n".join(manual_page()))
    return 0


def manual_page() -> Iterator[str]:
    """Write the manual page in the language of man (roff).

    Yields:
        Its lines.
    """
    import lightwell
    from lightwell.cli.main import EXAMPLES, verb_parser
    from lightwell.cli.verbs import VERBS
    from lightwell.cli.whole_parser import whole_verbs

    yield f'.TH LIGHTWELL 1 "" "lightwell {lightwell.__version__}"'
    yield from (".SH NAME", r"lightwell \- learn the indirect light of a scene and play it back in real time")
    yield from (".SH SYNOPSIS", r".B lightwell", r"\fIVERB\fR [\fIarguments\fR]")
    for words in whole_verbs():
        verb, parser = words[0], verb_parser(words[0], words[1:])
        yield from (f".SH lightwell {' '.join(words)}", ".nf", _plain(parser.description or VERBS[verb]), ".fi")
        for action in parser._actions:
            if action.help != argparse.SUPPRESS and not isinstance(action, argparse._HelpAction):
                yield from (".TP", _name(action), _plain(_help(parser, action)))
    yield from (".SH EXIT STATUS", EXIT_CODES)
    yield from (".SH EXAMPLES", ".nf", _plain(EXAMPLES.partition("\n")[2].rstrip()), ".fi")


def _name(action: argparse.Action) -> str:
    metavar = action.metavar or action.dest.upper()
    value = "" if action.nargs == 0 else " ".join(metavar) if isinstance(metavar, tuple) else metavar
    flags = ", ".join(rf"\fB{_plain(flag)}\fR" for flag in action.option_strings)
    return f"{flags} {_plain(value)}".strip()


def _help(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    return parser._get_formatter()._expand_help(action)


def _plain(text: str) -> str:
    """Escape what roff would read as commands."""
    escaped = text.replace("\\", r"\e").replace("-", r"\-")
    return "\n".join(rf"\&{line}" if line.startswith((".", "'")) else line for line in escaped.splitlines())
