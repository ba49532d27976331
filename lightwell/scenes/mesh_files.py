"""Checks of PLY and OBJ files before Mitsuba's native readers open them.

Mitsuba's PLY reader trusts counts and vertex indices; its OBJ reader checks indices itself.
V vertices, F triangles.
"""

from __future__ import annotations

import mmap
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lightwell.limits import LoadBudget
from lightwell.scenes.errors import SceneError

# Bytes of a PLY header, and of the parts in which an OBJ file is counted.
MOST_HEADER, PART = 1 << 16, 1 << 24
TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}
CURE = "export the mesh again"


@dataclass
class _Rows:
    """One element of a PLY header; a list counts as its count and three values."""

    name: str
    count: int
    columns: list[tuple[str, str]] = field(default_factory=list)
    lists: list[str] = field(default_factory=list)


def check_ply(path: Path, place: str, budget: LoadBudget) -> None:
    """Check that a PLY file holds what its header says: vertices of finite numbers, and triangles of those vertices.

    A defect raises ``SceneError``, one line with the cure.

    Args:
        path: An existing file.
        place: Beginning of messages.
        budget: Its ``vertices`` and ``indices`` are checked before anything is read.
    """
    place = f"{place}: mesh '{path.name}'"
    with path.open("rb") as stream:
        head = stream.read(MOST_HEADER)
    order, elements, begin = _header(head, place)
    vertices, faces = _two(elements, place)
    budget.check("vertices", vertices.count, place)
    budget.check("indices", 3 * faces.count, place)
    tables = (_ascii if order == "=" else _binary)(path, order, elements, begin, place)
    _check_values(tables, vertices.count, place)


def _header(head: bytes, place: str) -> tuple[str, list[_Rows], int]:
    """Parse the header; returns (byte order, elements, first byte after the header)."""
    end = re.search(rb"\nend_header[ \t]*\r?\n", head)
    if not re.match(rb"ply[ \t]*\r?\n", head) or end is None:
        raise SceneError(f"{place}: is no PLY file (it begins with {head[:12]!r}); {CURE}")
    order, elements = "", []
    for line in head[: end.start()].decode("latin-1").splitlines()[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in ORDERS:
            order = ORDERS[words[1]]
        elif words[0] == "element" and len(words) == 3 and re.fullmatch(r"\d{1,12}", words[2]):
            elements.append(_Rows(words[1], int(words[2])))
        elif words[0] == "property" and elements and _property(elements[-1], words[1:]):
            continue
        else:
            raise SceneError(f"{place}: its header has the line '{line[:60]}', which is no PLY; {CURE}")
    if not order:
        raise SceneError(f"{place}: its header names no known format; {CURE}")
    return order, elements, end.end()


def _property(rows: _Rows, words: list[str]) -> bool:
    """Add a property; returns whether it is a valid one."""
    taken = {name for name, _ in rows.columns}
    if len(words) == 2 and words[0] in TYPES and words[1] not in taken:
        rows.columns.append((words[1], TYPES[words[0]]))
        return True
    if len(words) != 4 or words[0] != "list" or not {words[1], words[2]} <= TYPES.keys() or words[3] in rows.lists:
        return False
    rows.lists.append(words[3])
    rows.columns += [(f"{words[3]}.count", TYPES[words[1]]), *((f"{words[3]}.{k}", TYPES[words[2]]) for k in range(3))]
    return True


def _two(elements: list[_Rows], place: str) -> tuple[_Rows, _Rows]:
    """Find the vertices and the faces."""
    found = []
    for name in ("vertex", "face"):
        rows = [e for e in elements if e.name == name]
        if len(rows) != 1 or rows[0].count < 1:
            raise SceneError(f"{place}: holds {len(rows)} lists of '{name}', expected one with entries; {CURE}")
        found += rows
    vertices, faces = found
    if not {"x", "y", "z"} <= {name for name, _ in vertices.columns} or vertices.lists:
        raise SceneError(f"{place}: its vertices have no x, y and z, or have lists; {CURE}")
    if len(faces.lists) != 1 or faces.lists[0] not in ("vertex_index", "vertex_indices"):
        raise SceneError(f"{place}: its faces need vertex_indices and no other list; {CURE}")
    if others := [e.name for e in elements if e.name not in ("vertex", "face") and e.count]:
        raise SceneError(f"{place}: holds '{others[0][:40]}' beside vertices and faces; export vertices and faces only")
    return vertices, faces


def _binary(path: Path, order: str, elements: list[_Rows], begin: int, place: str) -> dict[str, np.ndarray]:
    """Read the elements of a binary file as structured arrays."""
    kinds = [np.dtype([(name, order + kind) for name, kind in e.columns]) for e in elements]
    size, wanted = path.stat().st_size, begin + sum(e.count * k.itemsize for e, k in zip(elements, kinds, strict=True))
    if size != wanted:
        raise SceneError(
            f"{place}: has {size} bytes, but its header says {wanted} (faces must be triangles); "
            "triangulate it, or export it again"
        )
    tables: dict[str, np.ndarray] = {}
    at = begin
    for rows, kind in zip(elements, kinds, strict=True):
        if rows.count:
            tables[rows.name] = np.memmap(path, kind, "r", at, (rows.count,))
        at += rows.count * kind.itemsize
    return tables


def _ascii(path: Path, order: str, elements: list[_Rows], begin: int, place: str) -> dict[str, np.ndarray]:
    """Read the elements of a text file as structured arrays."""
    size, wanted = path.stat().st_size - begin, sum(e.count * len(e.columns) for e in elements)
    # Every number has at least a digit and a blank.
    if 2 * wanted > size + 1:
        raise SceneError(f"{place}: has {size} bytes of text, too few for the {wanted} numbers of its header; {CURE}")
    try:
        numbers = np.array(path.read_bytes()[begin:].split(), np.float64)
    except ValueError as error:
        raise SceneError(f"{place}: holds what is no number ({str(error)[:80]}); {CURE}") from None
    if len(numbers) != wanted:
        raise SceneError(
            f"{place}: holds {len(numbers)} numbers, but its header says {wanted} (faces must be triangles); "
            "triangulate it, or export it again"
        )
    tables: dict[str, np.ndarray] = {}
    at = 0
    for rows in elements:
        width = len(rows.columns)
        block = numbers[at : at + rows.count * width].reshape(rows.count, width)
        tables[rows.name] = np.rec.fromarrays(list(block.T), dtype=[(name, np.float64) for name, _ in rows.columns])
        at += rows.count * width
    return tables


def _check_values(tables: dict[str, np.ndarray], count: int, place: str) -> None:
    for rows in tables.values():
        for name in rows.dtype.names or ():
            values = rows[name]
            if values.dtype.kind == "f" and not np.isfinite(values.astype(np.float32)).all():
                raise SceneError(f"{place}: its '{name[:40]}' has values that are not finite numbers; {CURE}")
    faces = tables["face"]
    (key,) = (name.removesuffix(".count") for name in faces.dtype.names or () if name.endswith(".count"))
    if (faces[f"{key}.count"] != 3).any():
        raise SceneError(f"{place}: has faces that are no triangles; triangulate it")
    for k in range(3):
        index = faces[f"{key}.{k}"]
        if index.min() < 0 or index.max() >= count or (index.dtype.kind == "f" and (index % 1).any()):
            raise SceneError(f"{place}: a face names a vertex that is not among its {count}; {CURE}")


def check_obj(path: Path, place: str, budget: LoadBudget) -> None:
    """Check that an OBJ file is text with vertices and faces, and count them before Mitsuba reads it.

    Args:
        path: An existing file.
        place: Beginning of messages.
        budget: Its ``vertices`` and ``indices`` are checked.

    Raises:
        SceneError: The file is empty, is no text, or has no surface.
    """
    place = f"{place}: mesh '{path.name}'"
    if not path.stat().st_size:
        raise SceneError(f"{place}: is empty; {CURE}")
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as text:
        if text.find(b"\0", 0, MOST_HEADER) >= 0:
            raise SceneError(f"{place}: is no OBJ file, it holds bytes that are no text; {CURE}")
        for kind in (b"v", b"f"):
            if not re.search(rb"^[ \t]*" + kind + rb"[ \t]", text, re.MULTILINE):
                raise SceneError(f"{place}: is no OBJ file with a surface, it has no line '{kind.decode()} …'; {CURE}")
    vertices, faces = _count(path, b"\nv "), _count(path, b"\nf ")
    budget.check("vertices", vertices, place)
    budget.check("indices", 3 * faces, place)


def _count(path: Path, what: bytes) -> int:
    """Count ``what`` in a file, read in blocks; occurrences across two blocks are missed."""
    with path.open("rb") as stream:
        return sum(part.count(what) for part in iter(lambda: stream.read(PART), b""))
