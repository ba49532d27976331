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
    """What is known of an option beside its name, type and default."""

    help: str
    """One line; the default is added where it is printed."""
    least: float | None = None
    """Smallest number that is allowed."""
    most: float | None = None
    """Largest one."""
    parse: Callable[[str], Any] | None = None
    """Reads the text of a command line; None: by the type of the option. Raises ``ValueError``."""
    metavar: str | tuple[str, ...] | None = None
    """What stands for the value in help."""
    choices: tuple[str, ...] = ()
    check: Callable[[Any], str] | None = None
    """Says what is wrong with a value, and the cure; nothing where it is right."""
    flag: str | None = None
    """Name on the command line where it is another one than that of the field, such as ``--no-static``."""
    repeat: bool = False
    """May be given several times."""


def option(default: Any, help: str, **more: Any) -> Any:
    """Declare a dataclass field as an option; the keyword arguments are the fields of ``Option``."""
    return dataclasses.field(default=default, metadata={_KEY: Option(help, **more)})


def options_of(kind: type) -> dict[str, tuple[dataclasses.Field, Option]]:
    """List the options of a dataclass in their order: name → (field, what is known of it)."""
    return {f.name: (f, f.metadata[_KEY]) for f in dataclasses.fields(kind) if _KEY in f.metadata}


def flag_of(name: str, option: Option) -> str:
    """Return the name of an option on the command line: ``--max-bytes`` of ``max_bytes``."""
    return option.flag or "--" + name.replace("_", "-")


def check(settings: Any, verb: str) -> None:
    """Refuse values outside the declared ranges; None stands for a default that is chosen later.

    Raises:
        ValueError: One line that names the verb, the option, the value and the cure.
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
    """Read the text of an option; the error names the verb and the option."""
    try:
        return read(text)
    except ValueError as error:
        raise ValueError(f"{verb}: {flag} {error}") from None


def made(
    kind: type[T], given: Mapping[str, Any], verb: str, choice: str, chosen: str, homes: Mapping[str, Iterable[str]]
) -> T:
    """Make the options that belong to a choice, such as a field; those that it does not know are refused.

    Args:
        kind: Dataclass of options.
        given: Name → value.
        verb: Who speaks in errors, such as 'bake'.
        choice: What is chosen, such as 'field': also the name of the option that chooses.
        chosen: Which one it is.
        homes: Name of an option → those that know it.

    Raises:
        ValueError: An unknown option, with what knows it or the nearest name; a value out of range.
    """
    known = {f.name for f in dataclasses.fields(kind)}
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
    settings = kind(**given)
    check(settings, verb)
    return settings
