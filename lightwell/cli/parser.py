"""The parser of a verb: a mistake is one line, with the nearest name that exists."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any, NoReturn

from lightwell.core.suggest import did_you_mean

# Exit code of a mistake of the user, which is described in one line.
USAGE_ERROR = 2
_CHOICE = re.compile(r"argument (.+): invalid choice: '(.*)' \(choose from (.+)\)")


class Parser(argparse.ArgumentParser):
    """Reports a mistake in one line, as for every other error; --help lists the arguments."""

    _given: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse, and remember the words: an option that does not exist is told before one that is missing.

        Args:
            args: Words.
            namespace: Where values are stored.

        Returns:
            The values, and the words that are no arguments.
        """
        self._given = args or ()
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Print a line and exit with code 2.

        Args:
            message: The mistake.
        """
        unknown = self._unknown_options()
        choice = _CHOICE.fullmatch(message)
        if "expected one argument" in message:
            message += " (a value that begins with '-' is written --name=-value)"
        elif unknown and message.startswith(("unrecognized arguments", "the following arguments are required")):
            near = did_you_mean(unknown[0], self._option_string_actions)
            message = f"there is no option {unknown[0]}" + (f"; {near}" if near else "")
        elif choice:
            known = [word.strip("'") for word in choice[3].split(", ")]
            cure = did_you_mean(choice[2], known, f"choose one of {', '.join(known)}")
            message = f"{choice[1]} '{choice[2]}' is unknown; {cure}"
        joint = " " if message.endswith("?") else "; "
        self.exit(USAGE_ERROR, f"{self.prog}: {message}{joint}{self.prog} --help lists the arguments\n")

    def _unknown_options(self) -> list[str]:
        flags = [word.split("=")[0] for word in self._given if re.match(r"--\w", word)]
        return [flag for flag in flags if not any(known.startswith(flag) for known in self._option_string_actions)]
