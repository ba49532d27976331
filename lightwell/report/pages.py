"""The templates of the pages, with the filters that format numbers."""

from __future__ import annotations

import re
from pathlib import Path

from markupsafe import Markup, escape

from lightwell.core.templates import Templates
from lightwell.report import numbers

# An option of the command line, as messages write it.
OPTION = re.compile(r"--[a-z-]+")


def unbroken(text: str) -> Markup:
    """Keep the options that a text names on one line: a browser may break a line after each of their hyphens.

    Args:
        text: For example the verdict of a bake.

    Returns:
        HTML.
    """
    return Markup(OPTION.sub(lambda option: f'<span class="option">{option[0]}</span>', escape(text)))


FILTERS = (unbroken, numbers.amount, numbers.digits, numbers.duration, numbers.flat, numbers.grouped, numbers.percent)
TEMPLATES = Templates(Path(__file__).parent / "templates", {form.__name__: form for form in FILTERS})
