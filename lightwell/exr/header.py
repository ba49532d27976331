"""Parse and check the header of an EXR file without decoding pixels.

Layout: https://openexr.com/en/latest/OpenEXRFileLayout.html. Notation: a part of W x H pixels in C chunks.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

MAGIC, VERSION = 20000630, 2
# Flags of the version field.
TILED, LONG_NAMES, DEEP, MULTIPART = 0x200, 0x400, 0x800, 0x1000
KNOWN_FLAGS = TILED | LONG_NAMES | DEEP | MULTIPART
# Largest accepted: bytes of all headers and of a name; numbers of attributes, parts and channels.
# OpenEXR itself limits only names (255).
MOST_HEADER, MOST_NAME, MOST_ATTRIBUTES, MOST_PARTS, MOST_CHANNELS = 1 << 24, 255, 4096, 256, 1024
# Largest coordinate of a window, as in OpenEXR (INT_MAX / 2).
MOST_COORDINATE = 1 << 30
# Bytes of a value by pixel type: uint, half, float.
PIXEL_BYTES = {0: 4, 1: 2, 2: 4}
# Scan lines in a chunk by compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB, HTJ2K256, HTJ2K32,
# LJ2K, ZSTD.
CHUNK_LINES = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256, 10: 256, 11: 32, 12: 256, 13: 1}
KINDS = ("scanlineimage", "tiledimage", "deepscanline", "deeptile")

Attributes = dict[str, tuple[str, bytes]]
Window = tuple[int, int, int, int]


class ExrError(ValueError):
    """The file is damaged or not an EXR file; the text is the cause, without the file's name."""


@dataclass(frozen=True)
class Channel:
    """One channel of a part."""

    name: str
    pixel_type: int
    """0 uint, 1 half, 2 float."""
    sampling: tuple[int, int]
    """Every n-th pixel along x and y has a value."""


@dataclass(frozen=True)
class ExrTiles:
    """How a part is cut into tiles."""

    width: int
    height: int
    levels: int
    """0 one, 1 mipmap, 2 ripmap."""
    round_up: bool


@dataclass(frozen=True)
class ExrPart:
    """One part of a file."""

    name: str
    view: str
    kind: str
    """One of ``KINDS``."""
    channels: tuple[Channel, ...]
    window: Window
    """x0, y0, width, height of the pixels that the file holds."""
    display: Window
    """x0, y0, width, height of the picture that is shown."""
    compression: int
    tiles: ExrTiles | None
    chunks: int
    """Entries of its chunk offset table."""
    samples: int = 0
    """Samples of a deep part, of all channels together, as its chunks state; 0 until they are read."""

    @property
    def deep(self) -> bool:
        """Whether a pixel holds a list of samples."""
        return self.kind.startswith("deep")


@dataclass(frozen=True)
class Header:
    """Everything before the chunk offset tables."""

    parts: tuple[ExrPart, ...]
    multipart: bool
    """Whether every chunk begins with the number of its part."""
    length: int
    """Bytes; the chunk offset tables follow."""


def parse_header(data: bytes, size: int) -> Header:
    """Parse the headers of all parts.

    Args:
        data: The file's first bytes: ``MOST_HEADER`` of them, or the whole file when it is shorter.
        size: Length of the file, bytes.

    Returns:
        The headers of all parts and their length in bytes.

    Raises:
        ExrError: The file is damaged or not an EXR file.
    """
    reader = _Reader(data, size)
    magic, version = reader.numbers("<iI") if size >= 8 else (0, 0)
    if magic != MAGIC:
        raise ExrError("it is not an EXR file")
    if version & 0xFF != VERSION or version & ~0xFF & ~KNOWN_FLAGS:
        raise ExrError(f"version field {version:#x} is unknown")
    multipart = bool(version & MULTIPART)
    parts = tuple(_part(attributes, version) for attributes in list(_headers(reader, multipart)))
    if len({part.name for part in parts}) < len(parts):
        raise ExrError("two parts have the same name")
    return Header(parts, multipart, reader.at)


# ---------------------------------------------------------------------- attributes


class _Reader:
    """Reads values from the first bytes of a file; reading past their end raises ``ExrError``."""

    def __init__(self, data: bytes, size: int) -> None:
        self._data, self._size, self.at = data, size, 0

    def take(self, count: int) -> bytes:
        if count < 0:
            raise ExrError(f"a size of {count} bytes in the header")
        if self.at + count > len(self._data):
            long = self.at + count <= self._size
            raise ExrError(f"a header over {MOST_HEADER >> 20} MB" if long else "the file ends inside its header")
        self.at += count
        return self._data[self.at - count : self.at]

    def numbers(self, form: str) -> tuple[Any, ...]:
        return struct.unpack(form, self.take(struct.calcsize(form)))

    def text(self) -> str:
        """Read a name that ends with a zero byte."""
        end = self._data.find(b"\0", self.at, self.at + MOST_NAME + 1)
        if end < 0:
            at_end = len(self._data) - self.at <= MOST_NAME
            raise ExrError("the file ends inside its header" if at_end else f"a name over {MOST_NAME} bytes")
        raw = self.take(end + 1 - self.at)[:-1]
        return _decoded(raw)


def _decoded(raw: bytes) -> str:
    try:
        text = raw.decode()
    except UnicodeDecodeError:
        raise ExrError("a name that is not UTF-8") from None
    if not text.isprintable():
        raise ExrError("a name with control characters")
    return text


def _headers(reader: _Reader, multipart: bool) -> Iterator[Attributes]:
    """Yield the attributes of every part."""
    count = 0
    while attributes := _attributes(reader):
        count += 1
        if count > MOST_PARTS:
            raise ExrError(f"more than {MOST_PARTS} parts")
        yield attributes
        if not multipart:
            return
    if not count:
        raise ExrError("it has no header")


def _attributes(reader: _Reader) -> Attributes:
    """Read attributes, name → (type, value), until an empty name."""
    found: Attributes = {}
    while name := reader.text():
        kind = reader.text()
        (size,) = reader.numbers("<i")
        if name in found:
            raise ExrError(f"attribute '{name}' occurs twice")
        found[name] = kind, reader.take(size)
        if len(found) > MOST_ATTRIBUTES:
            raise ExrError(f"more than {MOST_ATTRIBUTES} attributes")
    return found


def _value(attributes: Attributes, name: str, kind: str, form: str) -> tuple[Any, ...]:
    """Return the numbers of a required attribute."""
    if name not in attributes:
        raise ExrError(f"attribute '{name}' is missing")
    found, raw = attributes[name]
    if found != kind or len(raw) != struct.calcsize(form):
        raise ExrError(f"attribute '{name}' is not of type {kind}")
    return struct.unpack(form, raw)


def _text(attributes: Attributes, name: str) -> str:
    """Return a text attribute; empty where it is absent."""
    kind, raw = attributes.get(name, ("string", b""))
    if kind != "string":
        raise ExrError(f"attribute '{name}' is not of type string")
    return _decoded(raw)


# ---------------------------------------------------------------------- parts


def _part(attributes: Attributes, version: int) -> ExrPart:
    kind = _text(attributes, "type")
    if not kind and version & (DEEP | MULTIPART):
        raise ExrError("attribute 'type' is missing")
    if not version & (DEEP | MULTIPART):
        kind = KINDS[bool(version & TILED)]
    if kind not in KINDS:
        raise ExrError(f"a part of type '{kind}'; known are {', '.join(KINDS)}")
    if version & MULTIPART and "name" not in attributes:
        raise ExrError("attribute 'name' is missing")
    (compression,) = _value(attributes, "compression", "compression", "<B")
    if compression not in CHUNK_LINES:
        raise ExrError(f"compression {compression} is unknown")
    (line_order,) = _value(attributes, "lineOrder", "lineOrder", "<B")
    if line_order > 2:
        raise ExrError(f"line order {line_order} is unknown")
    window, display = _window(attributes, "dataWindow"), _window(attributes, "displayWindow")
    tiles = _tiles(attributes) if kind in ("tiledimage", "deeptile") else None
    count = _chunk_count(window, compression, tiles)
    if "chunkCount" in attributes and kind != KINDS[bool(tiles)]:
        _same_count(attributes, count)
    return ExrPart(
        _text(attributes, "name"), _text(attributes, "view"), kind, _channels(attributes), window, display,
        compression, tiles, count,
    )  # fmt: skip


def _same_count(attributes: Attributes, count: int) -> None:
    (stated,) = _value(attributes, "chunkCount", "int", "<i")
    if stated != count:
        raise ExrError(f"chunkCount is {stated}; the window has {count} chunks")


def _window(attributes: Attributes, name: str) -> Window:
    x0, y0, x1, y1 = _value(attributes, name, "box2i", "<4i")
    if x1 < x0 or y1 < y0 or min(x0, y0) < -MOST_COORDINATE or max(x1, y1) > MOST_COORDINATE:
        raise ExrError(f"{name} ({x0}, {y0}) to ({x1}, {y1}) is not a window")
    return x0, y0, x1 - x0 + 1, y1 - y0 + 1


def _channels(attributes: Attributes) -> tuple[Channel, ...]:
    kind, raw = attributes.get("channels", ("", b""))
    if kind != "chlist":
        raise ExrError("attribute 'channels' is missing or not of type chlist")
    reader, found = _Reader(raw, len(raw)), []
    while name := reader.text():
        pixel_type, _linear, x, y = reader.numbers("<iI2i")
        if pixel_type not in PIXEL_BYTES or not (0 < x < MOST_COORDINATE and 0 < y < MOST_COORDINATE):
            raise ExrError(f"channel '{name}' has pixel type {pixel_type} and sampling {x}, {y}")
        found.append(Channel(name, pixel_type, (x, y)))
        if len(found) > MOST_CHANNELS:
            raise ExrError(f"more than {MOST_CHANNELS} channels")
    if reader.at != len(raw) or not found or len({c.name for c in found}) < len(found):
        raise ExrError("its list of channels is damaged")
    return tuple(found)


def _tiles(attributes: Attributes) -> ExrTiles:
    width, height, mode = _value(attributes, "tiles", "tiledesc", "<2IB")
    levels, rounding = mode & 15, mode >> 4
    if not (0 < width < MOST_COORDINATE and 0 < height < MOST_COORDINATE and levels < 3 and rounding < 2):
        raise ExrError(f"tiles of {width}x{height} pixels in mode {mode}")
    return ExrTiles(width, height, levels, bool(rounding))


def _chunk_count(window: Window, compression: int, tiles: ExrTiles | None) -> int:
    """Entries of the chunk offset table."""
    _, _, width, height = window
    if tiles is None:
        return -(-height // CHUNK_LINES[compression])
    across, down = _level_tiles(width, tiles.width, tiles), _level_tiles(height, tiles.height, tiles)
    if tiles.levels == 0:
        return across[0] * down[0]
    if tiles.levels == 2:
        return sum(across) * sum(down)
    # Mipmap levels continue until the longer edge is 1.
    count = max(len(across), len(down))
    across, down = across + [1] * (count - len(across)), down + [1] * (count - len(down))
    return sum(a * b for a, b in zip(across, down))


def _level_tiles(extent: int, tile: int, tiles: ExrTiles) -> list[int]:
    """Tiles along one edge at every level until the edge is 1."""
    found = []
    while True:
        found.append(-(-extent // tile))
        if extent == 1:
            return found
        extent = (extent + tiles.round_up) >> 1
