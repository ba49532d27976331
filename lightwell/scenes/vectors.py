"""Vectors of three numbers in records."""

from __future__ import annotations

from collections.abc import Iterable

Vector = tuple[float, float, float]


def vector(values: Iterable[float]) -> Vector:
    """Convert three numbers.

    Args:
        values: Three numbers, such as an array [3].

    Returns:
        Them as Python's numbers.
    """
    x, y, z = (float(v) for v in values)
    return x, y, z
