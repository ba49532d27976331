"""Mistakes that are found in the arguments alone, before anything slow is imported."""

from __future__ import annotations

import argparse

from lightwell.core.scene_options import check_source
from lightwell.core.vary import parse_vary
from lightwell.fields.registry import BUILT_IN, DEFAULT, check_preset, field_names, field_of, unknown_field


def check_arguments(arguments: argparse.Namespace) -> None:
    """Check scene, field, preset and what may move; a mistake is a ``ValueError`` of one line with the cure.

    Args:
        arguments: Parsed arguments of any verb.
    """
    if getattr(arguments, "verb", "") == "export":
        return  # its --field is the name of a field inside a file
    for text in getattr(arguments, "vary", ()):
        parse_vary(text)
    if "scene" in arguments:
        check_source(arguments.scene)
    preset = getattr(arguments, "preset", "default")
    if getattr(arguments, "field", None):
        _check_field(arguments.field, preset)
    elif "field" in arguments:
        _check_field(field_of(preset) if preset != "default" else DEFAULT, preset)
    for name in filter(None, (getattr(arguments, "fields", None) or "").split(",")):
        # Presets are told by the verb itself, in its own notation.
        _check_field(name.strip().partition(":")[0])


def _check_field(name: str, preset: str = "default") -> None:
    if name not in field_names():
        raise unknown_field(name)
    if name in BUILT_IN:
        check_preset(name, preset)
