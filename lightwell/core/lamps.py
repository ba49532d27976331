"""Groups of a scene's own lights, as the option ``--lamps`` declares them. The command line imports this module."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from lightwell.core.sun_path import parse_clock

# Switches of one asset at most: the extension's limit (format/FORMAT.md).
MOST_LAMPS = 64
# What ``--set`` calls the time of day.
DAY = "day"
# Ways to group all lights of a scene: by name without its number, each alone, by material, all together, no switch.
MODES = ("name", "each", "material", "all", "none")
_EXAMPLE = 'write for example --lamps "desk=Desk*", or one of ' + ", ".join(MODES)
_NAME = re.compile(r"[A-Za-z_][\w .:-]{0,63}\Z")


@dataclass(frozen=True)
class LampRule:
    """A named group and the names of its lights, with * and ? as in file names."""

    name: str
    patterns: tuple[str, ...]


@dataclass(frozen=True)
class LampRules:
    """How the lights of a scene are grouped."""

    mode: str = "name"
    """One of ``MODES``, for the lights that no rule names."""
    rules: tuple[LampRule, ...] = ()
    asked: bool = False
    """Whether the user asked for groups; otherwise a scene with too many of them has one switch."""


def parse_settings(texts: Sequence[str]) -> dict[str, tuple[float, float, float]]:
    """Read settings of lamps, the values of ``--set``.

    Args:
        texts: ``NAME=DIMMER`` or ``NAME=RED,GREEN,BLUE``, factors of the lamp's own light, ≥ 0.

    Returns:
        Red, green and blue factor by name.

    Raises:
        ValueError: A text has another form.
    """
    found = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        try:
            numbers = [float(word) for word in value.split(",")]
        except ValueError:
            numbers = []
        if not name or len(numbers) not in (1, 3) or not all(0 <= number < math.inf for number in numbers):
            raise ValueError(
                f"set: '{text[:80]}' is not NAME=DIMMER; write for example --set desk=0.3 or desk=1,0.8,0.6"
            )
        red, green, blue = numbers * 3 if len(numbers) == 1 else numbers
        found[name] = (red, green, blue)
    return found


def parse_day(texts: Sequence[str]) -> tuple[float | None, list[str]]:
    """Read the time of day among the values of ``--set``.

    Args:
        texts: ``day=18:30``, and settings of lamps.

    Returns:
        Hours of the last one; None without. And the other texts.

    Raises:
        ValueError: It is no time of day.
    """
    hour, others = None, []
    for text in texts:
        name, equals, value = text.partition("=")
        if name.strip() != DAY or not equals:
            others.append(text)
            continue
        try:
            hour = parse_clock(value)
        except ValueError as error:
            raise ValueError(f"set: {error}") from None
    return hour, others


def parse_lamps(texts: Sequence[str]) -> LampRules:
    """Read the values of ``--lamps``.

    Args:
        texts: ``NAME=PATTERN`` or ``NAME=PATTERN,PATTERN``, and at most one of ``MODES``.

    Returns:
        The rules; lights that no rule names are one group where there are rules and no mode.

    Raises:
        ValueError: A text has another form, there is more than one mode, or 'none' beside a rule.
    """
    rules, modes = [], []
    for text in map(str.strip, texts):
        name, equals, patterns = (part.strip() for part in text.partition("="))
        if not equals and name in MODES:
            modes.append(name)
            continue
        found = tuple(pattern.strip() for pattern in patterns.split(",") if pattern.strip())
        if not equals or not _NAME.match(name) or not found:
            raise ValueError(f"lamps: '{text[:80]}' is not NAME=PATTERN; {_EXAMPLE}")
        rules.append(LampRule(name, found))
    if len(modes) > 1:
        raise ValueError(f"lamps: {' and '.join(modes)} group the same lights; give one of them")
    if rules and modes == ["none"]:
        # Light without a switch would be in no group, and so in no field.
        raise ValueError(
            f"lamps: none leaves no light a switch, {rules[0].name} has one; leave out none: what no rule names is the "
            "group 'others'"
        )
    return LampRules(modes[0] if modes else "all" if rules else "name", tuple(rules), bool(texts))
