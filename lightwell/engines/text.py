"""Texts of engines from templates, and quoting for their formats."""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

TEMPLATES = Path(__file__).parent / "templates"
# Longest name of a file that is made from a name in the asset.
MAX_NAME = 40


@cache
def _environment() -> Environment:
    # Not HTML: what is inserted is quoted by ``quoted`` or is a number.
    made = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=False,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["floats"] = floats
    return made


def render(template: str, /, **values: Any) -> str:
    """Fill in a template of ``templates/``.

    Args:
        template: Its file.
        **values: Variables of the template; one that is missing is an error.

    Returns:
        The text.
    """
    return _environment().get_template(template).render(**values)


def quoted(text: str) -> str:
    """Write a string as a literal that C#, JavaScript, Rust and Godot's text format share.

    Args:
        text: Any text; letters of all scripts stay as they are. What Unicode calls not printable is replaced by ``_``:
            the languages have no escape in common for it.

    Returns:
        The literal with its quotation marks, for a file in UTF-8; only ``"`` and ``\\`` are escaped in it.
    """
    return json.dumps("".join(c if c.isprintable() else "_" for c in text), ensure_ascii=False)


def numbers(values: Iterable[float]) -> str:
    """Write numbers as a list.

    Args:
        values: Finite numbers.

    Returns:
        They, with nine digits, which every 32-bit float needs at most, separated by commas.
    """
    return ", ".join(f"{float(v):.9g}" for v in values)


def floats(text: str) -> str:
    """Give whole numbers of a list a point, as Rust's literals of floats need; the filter ``floats`` of templates.

    Args:
        text: Numbers as ``numbers`` writes them.

    Returns:
        The same numbers, each with a point or an exponent.
    """
    return ", ".join(word if "." in word or "e" in word else f"{word}.0" for word in text.split(", "))


def identifier(name: str) -> str:
    """Make the name of a function and of files from the name of a field.

    Args:
        name: Any text.

    Returns:
        Letters, digits and single underscores, at most ``MAX_NAME`` characters, a letter first.
    """
    parts = "".join(c if c.isascii() and c.isalnum() else " " for c in name).split()
    word = "_".join(parts)[:MAX_NAME].strip("_")
    return word if word[:1].isalpha() else f"field_{word}".rstrip("_")
