"""Texts that turn the environment map: ``--vary environment.rotation=0..360`` and ``--set environment.rotation=90``."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

# Name of the light that an environment map is, its parameter, and what is written for it.
ENVIRONMENT, ROTATION = "environment", "rotation"
ROTATED = f"{ENVIRONMENT}.{ROTATION}"
ROTATED_EXAMPLE = f"{ROTATED}=0..360"
# Largest angle, and the widest range, degrees.
WHOLE_TURN = 360.0
_TEXT = re.compile(r"\s*environment\s*\.\s*rotation\s*=(.*)", re.DOTALL)


def turn_range(text: str) -> tuple[float, float] | None:
    """Read the angles between which an environment map turns.

    Args:
        text: ``environment.rotation=0..360``, degrees clockwise seen from above, or any other declaration.

    Returns:
        First and last angle, the first is the smaller one; None for another declaration.

    Raises:
        ValueError: The range is none, is empty, or is longer than a whole turn.
    """
    match = _TEXT.fullmatch(text)
    if not match:
        return None
    first, dots, last = match[1].partition("..")
    low, high = _number(first), _number(last)
    wrong = "" if dots and math.isfinite(low + high) else "expected FIRST..LAST in degrees"
    if not wrong and low >= high:
        wrong = "the first angle is not below the last one"
    if not wrong and (max(abs(low), abs(high)) > WHOLE_TURN or high - low > WHOLE_TURN):
        wrong = "angles lie between -360 and 360 degrees, at most one turn apart"
    if wrong:
        raise ValueError(f"vary: '{text.strip()[:80]}': {wrong}; write for example {ROTATED_EXAMPLE}")
    return low, high


def parse_turn(texts: Sequence[str]) -> tuple[float | None, list[str]]:
    """Read the turn of the environment map among the values of ``--set``.

    Args:
        texts: ``environment.rotation=90``, and other settings.

    Returns:
        Degrees of the last one; None without. And the other texts.

    Raises:
        ValueError: It is no angle.
    """
    angle, others = None, []
    for text in texts:
        match = _TEXT.fullmatch(text)
        if not match:
            others.append(text)
            continue
        angle = _number(match[1])
        if not math.isfinite(angle):
            raise ValueError(f"set: '{text.strip()[:80]}' is no angle in degrees; write for example {ROTATED}=90")
    return angle, others


def _number(text: str) -> float:
    """The number of a text; NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan
