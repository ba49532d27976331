"""Mistakes that are found in the arguments alone, before anything slow is imported."""

from __future__ import annotations

import argparse
from pathlib import Path

from lightwell.cli.lens import TOOLS as LENS_TOOLS
from lightwell.core.scene_options import check_source
from lightwell.core.suggest import did_you_mean
from lightwell.core.vary import parse_vary
from lightwell.fields.registry import BUILT_IN, PRESETS, check_preset, field_names, unknown_field


def check_arguments(arguments: argparse.Namespace) -> None:
    """Check files and names; a mistake is a ``ValueError`` of one line with the cure.

    Args:
        arguments: Parsed arguments of any verb.
    """
    _check_files(arguments)
    check_names(arguments)


def check_names(arguments: argparse.Namespace) -> None:
    """Check fields, presets and what may move; a mistake is a ``ValueError`` of one line with the cure.

    Args:
        arguments: Parsed arguments of any verb.
    """
    if getattr(arguments, "verb", "") == "export":
        return  # its --field is the name of a field inside a file
    for text in getattr(arguments, "vary", ()):
        parse_vary(text)
    preset = getattr(arguments, "preset", "default")
    if getattr(arguments, "field", None):
        _check_field(arguments.field, preset)
    elif "field" in arguments:
        _check_preset_of_any(preset)
    for name in filter(None, (getattr(arguments, "fields", None) or "").split(",")):
        # Presets are told by the verb itself, in its own notation.
        _check_field(name.strip().partition(":")[0])


def _check_files(arguments: argparse.Namespace) -> None:
    """Refuse files that are not there, and names of pictures that no verb writes."""
    verb = getattr(arguments, "verb", "")
    if "scene" in arguments:
        check_source(arguments.scene)
    if verb == "lens" and arguments.frame not in LENS_TOOLS:
        _check_tool(arguments.frame)
        if not arguments.out:
            raise ValueError("lens: no picture to write; name it with -o OUT.exr or -o OUT.png")
        if arguments.focus is None and arguments.focus_at is None:
            raise ValueError("lens: no focus distance; give --focus 2.5m or --focus-at X,Y")
        if arguments.frames is None and "#" not in arguments.frame and not Path(arguments.frame).is_file():
            raise ValueError(f"lens: no file {arguments.frame}; name an EXR or PNG picture")
    if verb == "info" and not Path(arguments.path).exists():
        check_source(arguments.path)
    if verb in ("export", "validate") and not Path(arguments.path).exists():
        raise ValueError(
            f"{verb}: there is no '{arguments.path}'; name a folder written by 'lightwell bake', or a .glb"
        )


def _check_tool(frame: str) -> None:
    """A misspelt tool reads as a frame."""
    near = "" if "." in frame or Path(frame).exists() else did_you_mean(frame, LENS_TOOLS)
    if near:
        raise ValueError(f"lens: there is no file '{frame}'; {near}")


def _check_field(name: str, preset: str = "default") -> None:
    if name not in field_names():
        raise unknown_field(name)
    if name in BUILT_IN:
        check_preset(name, preset)


def _check_preset_of_any(preset: str) -> None:
    """Without a field, the first that has the preset is meant: one of them must have it."""
    known = {name for presets in PRESETS.values() for name in presets}
    if preset not in known:
        cure = did_you_mean(preset, sorted(known), "lightwell bake --help lists them")
        raise ValueError(f"bake: there is no preset '{preset}'; {cure}")
