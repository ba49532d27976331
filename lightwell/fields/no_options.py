"""Options of the fields that declare none of their own."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NoOptions:
    """No options beyond those of every bake."""
