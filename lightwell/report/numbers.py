"""Format numbers for text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

# Largest unit first: size in the base unit, name.
DURATIONS = ((3600.0, "h"), (60.0, "min"), (1.0, "s"))
PREFIXES = ((1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k"))


def digits(value: float | None, count: int = 3) -> str:
    """Format a number with significant digits and no exponent: 0.0312, 1.25, 412.

    Args:
        value: The number; None: not available.
        count: Significant digits, ≥ 1; at most 6 decimals are written.

    Returns:
        Text; "–" for None, NaN and infinity.
    """
    if value is None:
        return "–"
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else "–"
    decimals = max(count - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:,.{min(decimals, 6)}f}".replace(",", "\u202f")


def grouped(count: int) -> str:
    """Format a count with thin spaces between thousands: 1 250 000.

    Args:
        count: The count.

    Returns:
        Text.
    """
    return f"{count:,}".replace(",", "\u202f")


def brief(value: float) -> str:
    """Format a round number without superfluous zeros, for ticks: 0.5, 20, 1.25.

    Args:
        value: The number.

    Returns:
        Text.
    """
    return f"{value:.6g}" if abs(value) >= 1e-4 or value == 0 else digits(value)


def brief_percent(ratio: float) -> str:
    """Format a round ratio for ticks: 0.02 as '2 %'.

    Args:
        ratio: The ratio.

    Returns:
        Text.
    """
    return f"{brief(round(100 * ratio, 9))}\u202f%"


def brief_duration(seconds: float) -> str:
    """Format a round number of seconds for ticks: '50 s', '2000 s'.

    Args:
        seconds: Seconds.

    Returns:
        Text.
    """
    return f"{brief(seconds)}\u202fs"


def percent(ratio: float | None) -> str:
    """Format a ratio as percent: 0.0312 as '3.12 %'.

    Args:
        ratio: The ratio; None: not available.

    Returns:
        Text; "–" for None.
    """
    return "–" if ratio is None else f"{digits(100 * ratio)}\u202f%"


def amount(value: float | None, unit: str = "") -> str:
    """Format a count or size with a decimal prefix: 412 kB, 1.25 M.

    Args:
        value: Count or size; None: not available.
        unit: Unit without prefix, for example "B".

    Returns:
        Text; "–" for None.
    """
    if value is None:
        return "–"
    for size, prefix in PREFIXES:
        if abs(value) >= size:
            return f"{digits(value / size)}\u202f{prefix}{unit}"
    return (
        f"{digits(value)}\u202f{unit}".rstrip("\u202f") if value % 1 else f"{int(value)}\u202f{unit}".rstrip("\u202f")
    )


def brief_amount(value: float, unit: str = "") -> str:
    """Format a round count or size for ticks: '30 kB', '1 M', '300'.

    Args:
        value: Count or size, ≥ 0.
        unit: Unit without prefix, for example "B".

    Returns:
        Text.
    """
    size, prefix = next(((s, p) for s, p in PREFIXES if value >= s), (1.0, ""))
    return f"{brief(round(value / size, 9))}\u202f{prefix}{unit}".rstrip("\u202f")


def duration(seconds: float | None) -> str:
    """Format a duration: '2 h 03 min', '4 min 10 s', '12.5 s' or '320 ms'.

    Args:
        seconds: Seconds, ≥ 0; None: not available.

    Returns:
        Text; "–" for None.
    """
    if seconds is None:
        return "–"
    if seconds < 1:
        return f"{digits(1000 * seconds)}\u202fms"
    if seconds < 60:
        return f"{digits(seconds)}\u202fs"
    whole = round(seconds)
    (large, name), (small, minor) = DURATIONS[:2] if whole >= 3600 else DURATIONS[1:]
    return f"{int(whole // large)}\u202f{name} {int(whole % large // small):02d}\u202f{minor}"


def plain(value: Any) -> str:
    """Format a JSON value as text, without the syntax of JSON.

    Args:
        value: Number, text, boolean, None, or a list or dictionary of such.

    Returns:
        Text; "–" for None and for what is empty.
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Real):
        number = float(value)
        return digits(number) if number % 1 else grouped(int(number))
    if isinstance(value, Mapping):
        return ", ".join(f"{_words(key)} {plain(entry)}" for key, entry in value.items()) or "–"
    if isinstance(value, Sequence) and not isinstance(value, str):
        texts = [f"({plain(v)})" if isinstance(v, Mapping | list | tuple) else plain(v) for v in value]
        return ", ".join(texts) or "–"
    return "–" if value is None or value == "" else str(value)


def flat(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Turn nested settings into rows of a table: 'light, kind'.

    Args:
        values: Name → JSON value; dictionaries become a row for each entry.
        prefix: Beginning of the names.

    Returns:
        Name and text of each row.
    """
    rows = []
    for key, value in values.items():
        name = f"{prefix}{_words(str(key))}"
        rows += flat(value, f"{name}, ") if isinstance(value, Mapping) and value else [(name, plain(value))]
    return rows


def _words(key: str) -> str:
    return key.replace("_", " ")
