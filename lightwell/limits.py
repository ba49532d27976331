"""How much a file may ask for: one record of limits, and a budget that is charged before memory is allocated.

    limits = Limits.parse(["vertices=5e7"])              # --limit vertices=5e7
    budget = limits.budget("scene 'room.glb'")
    budget.charge("vertices", count, "mesh 3")           # sums up over the whole document
    budget.check("picture_edge", width, "image 2")       # one thing alone

A small file can describe a scene that no machine holds. Readers of every format count what a document asks for with one
``Budget`` and stop with one line before they allocate; ``--limit NAME=VALUE`` raises a limit for a trusted file.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace


@dataclass(frozen=True)
class Limits:
    """What one document may ask for, all its files together.

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
        """Read limits from texts ``NAME=VALUE``; what is not named keeps its default.

        Raises:
            ValueError: A text is not of this form, or names no limit.
        """
        changed: dict[str, float] = {}
        for text in texts:
            name, equals, value = text.partition("=")
            if name not in NAMES or not equals:
                raise ValueError(f"limit: '{text[:60]}' is not NAME=VALUE; names are {', '.join(NAMES)}")
            try:
                number = float(value)
            except ValueError:
                number = math.nan
            if not 0 < number < math.inf:
                raise ValueError(f"limit: '{text[:60]}': expected a number above 0, such as --limit {name}=1e8")
            changed[name] = number if name == "seconds" else int(number)
        return replace(cls(), **changed)

    def budget(self, where: str, error: type[ValueError] = ValueError) -> Budget:
        """Start counting for one document. ``where`` begins its messages, ``error`` is what a breach raises."""
        return Budget(self, where, error)


NAMES = tuple(field.name for field in fields(Limits))
DEFAULT_LIMITS = Limits()

# How messages call what is counted.
_CALLED = {
    "file_bytes": "bytes in files",
    "decoded_bytes": "bytes when unpacked",
    "picture_edge": "texels along an edge of a picture",
    "picture_texels": "texels in one picture",
    "depth": "levels of nodes",
}


class Budget:
    """Counts what one document asks for; a breach is one line that names file, thing, limit and cure."""

    def __init__(self, limits: Limits, where: str, error: type[ValueError] = ValueError):
        self.limits, self.where = limits, where
        self._error = error
        self._spent = dict.fromkeys(NAMES, 0)
        self._begin = time.monotonic()

    def charge(self, name: str, amount: int, what: str = "") -> None:
        """Add ``amount`` to a sum over the document; call this before the memory is allocated.

        Args:
            name: A field of ``Limits``.
            amount: ≥ 0.
            what: The part of the document that asks, for the message; default the document itself.

        Raises:
            ValueError: The sum is above the limit (or the subclass that the budget was made with).
        """
        self._spent[name] += amount
        self.check(name, self._spent[name], what)

    def check(self, name: str, amount: float, what: str = "") -> None:
        """Compare one thing with its limit, without adding it up; raises as ``charge``."""
        limit = getattr(self.limits, name)
        if amount > limit:
            place = f"{self.where}: {what}" if what else self.where
            called = _CALLED.get(name, name)
            raise self._error(
                f"{place}: {_shown(amount)} {called}, more than the limit of {_shown(limit)}; make it smaller or raise "
                f"the limit of a file that you trust with --limit {name}={_rounded_up(amount):g}"
            )

    def check_picture(self, width: int, height: int, what: str) -> None:
        """Check one picture's size and add its texels, before it is decoded; raises as ``charge``."""
        self.check("picture_edge", max(width, height), what)
        self.check("picture_texels", width * height, what)
        self.charge("texels", width * height, what)

    def check_time(self, what: str = "") -> None:
        """Stop when reading has taken too long; raises as ``charge``."""
        self.check("seconds", time.monotonic() - self._begin, what)

    def spent(self, name: str) -> int:
        """The sum so far."""
        return self._spent[name]


def _shown(amount: float) -> str:
    return f"{amount:.3g}" if isinstance(amount, float) else str(amount)


def _rounded_up(amount: float) -> float:
    """The next number with two digits, so that the value in a message is one that works."""
    step = 10 ** max(math.floor(math.log10(amount)) - 1, 0)
    return math.ceil(amount / step) * step
