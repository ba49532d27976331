"""Limits on what an input file may request, and a budget that is charged before memory is allocated.

    limits = Limits.parse(["vertices=5e7"])              # --limit vertices=5e7
    budget = limits.budget("scene 'room.glb'")
    budget.charge("vertices", count, "mesh 3")           # added up over the whole document
    budget.check("picture_edge", width, "image 2")       # one value alone

A small file can describe a scene that no machine can hold. The readers of every format count what a document requests
in one ``LoadBudget`` and stop with a one-line error before they allocate; ``--limit NAME=VALUE`` raises a limit for a
trusted file.
"""

from __future__ import annotations

import difflib
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NoReturn


@dataclass(frozen=True)
class Limits:
    """Limits for one document and all the files that it names.

    The defaults allow a scene of 5 million triangles that share no vertex, with 64 textures of 4096 x 4096 texels.
    """

    file_bytes: int = 8 << 30
    """Bytes read from the document and the files that it names."""
    decoded_bytes: int = 2 << 30
    """Bytes that compressed or packed data other than pictures unpack to (meshopt, Draco, zip members, JSON text)."""
    texels: int = 1_200_000_000
    """Texels of all pictures together; a picture counts once, however often it is named."""
    picture_edge: int = 16_384
    """Texels along the longer edge of one picture."""
    picture_texels: int = 16_384 * 8_192
    """Texels of one picture."""
    vertices: int = 32_000_000
    """Vertices, those of instances included."""
    indices: int = 96_000_000
    """Vertex indices (three a triangle), those of instances included."""
    nodes: int = 500_000
    """Nodes of a scene graph, or elements of an XML document."""
    depth: int = 500_000
    """Levels of a scene graph."""
    instances: int = 500_000
    """Meshes placed in the world: each node with a mesh, each instance of an instanced node."""
    lights: int = 10_000
    """Lights of a scene other than emissive meshes."""
    work: int = 100_000
    """Operations per pixel of all learned fields of an asset (format/FORMAT.md, *Budget*)."""
    seconds: float = 300.0
    """Seconds that reading the document may take; checked between its parts."""

    def __post_init__(self) -> None:
        for name in NAMES:
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < math.inf:
                raise ValueError(f"limit: {name} is {value!r}, expected a number above 0")

    @classmethod
    def parse(cls, texts: Sequence[str]) -> Limits:
        """Parse limits written as ``NAME=VALUE``; limits that are not named keep their default.

        Args:
            texts: For example ``["vertices=5e7", "seconds=60"]``; values are > 0.

        Returns:
            The limits.

        Raises:
            ValueError: A text does not have this form, names no limit, or its value is not a number above 0.
        """
        changed: dict[str, Any] = {}
        for text in texts:
            name, equals, value = text.partition("=")
            if name not in NAMES or not equals:
                near = [] if name in NAMES else difflib.get_close_matches(name, NAMES, 1)
                cure = f"did you mean '{near[0]}'?" if near else f"write NAME=VALUE with one of {', '.join(NAMES)}"
                raise ValueError(f"'{text[:60]}' is no limit: {cure}")
            try:
                number = float(value)
            except ValueError:
                number = math.nan
            if not 0 < number < math.inf:
                raise ValueError(f"'{text[:60]}' is no limit: expected a number above 0, such as --limit {name}=1e8")
            changed[name] = number if name == "seconds" else int(number)
        return replace(cls(), **changed)

    def budget(self, where: str, error: type[ValueError] = ValueError) -> LoadBudget:
        """Start counting for one document.

        Args:
            where: Beginning of the budget's messages, for example ``scene 'room.glb'``.
            error: Type of the error that an exceeded limit raises.

        Returns:
            A budget of which nothing is used.
        """
        return LoadBudget(self, where, error)


# Memory that parsed JSON takes, in bytes per byte of text (measured on lists of small nodes and of numbers).
JSON_EXPANSION = 8
NAMES = tuple(field.name for field in fields(Limits))
DEFAULT_LIMITS = Limits()

# Wording of messages for fields whose name alone is unclear.
_CALLED = {
    "file_bytes": "bytes in files",
    "decoded_bytes": "bytes when unpacked",
    "picture_edge": "texels along an edge of a picture",
    "picture_texels": "texels in one picture",
    "depth": "levels of nodes",
}


class LoadBudget:
    """Counts what one document requests.

    An exceeded limit raises a one-line error with the file, the part, the limit and the cure.
    """

    def __init__(self, limits: Limits, where: str, error: type[ValueError] = ValueError) -> None:
        """Start counting.

        Args:
            limits: The limits.
            where: Beginning of the messages.
            error: Type of the error that an exceeded limit raises.
        """
        self.limits, self.where = limits, where
        self._error = error
        self._spent = dict.fromkeys(NAMES, 0)
        self._begin = time.monotonic()

    def charge(self, name: str, amount: int, what: str = "") -> None:
        """Add an amount to a sum over the document; call this before the memory is allocated.

        A sum above its limit raises the error type of the budget.

        Args:
            name: Name of a field of ``Limits``.
            amount: Amount to add, ≥ 0, in the unit of the field.
            what: Part of the document that requests it, for the message; empty for the document itself.
        """
        self._spent[name] += amount
        self.check(name, self._spent[name], what)

    def check(self, name: str, amount: float, what: str = "") -> None:
        """Compare one value with its limit, without adding it to a sum.

        A value above the limit raises the error type of the budget, ``ValueError`` by default.

        Args:
            name: Name of a field of ``Limits``.
            amount: The value, in the unit of the field.
            what: Part of the document that requests it, for the message; empty for the document itself.
        """
        limit = getattr(self.limits, name)
        if amount > limit:
            self._exceeded(name, amount, limit, what)

    def _exceeded(self, name: str, amount: float, limit: float, what: str) -> NoReturn:
        place = f"{self.where}: {what}" if what else self.where
        called = _CALLED.get(name, name)
        raise self._error(
            f"{place}: {_shown(amount)} {called}, more than the limit of {_shown(limit)}; make it smaller or raise "
            f"the limit of a file that you trust with --limit {name}={_rounded_up(amount):g}"
        )

    def check_picture(self, width: int, height: int, what: str) -> None:
        """Check the size of a picture and add its texels to their sum, before the picture is decoded.

        An exceeded limit raises the error type of the budget.

        Args:
            width: Texels.
            height: Texels.
            what: Name of the picture, for the message.
        """
        self.check("picture_edge", max(width, height), what)
        self.check("picture_texels", width * height, what)
        self.charge("texels", width * height, what)

    def check_time(self, what: str = "") -> None:
        """Compare the time since the budget was made with its limit, which raises the error type of the budget.

        Args:
            what: Part of the document that is being read, for the message.
        """
        self.check("seconds", time.monotonic() - self._begin, what)

    def spent(self, name: str) -> int:
        """Return the sum of all amounts charged so far.

        Args:
            name: Name of a field of ``Limits``.

        Returns:
            The sum, in the unit of the field.
        """
        return self._spent[name]


def _shown(amount: float) -> str:
    return f"{amount:.3g}" if isinstance(amount, float) else str(amount)


def _rounded_up(amount: float) -> float:
    """Round up to two significant digits, so that the value suggested in a message is sufficient."""
    step = 10 ** max(math.floor(math.log10(amount)) - 1, 0)
    return math.ceil(amount / step) * step
