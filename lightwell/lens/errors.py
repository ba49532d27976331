"""The error that the lens raises for invalid input."""

from __future__ import annotations


class LensError(ValueError):
    """Invalid input; the message is one line: what, where, what was expected and the cure."""
