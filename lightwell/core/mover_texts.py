"""Declarations and settings of what moves: ``node:Door.rotation=y:0..110``, ``animation:Open=0..1``.

Imports nothing slow.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

ROTATION_EXAMPLE = '"node:Door.rotation=y:0..110"'
TRANSLATION_EXAMPLE = '"node:Door.translation=(0,0,0)..(0,0,1.2)"'
_SET_EXAMPLE = (
    'write for example --set "node:Door.rotation=45", "node:Door.rotation=x:45" or "node:Door.translation=(0,0,0.6)"'
)
_SET_CLIP = 'write for example --set "animation:Open=0.5", a share of the clip'
MoverPath = Literal["rotation", "translation", "animation"]
_NODE = re.compile(r"\s*node:(?P<name>.+)\.(?P<path>rotation|translation)\s*=(?P<value>[^=]*)", re.DOTALL)
CLIP_EXAMPLE = '"animation:Open=0..1"'
_CLIP = re.compile(r"\s*animation:(?P<name>.+?)\s*=(?P<value>[^=]*)", re.DOTALL)
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
# Longest turn, degrees: a whole one.
MOST_DEGREES = 360.0
# Ranges that are shorter, in degrees or metres, are empty.
SHORTEST = 1e-4

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class MoverText:
    """What was written of a node or a clip."""

    name: str
    """Name of the node or clip."""
    path: MoverPath
    values: tuple[float, ...]
    """Rotation: axis (3), first and last angle, degrees. Translation: first and last offset (3 each), metres.
    Animation: first and last share of the clip."""

    @property
    def what(self) -> str:
        """The text without its value."""
        return _what(self.name, self.path)


@dataclass(frozen=True)
class MoverState:
    """A setting of a node or a clip, for pictures."""

    name: str
    path: MoverPath
    axis: Triple | None
    """Axis of a rotation; None: that of its declaration, else y."""
    value: float | None
    """Degrees, metres from the first offset of the declaration, or a share of the clip; None: ``offset``."""
    offset: Triple | None = None
    """Translation by a vector, metres."""

    @property
    def what(self) -> str:
        """The text without its value."""
        return _what(self.name, self.path)


def _what(name: str, path: MoverPath) -> str:
    return f"animation:{name}" if path == "animation" else f"node:{name}.{path}"


def is_mover(text: str) -> bool:
    """Test whether a declaration or a setting is of a node or a clip.

    Args:
        text: Value of ``--vary`` or ``--set``.

    Returns:
        True for ``node:…`` and ``animation:…``.
    """
    return text.strip().startswith(("node:", "animation:"))


def parse_mover(text: str) -> MoverText:
    """Parse the declaration of a node or a clip.

    Args:
        text: ``node:NAME.rotation=AXIS:FROM..TO`` in degrees from the pose of the file, about an axis of the node;
            ``node:NAME.translation=(x,y,z)..(x,y,z)`` in metres, along the axes of its parent; or
            ``animation:NAME=FROM..TO``, shares of a clip of the file.

    Returns:
        The declaration.

    Raises:
        ValueError: The text has another form, or the range is empty.
    """
    name, path, value = _parts(text, "vary")
    if path == "animation":
        return MoverText(name, path, _shares(text, value))
    if path == "rotation":
        axis, span = _axis(value)
        ends = span.split("..", 1)
        low, high = (_number(end) for end in ends) if len(ends) == 2 else (math.nan, math.nan)
        if axis is None or not math.isfinite(low + high):
            raise ValueError(
                f"vary: '{text[:120]}': expected AXIS:FROM..TO in degrees; write for example {ROTATION_EXAMPLE}"
            )
        if abs(high - low) < SHORTEST:
            raise ValueError(f"vary: '{text[:120]}': the range is empty; write for example {ROTATION_EXAMPLE}")
        if abs(high - low) > MOST_DEGREES:
            raise ValueError(f"vary: '{text[:120]}': more than a whole turn; give at most {MOST_DEGREES:g} degrees")
        return MoverText(name, "rotation", (*axis, low, high))
    corners = [_triple(end) for end in value.split("..", 1)] if ")..(" in value.replace(" ", "") else []
    if len(corners) != 2 or corners[0] is None or corners[1] is None:
        raise ValueError(
            f"vary: '{text[:120]}': expected (x,y,z)..(x,y,z) in metres; write for example {TRANSLATION_EXAMPLE}"
        )
    if math.dist(corners[0], corners[1]) < SHORTEST:
        raise ValueError(f"vary: '{text[:120]}': the range is empty; write for example {TRANSLATION_EXAMPLE}")
    return MoverText(name, "translation", (*corners[0], *corners[1]))


def _shares(text: str, value: str) -> tuple[float, float]:
    """First and last share of a clip."""
    ends = [_number(end) for end in value.split("..", 1)]
    if len(ends) != 2 or not all(0 <= end <= 1 for end in ends):
        raise ValueError(
            f"vary: '{text[:120]}': expected FROM..TO, shares of the clip from 0 to 1; write for example {CLIP_EXAMPLE}"
        )
    if abs(ends[1] - ends[0]) < SHORTEST:
        raise ValueError(f"vary: '{text[:120]}': the range is empty; write for example {CLIP_EXAMPLE}")
    return ends[0], ends[1]


def parse_movers(texts: Sequence[str]) -> tuple[list[MoverState], list[str]]:
    """Read the settings of nodes and clips among the values of ``--set``.

    Args:
        texts: ``node:NAME.rotation=45``, ``node:NAME.translation=(0,0,0.6)``, ``animation:NAME=0.5``, and others.

    Returns:
        The settings of what moves, and the other texts.

    Raises:
        ValueError: A setting has another form, or there are two of one node or clip.
    """
    found, others = [], []
    for text in texts:
        if is_mover(text):
            found.append(_state(text))
        else:
            others.append(text)
    names = [state.name for state in found]
    twice = next((state for k, state in enumerate(found) if state.name in names[:k]), None)
    if twice:
        raise ValueError(f"set: '{twice.name}' is set twice; leave out one --set '{twice.what}=…'")
    return found, others


def _state(text: str) -> MoverState:
    name, path, value = _parts(text, "set")
    if path == "animation":
        share = _number(value)
        if not 0 <= share <= 1:
            raise ValueError(f"set: '{text[:120]}' is no share from 0 to 1; {_SET_CLIP}")
        return MoverState(name, path, None, share)
    if path == "rotation":
        axis, angle = _axis(value) if ":" in value else (None, value)
        degrees = _number(angle)
        if (":" in value and axis is None) or not math.isfinite(degrees):
            raise ValueError(f"set: '{text[:120]}' is no angle in degrees; {_SET_EXAMPLE}")
        return MoverState(name, "rotation", axis, degrees)
    offset, metres = _triple(value), _number(value)
    if offset is None and not math.isfinite(metres):
        raise ValueError(f"set: '{text[:120]}' is no offset in metres; {_SET_EXAMPLE}")
    return MoverState(name, "translation", None, None if offset else metres, offset)


def _parts(text: str, option: str) -> tuple[str, MoverPath, str]:
    """Name, path and value of a text that begins with ``node:`` or ``animation:``."""
    if text.strip().startswith("animation:"):
        clip = _CLIP.fullmatch(text)
        if not clip:
            example = f"write for example {CLIP_EXAMPLE}" if option == "vary" else _SET_CLIP
            raise ValueError(f"{option}: '{text[:120]}': expected animation:NAME=…; {example}")
        return clip["name"].strip(), "animation", clip["value"].strip()
    match = _NODE.fullmatch(text)
    if not match:
        example = f"write for example {ROTATION_EXAMPLE}" if option == "vary" else _SET_EXAMPLE
        raise ValueError(
            f"{option}: '{text[:120]}': expected node:NAME.rotation=… or node:NAME.translation=…; {example}"
        )
    return match["name"].strip(), match["path"], match["value"].strip()  # type: ignore[return-value]


def _axis(value: str) -> tuple[Triple | None, str]:
    """Unit axis before the colon, None where it is none; and the rest."""
    word, _, rest = (part.strip() for part in value.partition(":"))
    sign = -1.0 if word.startswith("-") else 1.0
    axis = _AXES.get(word.lstrip("+-").lower())
    if axis is None:
        found = _triple(word)
        length = math.hypot(*found) if found else 0.0
        return (None if not found or not length else tuple(c / length for c in found)), rest  # type: ignore[return-value]
    return (sign * axis[0], sign * axis[1], sign * axis[2]), rest


def _number(text: str) -> float:
    """The finite number of a text; NaN where it is none."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _triple(text: str) -> Triple | None:
    """Three finite numbers in parentheses; None where there are none."""
    match = re.fullmatch(r"\s*\(([^()]*)\)\s*", text)
    numbers = [_number(word) for word in match.group(1).split(",")] if match else []
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        return None
    return numbers[0], numbers[1], numbers[2]
