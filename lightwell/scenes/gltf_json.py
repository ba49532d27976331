"""Typed access to the JSON of a glTF file, which may be hostile: each look-up is checked and says where it looked."""

from __future__ import annotations

import math
from typing import Any, NoReturn

from lightwell.scenes.errors import SceneError

CURE = "the file is truncated or damaged, export it again"


class Place:
    """A JSON object and how messages call it: ``scene 'room.glb': accessor 7``."""

    def __init__(self, scene: str, what: str, value: Any):
        self.scene, self.what = scene, what
        if not isinstance(value, dict):
            self.fail(f"is {_shown(value)}, expected an object")
        self.value: dict[str, Any] = value

    def fail(self, problem: str, cure: str = CURE) -> NoReturn:
        """Raise a SceneError about this place."""
        raise SceneError(f"scene '{self.scene}': {self.what} {problem}; {cure}")

    def __contains__(self, key: str) -> bool:
        return key in self.value

    def integer(self, key: str, default: int | None = None, low: int = 0, high: int = 2**53) -> int:
        """A whole number in low … high; without a default it must be there."""
        number = self.value.get(key, default)
        if isinstance(number, float) and number.is_integer():
            number = int(number)
        if isinstance(number, bool) or not isinstance(number, int) or not low <= number <= high:
            wanted = f"in {low}..{high}" if high < 2**53 else f">= {low}"
            self.fail(f"has {key} {_shown(number)}, expected a whole number {wanted}")
        return number

    def number(self, key: str, default: float | None = None, low: float = -math.inf) -> float:
        """A finite number, at least ``low``."""
        number = self.value.get(key, default)
        if not _is_finite(number) or number < low:
            self.fail(
                f"has {key} {_shown(number)}, expected a finite number" + (f" >= {low:g}" if low > -math.inf else "")
            )
        return float(number)

    def numbers(self, key: str, count: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """``count`` finite numbers."""
        if default is not None and key not in self.value:
            return default
        values = self.value.get(key)
        if not isinstance(values, list) or len(values) != count or not _are_finite(values):
            self.fail(f"has {key} {_shown(values)}, expected {count} finite numbers")
        return tuple(map(float, values))

    def text(self, key: str, default: str | None = None) -> str:
        """A string."""
        value = self.value.get(key, default)
        if not isinstance(value, str):
            self.fail(f"has {key} {_shown(value)}, expected text")
        return value

    def flag(self, key: str) -> bool:
        """A boolean, False when absent."""
        value = self.value.get(key, False)
        if not isinstance(value, bool):
            self.fail(f"has {key} {_shown(value)}, expected true or false")
        return value

    def texts(self, key: str) -> list[str]:
        """A list of strings, empty when absent."""
        values = self.items(key)
        for value in values:
            if not isinstance(value, str):
                self.fail(f"has {_shown(value)} in {key}, expected text")
        return values

    def place(self, key: str) -> Place | None:
        """The object under ``key`` or None."""
        return Place(self.scene, f"{self.what} {key}", self.value[key]) if key in self.value else None

    def keys(self, key: str) -> list[str]:
        """Names in the object under ``key``, in order; empty when absent."""
        inner = self.place(key)
        return list(inner.value) if inner else []

    def need(self, key: str) -> Place:
        """The object under ``key``, which must be there."""
        return self.place(key) or self.fail(f"has no {key}")

    def extension(self, name: str) -> Place | None:
        """The object of an extension or None."""
        extensions = self.place("extensions")
        return extensions.place(name) if extensions else None

    def items(self, key: str) -> list[Any]:
        """The list under ``key``, empty when absent."""
        value = self.value.get(key, [])
        if not isinstance(value, list):
            self.fail(f"has {key} {_shown(value)}, expected a list")
        return value

    def indices(self, key: str, limit: int, of: str) -> list[int]:
        """A list of indices below ``limit``."""
        values = self.items(key)
        for value in values:
            if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < limit:
                self.fail(f"names {of} {_shown(value)}, but there are {limit}")
        return values

    def index(self, key: str, limit: int, of: str) -> int | None:
        """An index below ``limit``, or None when absent."""
        if key not in self.value:
            return None
        value = self.integer(key)
        if value >= limit:
            self.fail(f"names {of} {value}, but there are {limit}")
        return value


def _are_finite(values: list[Any]) -> bool:
    """``_is_finite`` of all; a scene has millions of numbers, so that the common case is decided without a loop."""
    if {*map(type, values)} == {float}:
        return all(map(math.isfinite, values))
    return all(map(_is_finite, values))


def _is_finite(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    # A JSON integer may be too long for a float.
    return abs(value) < 1e300 if isinstance(value, int) else math.isfinite(value)


def _shown(value: Any) -> str:
    if value is None:
        return "missing"
    text = repr(value) if not isinstance(value, int) or abs(value) < 10**30 else "a huge number"
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= 40 else text[:37] + "..."
