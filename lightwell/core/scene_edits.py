"""Edits of a scene that its file does not have: surfaces moved, lamps dimmed, materials painted.

The live page makes them, and a bake of what it shows takes them over (``lightwell.scenes.edits``).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

Triple = tuple[float, float, float]
# Least roughness that can be painted: smaller lobes cannot be found by light sampling.
LEAST_ROUGHNESS = 0.05
# Limits of a file of edits: its size, and the magnitude of its numbers (metres, factors).
MOST_BYTES, FARTHEST = 1 << 22, 1e9


@dataclass(frozen=True)
class Paint:
    """New properties of a material."""

    color: Triple | None = None
    """Linear colour in [0, 1] that replaces a constant one and multiplies a texture; None: as it is."""
    roughness: float | None = None
    """Roughness in [``LEAST_ROUGHNESS``, 1]; None: as it is."""


@dataclass(frozen=True)
class SceneEdits:
    """Edits by the index of a mesh or material."""

    moved: Mapping[int, Triple] = field(default_factory=dict)
    """Mesh to its translation, metres."""
    dimmed: Mapping[int, float] = field(default_factory=dict)
    """Mesh to the factor of its emission, ≥ 0."""
    painted: Mapping[int, Paint] = field(default_factory=dict)
    """Material to its new properties."""

    def __bool__(self) -> bool:
        return bool(self.moved or self.dimmed or self.painted)

    def to_json(self) -> str:
        """Write the edits as text.

        Returns:
            JSON text for ``from_json``.
        """
        painted = {str(k): asdict(paint) for k, paint in sorted(self.painted.items())}
        moved = {str(k): list(by) for k, by in sorted(self.moved.items())}
        dimmed = {str(k): factor for k, factor in sorted(self.dimmed.items())}
        return json.dumps({"moved": moved, "dimmed": dimmed, "painted": painted})

    @staticmethod
    def from_json(text: str | bytes) -> SceneEdits:
        """Read the edits that ``to_json`` wrote.

        Args:
            text: JSON text.

        Returns:
            The edits.

        Raises:
            ValueError: It is not such a text; one line.
        """
        try:
            read = json.loads(text)
            if set(read) - {"moved", "dimmed", "painted"}:
                raise ValueError("a name is unknown")
            moved = {_index(k): _triple(by, -FARTHEST, FARTHEST) for k, by in read.get("moved", {}).items()}
            dimmed = {_index(k): _number(f, 0, FARTHEST) for k, f in read.get("dimmed", {}).items()}
            painted = {_index(k): _paint(p) for k, p in read.get("painted", {}).items()}
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise ValueError("this is no file that 'lightwell live' wrote; bake from its page again") from None
        return SceneEdits(moved, dimmed, painted)


def read_edits(path: str) -> SceneEdits:
    """Read a file of edits.

    Args:
        path: Its path.

    Returns:
        The edits.

    Raises:
        ValueError: It cannot be read, is larger than ``MOST_BYTES``, or holds no edits; one line.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        cure = "name the edits.json of a bake of 'lightwell live'"
        raise ValueError(f"'{path}': {error.strerror}; {cure}") from error
    if len(data) > MOST_BYTES:
        raise ValueError(f"'{path}': larger than {MOST_BYTES >> 20} MiB, which no page writes")
    try:
        return SceneEdits.from_json(data)
    except ValueError as error:
        raise ValueError(f"'{path}': {error}") from None


def _index(text: str) -> int:
    if not text.isdecimal():
        raise ValueError(text)
    return int(text)


def _number(value: Any, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise ValueError(value)
    return float(value)


def _triple(values: Any, low: float, high: float) -> Triple:
    x, y, z = (_number(v, low, high) for v in values)
    return x, y, z


def _paint(entry: Any) -> Paint:
    color, roughness = entry["color"], entry["roughness"]
    return Paint(
        None if color is None else _triple(color, 0, 1),
        None if roughness is None else _number(roughness, LEAST_ROUGHNESS, 1),
    )
