"""Options that were given, as words of a command line and as values by name."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any


def options_by_name(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """List the options of a verb.

    Args:
        parser: Parser of the verb.

    Returns:
        Options by name of their value, such as ``view_size``; help and version are left out.
    """
    return {
        action.dest: action
        for action in parser._actions
        if action.option_strings and not isinstance(action, argparse._HelpAction | argparse._VersionAction)
    }


def given_values(parser: argparse.ArgumentParser, words: Sequence[str]) -> dict[str, Any]:
    """Find the values that words give. A mistake in the words ends the program as ``parse_args`` does.

    Args:
        parser: Parser of the verb; it is of no other use afterwards.
        words: Words after the verb.

    Returns:
        Values by name; arguments that were not given are absent.
    """
    for action in parser._actions:
        action.required, action.default = False, argparse.SUPPRESS
        if action.nargs is None and not action.option_strings:
            action.nargs = "?"
    return vars(parser.parse_known_args(list(words))[0])


def words_of(action: argparse.Action, value: Any) -> list[str]:
    """Write a value as words that the option's parser reads.

    Args:
        action: The option.
        value: Its value, as ``given_values`` or a settings file gives it.

    Returns:
        The words; none for a switch that is off.

    Raises:
        ValueError: The value is not of the option's kind; the message says what was expected.
    """
    flag = action.option_strings[-1]
    if action.nargs == 0:
        if not isinstance(value, bool):
            raise ValueError("is a switch; write true or false")
        return [flag] if value == action.const else []
    if isinstance(action, argparse._AppendAction):
        return [f"{flag}={_text(item)}" for item in (value if isinstance(value, list | tuple) else [value])]
    if isinstance(action.nargs, int):
        if not isinstance(value, list | tuple) or len(value) != action.nargs:
            raise ValueError(f"takes a list of {action.nargs} values")
        return [flag, *map(_text, value)]
    text = _text(value)
    if action.choices and text not in action.choices:
        raise ValueError(f"is '{text[:40]}'; choose one of {', '.join(map(str, action.choices))}")
    if action.type in (int, float):
        try:
            action.type(text)
        except ValueError:
            raise ValueError(f"is '{text[:40]}'; write a number") from None
    return [f"{flag}={text}"]


def _text(value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError("is no number or text; write one, as on the command line")
    return str(value)
