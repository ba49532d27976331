"""Options for reading a scene file, shared by all commands that load one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightwell.core.options import option
from lightwell.limits import DEFAULT_LIMITS, NAMES, Limits

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
    )
    unit: float = option(
        1.0,
        f"length of one unit in a glTF scene: {', '.join(UNITS)}, or a number of metres (default: m)",
        flag="--scene-unit",
        parse=metres_per_unit,
        metavar="UNIT",
    )
    allow_paths: tuple[Path, ...] = option(
        (),
        "a folder beside its own whose files a Mitsuba scene may name (repeatable)",
        flag="--allow-path",
        repeat=True,
        parse=lambda texts: tuple(Path(text) for text in texts),
        metavar="DIR",
    )

    @property
    def loading(self) -> dict[str, Any]:
        """Arguments of ``lightwell.scenes.load``."""
        return {"limits": self.limits, "unit": self.unit, "allow_paths": self.allow_paths}


@dataclass(frozen=True, kw_only=True)
class LimitOptions:
    """Limits on what an asset may request."""

    limits: Limits = SceneOptions.__dataclass_fields__["limits"]
