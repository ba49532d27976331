"""Options for reading a scene file, shared by all commands that load one."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightwell.core.options import option
from lightwell.core.suggest import did_you_mean
from lightwell.limits import DEFAULT_LIMITS, NAMES, Limits

# Scenes that lightwell makes itself, and the files that it loads.
BUILTINS = ("cornell", "courtyard", "courtyard-day", "doorway", "loft", "two-rooms")
GLTF_SUFFIXES = (".gltf", ".glb")
# Files that are converted to glTF first; the packages that do so are extras.
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
MESH_SUFFIXES = (".obj", ".ply")
BLEND_SUFFIXES = (".blend",)
CONVERTED_SUFFIXES = (*USD_SUFFIXES, *MESH_SUFFIXES, *BLEND_SUFFIXES)
SCENE_SUFFIXES = (*GLTF_SUFFIXES, ".xml", *CONVERTED_SUFFIXES)
# Metres per unit of length.
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}


def metres_per_unit(text: str) -> float:
    """Read a unit of length.

    Args:
        text: Name of a unit, such as 'mm' or 'ft', or a number of metres.

    Returns:
        Metres per unit, > 0.

    Raises:
        ValueError: The text is neither.
    """
    try:
        unit = UNITS[text] if text in UNITS else float(text)
    except ValueError:
        unit = math.nan
    if not 0 < unit < math.inf:
        raise ValueError(f"'{text[:40]}' is not a length; write one of {', '.join(UNITS)} or a number of metres")
    return unit


def check_source(source: str | os.PathLike[str]) -> None:
    """Refuse what cannot be the name or the file of a scene.

    Args:
        source: Name of a built-in scene, or path of a file.

    Raises:
        ValueError: The name is unknown, the file is missing, or its ending is that of no scene.
    """
    if source in BUILTINS:
        return
    path = Path(source)
    kind = path.suffix.lower()
    if kind not in SCENE_SUFFIXES:
        near = did_you_mean(str(source), BUILTINS)
        what = f"'{kind}' is not a scene" if kind else "there is no scene of that name"
        raise ValueError(
            f"scene '{path.name}': {what}; {near}{' or ' if near else ''}"
            f"give a .glb, .gltf, .usd, .obj, .ply, .blend or Mitsuba .xml file or one of {', '.join(BUILTINS)}"
        )
    if not path.is_file():
        cure = did_you_mean(path.name, _scene_files(path.parent), "check the path")
        raise ValueError(f"scene '{path.name}': there is no file '{path}'; {cure}")


def _scene_files(folder: Path) -> list[str]:
    try:
        return [entry.name for entry in os.scandir(folder) if entry.name.lower().endswith(SCENE_SUFFIXES)]
    except OSError:
        return []


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """Limits on what a scene file may request, and how it is read."""

    limits: Limits = option(
        DEFAULT_LIMITS,
        f"what a file may ask for, such as vertices=5e7 (repeatable): {', '.join(NAMES)}",
        flag="--limit",
        repeat=True,
        parse=Limits.parse,
        metavar="NAME=VALUE",
        group="files from elsewhere",
    )
    unit: float = option(
        1.0,
        f"length of one unit in a glTF, OBJ or PLY scene: {', '.join(UNITS)}, or a number of metres (default: m)",
        flag="--scene-unit",
        parse=metres_per_unit,
        metavar="UNIT",
        group="files from elsewhere",
    )
    allow_paths: tuple[Path, ...] = option(
        (),
        "a folder beside its own whose files a Mitsuba scene may name (repeatable)",
        flag="--allow-path",
        repeat=True,
        parse=lambda texts: tuple(Path(text) for text in texts),
        metavar="DIR",
        group="files from elsewhere",
    )

    @property
    def loading(self) -> dict[str, Any]:
        """Arguments of ``lightwell.scenes.load``."""
        return {"limits": self.limits, "unit": self.unit, "allow_paths": self.allow_paths}


@dataclass(frozen=True, kw_only=True)
class LimitOptions:
    """Limits on what an asset may request."""

    limits: Limits = SceneOptions.__dataclass_fields__["limits"]  # type: ignore[assignment]
