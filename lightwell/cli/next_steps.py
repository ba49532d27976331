"""What ``lightwell`` alone prints: the three things to do next, in this folder."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path


def next_steps(folder: Path) -> str:
    """Name three commands, and what each does.

    Args:
        folder: Working folder: a scene or a baked folder in it is named.

    Returns:
        Lines to print.
    """
    scene = _first(folder, lambda entry: entry.name.lower().endswith((".glb", ".gltf")))
    baked = _first(folder, lambda entry: os.path.isfile(os.path.join(entry.path, "report.json")))
    steps = [
        (f"lightwell view {baked}", "open the page of what you baked")
        if baked
        else ("lightwell demo", "bake a built-in scene in three minutes and open its page"),
        (f"lightwell bake {scene or 'room.glb'} -o out", "learn the light of a scene of yours"),
        ("lightwell doctor", "check this machine"),
    ]
    width = max(len(command) for command, _ in steps) + 3
    lines = [f"  {command:<{width}}{meaning}" for command, meaning in steps]
    return "\n".join(
        ["What to do next:", *lines, "", "lightwell --help lists all verbs, lightwell VERB --help their options."]
    )


def _first(folder: Path, wanted: Callable[[os.DirEntry[str]], bool]) -> str:
    """Return the first entry by name that is wanted, quoted for a shell, or ''."""
    import shlex

    try:
        with os.scandir(folder) as entries:
            names = sorted(entry.name for entry in entries if wanted(entry))
    except OSError:
        return ""
    return shlex.quote(names[0]) if names else ""
