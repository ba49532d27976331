"""The GLB 2.0 container: reads and writes its JSON chunk and its binary chunk.

Reference: glTF 2.0 specification, section 4 (GLB file format) and 3.6.2 (accessors).
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.limits import JSON_EXPANSION, Limits, LoadBudget

MAGIC = b"glTF"
VERSION = 2
HEADER_BYTES = 12
CHUNK_HEADER_BYTES = 8
JSON_CHUNK = 0x4E4F534A
BINARY_CHUNK = 0x004E4942
# Every accessor starts at a multiple of this, which satisfies every component type (section 3.6.2.4).
ALIGNMENT = 4

# glTF component types of the NumPy types that may be stored. float16 has none: it is stored as the bits of a uint16.
COMPONENT_TYPES = {
    np.dtype("int8"): 5120,
    np.dtype("uint8"): 5121,
    np.dtype("uint16"): 5123,
    np.dtype("uint32"): 5125,
    np.dtype("float32"): 5126,
}
ELEMENT_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
# Targets of buffer views (section 5.11.5).
ARRAY_BUFFER = 34962
ELEMENT_ARRAY_BUFFER = 34963


class Binary:
    """The binary chunk of a GLB, with the buffer views and accessors that describe its parts."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add_view(self, data: bytes, target: int | None = None) -> int:
        """Append bytes to the chunk, aligned to 4 bytes.

        Args:
            data: Bytes of the buffer view.
            target: ``ARRAY_BUFFER`` for vertex attributes, ``ELEMENT_ARRAY_BUFFER`` for indices, None for other data.

        Returns:
            Index of the new buffer view.
        """
        self.data += b"\0" * (-len(self.data) % ALIGNMENT)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        self.data += data
        self.views.append(view)
        return len(self.views) - 1

    def add_accessor(self, array: np.ndarray, target: int | None = None, bounds: bool = False) -> int:
        """Append an array to the chunk, little-endian.

        Args:
            array: [count] or [count, 2..4] numbers of one of the types in ``COMPONENT_TYPES``.
            target: As for ``add_view``.
            bounds: Write the least and greatest values too, which glTF requires for positions.

        Returns:
            Index of the new accessor.
        """
        array = np.ascontiguousarray(array)
        components = 1 if array.ndim == 1 else array.shape[1]
        little_endian = array.astype(array.dtype.newbyteorder("<"), copy=False)
        accessor: dict[str, Any] = {
            "bufferView": self.add_view(little_endian.tobytes(), target),
            "componentType": COMPONENT_TYPES[array.dtype],
            "count": len(array),
            "type": ELEMENT_TYPES[components],
        }
        if bounds:
            table = array.reshape(len(array), components)
            accessor["min"] = table.min(axis=0).tolist()
            accessor["max"] = table.max(axis=0).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def view_bytes(document: dict[str, Any], binary: bytes, index: int) -> bytes:
    """Read the bytes of a buffer view.

    Args:
        document: glTF JSON.
        binary: The binary chunk.
        index: Index of the buffer view.

    Returns:
        Its bytes.
    """
    view = document["bufferViews"][index]
    start = view.get("byteOffset", 0)
    return binary[start : start + view["byteLength"]]


def replace_views(document: dict[str, Any], binary: bytes, replaced: Mapping[int, bytes]) -> bytes:
    """Write the binary chunk with other bytes for some buffer views, whose places are written to the document.

    Args:
        document: glTF JSON; changed.
        binary: The binary chunk.
        replaced: New bytes by index of the buffer view.

    Returns:
        The new chunk.
    """
    out = Binary()
    for index, view in enumerate(document["bufferViews"]):
        out.add_view(replaced[index] if index in replaced else view_bytes(document, binary, index))
        view |= {key: out.views[-1][key] for key in ("byteOffset", "byteLength")}
    document["buffers"][0]["byteLength"] = len(out.data)
    return bytes(out.data)


def pack(document: dict[str, Any], binary: bytes) -> bytes:
    """Build a GLB file.

    NaN and infinities in the document are refused.

    Args:
        document: The glTF JSON.
        binary: Content of the binary chunk; when it is empty, the file has no such chunk.

    Returns:
        The bytes of the file.
    """
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    chunks = [(JSON_CHUNK, text + b" " * (-len(text) % ALIGNMENT))]
    if binary:
        chunks.append((BINARY_CHUNK, bytes(binary) + b"\0" * (-len(binary) % ALIGNMENT)))
    body = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
    return MAGIC + struct.pack("<II", VERSION, HEADER_BYTES + len(body)) + body


def unpack(data: bytes, budget: LoadBudget | None = None) -> tuple[dict[str, Any], bytes]:
    """Split a GLB file into its JSON and its binary chunk.

    Args:
        data: The bytes of the file.
        budget: Counts the memory of the JSON; None for a file of our own.

    Returns:
        The glTF JSON, and the content of the binary chunk (empty when there is none).

    Raises:
        ValueError: The bytes are not a whole GLB of version 2, or its JSON cannot be read.
    """
    if len(data) < HEADER_BYTES + CHUNK_HEADER_BYTES or data[:4] != MAGIC:
        raise ValueError("not a GLB file (it does not start with 'glTF')")
    version, length = struct.unpack_from("<II", data, 4)
    if version != VERSION:
        raise ValueError(f"GLB version {version}; only version {VERSION} is known")
    if length > len(data):
        raise ValueError(f"truncated: the header promises {length} bytes, the file has {len(data)}")
    chunks = _chunks(data, length)
    if not chunks or chunks[0][0] != JSON_CHUNK:
        raise ValueError("its first chunk is not JSON")
    if budget is not None:
        budget.charge("decoded_bytes", JSON_EXPANSION * len(chunks[0][1]), "its JSON")
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == BINARY_CHUNK else b""
    return parse_json(chunks[0][1]), binary


def _chunks(data: bytes, length: int) -> list[tuple[int, bytes]]:
    chunks, offset = [], HEADER_BYTES
    while offset + CHUNK_HEADER_BYTES <= length:
        size, kind = struct.unpack_from("<II", data, offset)
        offset += CHUNK_HEADER_BYTES
        if size > length - offset:
            raise ValueError(f"truncated: a chunk of {size} bytes does not fit into the file")
        chunks.append((kind, data[offset : offset + size]))
        offset += size
    return chunks


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:20]} is not finite")
    return value


def parse_json(data: bytes) -> dict[str, Any]:
    """Read a JSON object whose numbers are all finite.

    Args:
        data: UTF-8 text.

    Returns:
        The object.

    Raises:
        ValueError: The text is not UTF-8, not JSON, not an object, nested too deeply, or holds NaN or an infinity.
    """
    try:
        document = json.loads(data.decode("utf-8"), parse_float=_finite, parse_constant=_finite)
    except UnicodeDecodeError as error:
        raise ValueError("its JSON is not UTF-8") from error
    except RecursionError as error:
        raise ValueError("its JSON is nested too deeply") from error
    except ValueError as error:
        raise ValueError(f"its JSON cannot be read ({error})") from error
    if not isinstance(document, dict):
        raise ValueError("its JSON is not an object")
    return document


@contextmanager
def refusing(path: str | Path) -> Iterator[None]:
    """Turn Python's errors about JSON of unexpected types into a one-line ``ValueError`` that names the file.

    Args:
        path: The file that is read inside the block.

    Yields:
        Nothing.

    Raises:
        ValueError: The block ran out of memory, or met a value of an unexpected type, key, index or range.
    """
    try:
        yield
    except MemoryError as error:
        raise ValueError(f"asset: '{path}': needs more memory than this machine has; bake a smaller field") from error
    except (AttributeError, LookupError, TypeError, ArithmeticError, RecursionError) as error:
        reason = " ".join(repr(error).split())[:120]
        raise ValueError(f"asset: '{path}': its JSON is not that of a baked scene ({reason}); bake it again") from error


def read_file(path: str | Path, limits: Limits | None = None) -> tuple[dict[str, Any], bytes]:
    """Read a GLB file.

    Args:
        path: The file.
        limits: Largest file size that is read; None for the defaults of ``Limits``.

    Returns:
        The glTF JSON and the content of the binary chunk.

    Raises:
        ValueError: The file cannot be opened, exceeds the limits or is not a GLB; the message names it.
    """
    budget = (limits or Limits()).budget(f"asset: '{path}'")
    try:
        budget.charge("file_bytes", Path(path).stat().st_size)
        with refusing(path):
            return unpack(Path(path).read_bytes(), budget)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise ValueError(f"asset: '{path}' cannot be opened: {reason}; give the path of a .glb file") from error
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith("asset: ") else f"asset: '{path}': {text}") from error
