"""Times, lengths and sizes as people write them: ``5m`` of time, ``50cm``, ``250kB`` (1 kB = 1000 B)."""

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
        units: Unit → what a number of that unit is multiplied by; '' where none is needed.
        what: Ends the message of the error: what is expected, such as "a length; give metres, such as 1m or 50cm".

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
    """Read a length: ``1m``, ``50cm`` or a plain number of metres; ``ValueError`` for anything else."""
    return quantity(text, METRES, "a length; give metres, such as 1m or 50cm")


def byte_count(text: str) -> int:
    """Read a size: ``1MB``, ``250kB`` or a plain number of bytes; ``ValueError`` for anything below a byte."""
    wanted = "a size; write 1MB, 250kB or a number of bytes"
    value = quantity(text, BYTES, wanted)
    if value < 1:
        raise ValueError(f"'{text}' is not {wanted}")
    return int(value)
