"""Suggestions for misspelt names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """Suggest the nearest of several names.

    Args:
        word: The misspelt name.
        known: Names that exist.
        otherwise: Result where none is near.

    Returns:
        "did you mean 'NAME'?", or ``otherwise``.
    """
    near = difflib.get_close_matches(word, list(known), 1, 0.6)
    return f"did you mean '{near[0]}'?" if near else otherwise


def nearest(word: str, known: Iterable[str], count: int = 3) -> str:
    """List the names that are most like a word.

    Args:
        word: The misspelt name.
        known: Names that exist.
        count: Most names to list.

    Returns:
        Names in quotes, joined by commas; 'none' where there is no name.
    """
    names = list(dict.fromkeys(known))
    near = difflib.get_close_matches(word, names, count, 0.0)
    return ", ".join(f"'{name}'" for name in near or names[:count]) or "none"
