"""Reads times, lengths and sizes with units: ``5m`` of time, ``50cm``, ``250kB`` (1 kB = 1000 B)."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

SECONDS = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
METRES = {"": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001}
BYTES = {"": 1.0, "B": 1.0, "kB": 1e3, "KB": 1e3, "MB": 1e6, "GB": 1e9}


def quantity(text: str, units: Mapping[str, float], what: str) -> float:
    """Read a positive number with a unit.

    Args:
        text: For example '50cm' or '1.5 m'.
        units: Factor by unit; '' for numbers without one.
        what: End of the error message, such as "a length; give metres, such as 1m or 50cm".

    Returns:
        The number in the base unit, > 0 and finite.

    Raises:
        ValueError: ``text`` is not such a number; the message begins with it, in quotes.
    """
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*([A-Za-z%]*)\s*", text)
    scale = units.get(match.group(2)) if match else None
    value = float(match.group(1)) * scale if match and scale is not None else 0.0
    if not 0 < value < math.inf:
        raise ValueError(f"'{text}' is not {what}")
    return value


def metres(text: str) -> float:
    """Read a length; other texts are a ``ValueError``.

    Args:
        text: Such as ``1m`` or ``50cm``, or a number of metres.

    Returns:
        Metres, > 0.
    """
    return quantity(text, METRES, "a length; give metres, such as 1m or 50cm")


def byte_count(text: str) -> int:
    """Read a size.

    Args:
        text: Such as ``1MB`` or ``250kB`` (1 kB = 1000 B), or a number of bytes.

    Returns:
        Bytes, ≥ 1.

    Raises:
        ValueError: The text is not a size, or the size is below one byte.
    """
    wanted = "a size; write 1MB, 250kB or a number of bytes"
    value = quantity(text, BYTES, wanted)
    if value < 1:
        raise ValueError(f"'{text}' is not {wanted}")
    return int(value)


def size_text(count: float) -> str:
    """Write a number of bytes for people: 950 B, 292 kB, 1.24 MB (1 kB = 1000 B).

    Args:
        count: Bytes, ≥ 0.

    Returns:
        Three digits and the unit.
    """
    for unit in ("B", "kB", "MB", "GB"):
        if count < 999.5 or unit == "GB":
            break
        count /= 1000
    return f"{count:.0f} {unit}" if count >= 100 or unit == "B" else f"{count:.3g} {unit}"


def time_text(seconds: float) -> str:
    """Write a duration for people: 8.3 s, 2 min 5 s, 1 h 2 min.

    Args:
        seconds: Duration, ≥ 0.

    Returns:
        The text.
    """
    if seconds < 60:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"
