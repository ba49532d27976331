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
    return Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=False,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )


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
        text: Any text; what is not printable ASCII is replaced by ``_``.

    Returns:
        The literal with its quotation marks.
    """
    return json.dumps("".join(c if " " <= c <= "~" else "_" for c in text))


def numbers(values: Iterable[float]) -> str:
    """Write numbers as a list.

    Args:
        values: Finite numbers.

    Returns:
        They, with nine digits, which every 32-bit float needs at most, separated by commas.
    """
    return ", ".join(f"{float(v):.9g}" for v in values)


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
