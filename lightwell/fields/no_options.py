"""The options of fields that have none of their own."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NoOptions:
    """No option but those of every bake."""
