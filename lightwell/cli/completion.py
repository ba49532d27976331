"""The verb ``completion``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

SHELLS = ("bash", "zsh", "fish", "tcsh")
DESCRIPTION = """\
Print a script that completes verbs, options and files. For this session:
  eval "$(lightwell completion bash)"
For all of them, write it to a file that your shell reads, such as
  ~/.local/share/bash-completion/completions/lightwell"""


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    parser.add_argument("shell", choices=SHELLS, help="the shell")


def run(arguments: argparse.Namespace) -> int:
    """Print the script.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    import shtab

    from lightwell.cli.whole_parser import whole_parser

    print(shtab.complete(whole_parser(), arguments.shell))
    return 0
