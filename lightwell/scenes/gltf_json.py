"""Typed access to the JSON of a glTF file, which may be hostile: accesses are checked, and errors name the element."""

from __future__ import annotations

import math
from typing import Any, NoReturn

from lightwell.scenes.errors import SceneError

CURE = "the file is truncated or damaged, export it again"


class Place:
    """A JSON object and its name in messages: ``scene 'room.glb': accessor 7``.

    All methods raise ``SceneError`` when a value is missing or has another type than expected.
    """

    def __init__(self, scene: str, what: str, value: Any) -> None:
        """Wrap a JSON value, which must be an object.

        Args:
            scene: Name of the file in messages.
            what: Name of the element in messages.
            value: The JSON value.
        """
        self.scene, self.what = scene, what
        if not isinstance(value, dict):
            self.fail(f"is {_shown(value)}, expected an object")
        self.value: dict[str, Any] = value

    def fail(self, problem: str, cure: str = CURE) -> NoReturn:
        """Raise an error about this element.

        Args:
            problem: What is wrong.
            cure: What the user can do.

        Raises:
            SceneError: Always.
        """
        raise SceneError(f"scene '{self.scene}': {self.what} {problem}; {cure}")

    def __contains__(self, key: str) -> bool:
        return key in self.value

    def integer(self, key: str, default: int | None = None, low: int = 0, high: int = 2**53) -> int:
        """Read a whole number.

        Args:
            key: Name of the property.
            default: Value when it is missing; None: it is required.
            low: Least allowed value.
            high: Largest allowed value.

        Returns:
            The number.
        """
        number = self.value.get(key, default)
        if isinstance(number, float) and number.is_integer():
            number = int(number)
        if isinstance(number, bool) or not isinstance(number, int) or not low <= number <= high:
            wanted = f"in {low}..{high}" if high < 2**53 else f">= {low}"
            self.fail(f"has {key} {_shown(number)}, expected a whole number {wanted}")
        return number

    def number(self, key: str, default: float | None = None, low: float = -math.inf) -> float:
        """Read a finite number.

        Args:
            key: Name of the property.
            default: Value when it is missing; None: it is required.
            low: Least allowed value.

        Returns:
            The number.
        """
        number: Any = self.value.get(key, default)
        if not _is_finite(number) or number < low:
            self.fail(
                f"has {key} {_shown(number)}, expected a finite number" + (f" >= {low:g}" if low > -math.inf else "")
            )
        return float(number)

    def numbers(self, key: str, count: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """Read a list of finite numbers.

        Args:
            key: Name of the property.
            count: Expected length.
            default: Value when it is missing; None: it is required.

        Returns:
            The numbers.
        """
        if default is not None and key not in self.value:
            return default
        values = self.value.get(key)
        if not isinstance(values, list) or len(values) != count or not _are_finite(values):
            self.fail(f"has {key} {_shown(values)}, expected {count} finite numbers")
        return tuple(map(float, values))

    def text(self, key: str, default: str | None = None) -> str:
        """Read a string.

        Args:
            key: Name of the property.
            default: Value when it is missing; None: it is required.

        Returns:
            The string.
        """
        value = self.value.get(key, default)
        if not isinstance(value, str):
            self.fail(f"has {key} {_shown(value)}, expected text")
        return value

    def flag(self, key: str) -> bool:
        """Read a boolean.

        Args:
            key: Name of the property.

        Returns:
            Its value; False when it is missing.
        """
        value = self.value.get(key, False)
        if not isinstance(value, bool):
            self.fail(f"has {key} {_shown(value)}, expected true or false")
        return value

    def place(self, key: str) -> Place | None:
        """Read an object.

        Args:
            key: Name of the property.

        Returns:
            The object, or None when it is missing.
        """
        return Place(self.scene, f"{self.what} {key}", self.value[key]) if key in self.value else None

    def need(self, key: str) -> Place:
        """Read a required object.

        Args:
            key: Name of the property.

        Returns:
            The object.
        """
        return self.place(key) or self.fail(f"has no {key}")

    def extension(self, name: str) -> Place | None:
        """Read the object of an extension.

        Args:
            name: Name of the extension.

        Returns:
            The object, or None when it is missing.
        """
        extensions = self.place("extensions")
        return extensions.place(name) if extensions else None

    def items(self, key: str) -> list[Any]:
        """Read a list.

        Args:
            key: Name of the property.

        Returns:
            The list; empty when it is missing.
        """
        value = self.value.get(key, [])
        if not isinstance(value, list):
            self.fail(f"has {key} {_shown(value)}, expected a list")
        return value

    def indices(self, key: str, limit: int, of: str) -> list[int]:
        """Read a list of indices.

        Args:
            key: Name of the property.
            limit: Number of elements that can be referred to.
            of: Kind of these elements, for messages.

        Returns:
            Indices in [0, limit); empty when it is missing.
        """
        values = self.items(key)
        for value in values:
            if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < limit:
                self.fail(f"names {of} {_shown(value)}, but there are {limit}")
        return values

    def index(self, key: str, limit: int, of: str) -> int | None:
        """Read an index.

        Args:
            key: Name of the property.
            limit: Number of elements that can be referred to.
            of: Kind of these elements, for messages.

        Returns:
            Index in [0, limit), or None when it is missing.
        """
        if key not in self.value:
            return None
        value = self.integer(key)
        if value >= limit:
            self.fail(f"names {of} {value}, but there are {limit}")
        return value


def texts(place: Place, key: str) -> list[str]:
    """Read a list of strings.

    Args:
        place: Object that holds the list.
        key: Name of the property.

    Returns:
        The strings; empty when it is missing.
    """
    values = place.items(key)
    for value in values:
        if not isinstance(value, str):
            place.fail(f"has {_shown(value)} in {key}, expected text")
    return values


def _are_finite(values: list[Any]) -> bool:
    """Apply ``_is_finite`` to all numbers; the common case needs no loop, because scenes have millions of numbers."""
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
