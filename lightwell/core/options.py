"""Options declared once, as fields of a dataclass with their range, help and unit; command lines are made from them."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")
_KEY = "lightwell.option"


@dataclass(frozen=True)
class Option:
    """Declaration of an option, except for its name, type and default."""

    help: str
    """One line; the default is added where it is printed."""
    least: float | None = None
    """Smallest number that is allowed."""
    most: float | None = None
    """Largest one."""
    parse: Callable[[str], Any] | None = None
    """Reads the text of a command line, or raises ``ValueError``; None: by the type of the option."""
    metavar: str | tuple[str, ...] | None = None
    """Placeholder of the value in help texts."""
    choices: tuple[str, ...] = ()
    """Allowed values; empty: any."""
    check: Callable[[Any], str] | None = None
    """Returns what is wrong with a value, and the cure; '' for a valid one."""
    flag: str | None = None
    """Name on the command line when it differs from that of the field, such as ``--no-static``."""
    repeat: bool = False
    """May be given several times."""
    group: str = ""
    """Heading under which help lists it."""


def option(default: Any, help: str, **more: Any) -> Any:
    """Declare a dataclass field as an option.

    Args:
        default: Default value.
        help: One line for help texts.
        **more: Further fields of ``Option``.

    Returns:
        The dataclass field.
    """
    return dataclasses.field(default=default, metadata={_KEY: Option(help, **more)})


def options_of(kind: type) -> dict[str, tuple[dataclasses.Field[Any], Option]]:
    """List the options of a dataclass in their order.

    Args:
        kind: The dataclass.

    Returns:
        Field and declaration by name.
    """
    return {f.name: (f, f.metadata[_KEY]) for f in dataclasses.fields(kind) if _KEY in f.metadata}


def flag_of(name: str, option: Option) -> str:
    """Return the name of an option on the command line, such as ``--max-bytes`` for ``max_bytes``.

    Args:
        name: Name of the field.
        option: Its declaration.

    Returns:
        The name with its dashes.
    """
    return option.flag or "--" + name.replace("_", "-")


def check(settings: Any, verb: str) -> None:
    """Refuse values outside of their declared ranges with a one-line ``ValueError`` that names the cure.

    None stands for a default that is chosen later.

    Args:
        settings: Dataclass with options.
        verb: Name of the command, for messages.
    """
    for name, (_, known) in options_of(type(settings)).items():
        value = getattr(settings, name)
        if value is not None:
            _check_value(verb, flag_of(name, known), value, known)


def _check_value(verb: str, flag: str, value: Any, known: Option) -> None:
    start = f"{verb}: {flag} {value}"
    if known.least is not None and not value >= known.least:
        raise ValueError(f"{start} is too small; give {known.least:g} or more")
    if known.most is not None and not value <= known.most:
        raise ValueError(f"{start} is too large; give {known.most:g} or less")
    if known.choices and value not in known.choices:
        raise ValueError(f"{start} is unknown; choose one of {', '.join(known.choices)}")
    if known.check and (wrong := known.check(value)):
        raise ValueError(f"{start} {wrong}")


def parsed(verb: str, flag: str, text: str, read: Callable[[str], T]) -> T:
    """Read the text of an option.

    Args:
        verb: Name of the command, for the message.
        flag: Name of the option, for the message.
        text: Text to read.
        read: Reads it; raises ``ValueError`` for other texts.

    Returns:
        The value.

    Raises:
        ValueError: The text cannot be read; the message names command and option.
    """
    try:
        return read(text)
    except ValueError as error:
        raise ValueError(f"{verb}: {flag} {error}") from None


def made(
    kind: type[T], given: Mapping[str, Any], verb: str, choice: str, chosen: str, homes: Mapping[str, Iterable[str]]
) -> T:
    """Create the options that belong to a choice, such as a field; options that it does not have are refused.

    Args:
        kind: Dataclass of options.
        given: Values by name; texts are read as on a command line.
        verb: Name of the command, for messages.
        choice: What is chosen, such as 'field': also the name of the option that chooses it.
        chosen: The chosen one.
        homes: By name of an option, the choices that have it.

    Returns:
        The options, checked against their ranges.

    Raises:
        ValueError: An option is unknown (the message names the choices that have it, or the nearest name).
    """
    known = {f.name for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    for name in given:
        if name in known:
            continue
        flag = "--" + name.replace("_", "-")
        if found := list(homes.get(name, ())):
            named = " or ".join(f"'{home}'" for home in found)
            raise ValueError(
                f"{verb}: {flag} is an option of the {choice} {named}, not of '{chosen}'; "
                f"add --{choice} {found[0]}, or leave {flag} out"
            )
        near = difflib.get_close_matches(name, known | set(homes), 1)
        cure = f"did you mean {near[0]}" if near else f"its own options are {', '.join(sorted(known)) or 'none'}"
        raise ValueError(f"{verb}: there is no option {flag} of the {choice} '{chosen}'; {cure}")
    readers = options_of(kind)
    values = {
        name: parsed(verb, flag_of(name, readers[name][1]), value, parse)
        if isinstance(value, str) and name in readers and (parse := readers[name][1].parse)
        else value
        for name, value in given.items()
    }
    settings = kind(**values)
    check(settings, verb)
    return settings
