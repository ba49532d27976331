"""Commands of the live page, each of which is checked before the session executes it."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from lightwell.core.scene_edits import LEAST_ROUGHNESS
from lightwell.fields.budget import QUALITY_SECONDS

# Largest magnitudes: radians or exponents of e of a camera movement; shift of an object in scene extents.
CAMERA, SHIFT = 100.0, 1.0
# Range of the factor of a light.
DARKEST, BRIGHTEST = 0.01, 100.0
# Keys that a command may have beside ``do``; those that it must have.
KEYS: Mapping[str, tuple[str, ...]] = {
    "orbit": ("x", "y", "z"), "move": ("thing", "x", "y", "z"), "brighten": ("thing", "factor"),
    "paint": ("material", "red", "green", "blue", "roughness"), "show": ("picture",), "bake": ("quality",),
    "reset": (), "freeze": (),
}  # fmt: skip
NEEDED = ("thing", "factor", "material", "picture")
# What the page may show.
PICTURES = ("cache", "path", "baked", "first-hit", "difference")
COLOR = ("red", "green", "blue")


@dataclass(frozen=True)
class Command:
    """A checked command."""

    do: str
    """A key of ``KEYS``."""
    thing: int = 0
    """Index of a light or object."""
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    """``orbit``: two angles in radians and the exponent of e of the approach; ``move``: a vector in scene extents."""
    factor: float = 1.0
    """Factor of the radiance of a light."""
    material: int = 0
    """Index of a material."""
    color: tuple[float, float, float] | None = None
    """Its linear colour in [0, 1]; None: as it is."""
    roughness: float | None = None
    """Its roughness; None: as it is."""
    picture: str = ""
    """One of ``PICTURES``."""
    quality: str = "draft"
    """Of a bake, one of ``QUALITY_SECONDS``."""


def parse_command(
    data: bytes | Mapping[str, Any], things: Collection[int], materials: Collection[int] = ()
) -> Command:  # fmt: skip
    """Check a command.

    Args:
        data: JSON object, as text or parsed: ``do`` and the keys of that command.
        things: Valid indices of ``thing``.
        materials: Valid indices of ``material``.

    Returns:
        The command.

    Raises:
        ValueError: Not a JSON object, an unknown command or key, a missing key, a value that is not a number or out of
            range, an unknown ``thing``, ``material`` or ``picture``, or a part of a colour.
    """
    try:
        order = json.loads(data) if isinstance(data, bytes) else dict(data)
    except (ValueError, RecursionError):
        raise ValueError("live: a command is a JSON object") from None
    if not isinstance(order, dict):
        raise ValueError("live: a command is a JSON object")
    do = order.pop("do", None)
    if not isinstance(do, str) or do not in KEYS:
        raise ValueError(f"live: there is no command; expected one of {', '.join(KEYS)}")
    if extra := sorted(set(order) - set(KEYS[do])):
        raise ValueError(f"live: '{do}' has no '{extra[0][:40]}'; it takes {', '.join(KEYS[do]) or 'nothing'}")
    if missing := [key for key in KEYS[do] if key in NEEDED and key not in order]:
        raise ValueError(f"live: '{do}' needs '{missing[0]}'")
    for key, known in (("thing", things), ("material", materials)):
        if key in order and (type(order[key]) is not int or order[key] not in known):
            raise ValueError(f"live: there is no such {key}")
    for key, words in (("picture", PICTURES), ("quality", QUALITY_SECONDS)):
        if key in order and (not isinstance(order[key], str) or order[key] not in words):
            raise ValueError(f"live: there is no such {key}; expected one of {', '.join(words)}")
    most = CAMERA if do == "orbit" else SHIFT
    for key in ("x", "y", "z"):
        _check(order, key, -most, most)
    _check(order, "factor", DARKEST, BRIGHTEST)
    for key in COLOR:
        _check(order, key, 0, 1)
    _check(order, "roughness", LEAST_ROUGHNESS, 1)
    if 0 < len(channels := [float(order[key]) for key in COLOR if key in order]) < len(COLOR):
        raise ValueError("live: a colour has red, green and blue")
    return Command(
        do,
        thing=order.get("thing", 0),
        x=float(order.get("x", 0)),
        y=float(order.get("y", 0)),
        z=float(order.get("z", 0)),
        factor=float(order.get("factor", 1)),
        material=order.get("material", 0),
        color=(channels[0], channels[1], channels[2]) if channels else None,
        roughness=float(order["roughness"]) if "roughness" in order else None,
        picture=order.get("picture", ""),
        quality=order.get("quality", "draft"),
    )


def _check(order: Mapping[str, Any], key: str, least: float, most: float) -> None:
    value = order.get(key, least)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not least <= value <= most or not math.isfinite(value):
        raise ValueError(f"live: '{key}' is a number from {least:g} to {most:g}")
