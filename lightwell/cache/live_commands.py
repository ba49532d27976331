"""Commands of the live page, each of which is checked before the session executes it."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

# Largest magnitudes: radians or exponents of e of a camera movement; shift of an object in scene extents.
CAMERA, SHIFT = 100.0, 1.0
# Range of the factor of a light.
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
    """``orbit``: two angles in radians and the exponent of e of the approach; ``move``: a vector in scene extents."""
    factor: float = 1.0
    """Factor of the radiance of a light."""


def parse_command(data: bytes | Mapping[str, Any], things: Collection[int]) -> Command:
    """Check a command.

    Args:
        data: JSON object, as text or parsed: ``do`` and the keys of that command.
        things: Valid indices of ``thing``.

    Returns:
        The command.

    Raises:
        ValueError: Not a JSON object, an unknown command or key, a missing key, a value that is not a number or out of
            range, or an unknown ``thing``.
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
    numbers = {key: float(value) for key, value in order.items() if key != "thing"}
    return Command(do, order.get("thing", 0), **numbers)


def _check(order: Mapping[str, Any], key: str, least: float, most: float) -> None:
    value = order.get(key, least)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not least <= value <= most or not math.isfinite(value):
        raise ValueError(f"live: '{key}' is a number from {least:g} to {most:g}")
