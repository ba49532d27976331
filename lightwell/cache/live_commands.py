"""What the live page may ask for: every command is checked before the session sees it."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

# Largest number by key: radians or powers of e of a camera movement, parts of the scene's extent of a thing's.
CAMERA, SHIFT = 100.0, 1.0
# Range of the factor of a lamp.
DARKEST, BRIGHTEST = 0.01, 100.0
# Keys that a command may have beside ``do``; those that it must have.
KEYS: Mapping[str, tuple[str, ...]] = {
    "orbit": ("x", "y", "z"), "move": ("thing", "x", "y", "z"), "brighten": ("thing", "factor"),
    "reset": (), "freeze": (),
}  # fmt: skip
NEEDED = ("thing", "factor")


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
    """Of ``orbit``: angles in radians, and the power of e by which to come closer; of ``move``: a vector in parts of
    the scene's extent."""
    factor: float = 1.0
    """By which the light of a lamp is multiplied."""


def parse_command(data: bytes | Mapping[str, Any], things: Collection[int]) -> Command:
    """Check a command.

    Args:
        data: A JSON object as text or read: ``do`` and the keys of that command.
        things: Indices that ``thing`` may have.

    Raises:
        ValueError: It is no command: its form, its keys, a number that is none or out of its range, or a thing that is
            not there.
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
    if "thing" in order and (type(order["thing"]) is not int or order["thing"] not in things):
        raise ValueError("live: there is no such thing")
    most = CAMERA if do == "orbit" else SHIFT
    for key in ("x", "y", "z"):
        _check(order, key, -most, most)
    _check(order, "factor", DARKEST, BRIGHTEST)
    return Command(do, **{key: value if key == "thing" else float(value) for key, value in order.items()})


def _check(order: Mapping[str, Any], key: str, least: float, most: float) -> None:
    value = order.get(key, least)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not least <= value <= most or not math.isfinite(value):
        raise ValueError(f"live: '{key}' is a number from {least:g} to {most:g}")
