"""The one error that the lens raises for a user's mistake."""

from __future__ import annotations


class LensError(ValueError):
    """Something that cannot be used. One line: what, where, what was expected and the cure."""
