"""How values of the store lie on disk: named arrays, memory-mapped columns, JSON. Nothing is pickled.

Every format notices damage when it reads: .npz by the check sums of its members, the others by BLAKE2b hashes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, get_type_hints

import numpy as np

from lightwell.core.keys import array_digest, digest
from lightwell.files import Arrays, flush, load_arrays

T = TypeVar("T")
COLUMNS_HEAD = "columns.json"


class Format(Protocol[T]):
    """Writes and reads one kind of value."""

    suffix: str
    """How names of entries end."""

    def write(self, path: Path, value: T) -> None:
        """Write a value to ``path``, which does not exist yet, and flush it to the disk."""

    def read(self, path: Path) -> T:
        """Read what ``write`` wrote; ``ValueError`` or ``OSError`` for anything else."""


class ArraysFormat:
    """Named arrays in one .npz file."""

    suffix = ".npz"

    def write(self, path: Path, value: Mapping[str, np.ndarray]) -> None:
        with open(path, "wb") as stream:
            np.savez(stream, **{name: _no_objects(name, array) for name, array in value.items()})
        flush(path)

    def read(self, path: Path) -> Arrays:
        return load_arrays(path, "not arrays of the store")


class ColumnsFormat:
    """Named arrays in a folder of .npy files, read as memory maps: they take no memory until they are used."""

    suffix = ".columns"

    def write(self, path: Path, value: Mapping[str, np.ndarray]) -> None:
        path.mkdir()
        head = {}
        for name, array in value.items():
            np.save(path / f"{name}.npy", _no_objects(name, array))
            flush(path / f"{name}.npy")
            head[name] = [array.dtype.str, list(array.shape), array_digest(array)]
        (path / COLUMNS_HEAD).write_text(json.dumps(head))
        flush(path / COLUMNS_HEAD)

    def read(self, path: Path) -> Arrays:
        head = json.loads((path / COLUMNS_HEAD).read_text())
        if not isinstance(head, dict) or any(Path(name).name != name for name in head):
            raise ValueError(f"{path}: {COLUMNS_HEAD} does not name columns")
        return {name: _column(path / f"{name}.npy", *facts) for name, facts in head.items()}


class JsonFormat:
    """A value of JSON types in one file, with its check sum."""

    suffix = ".json"

    def write(self, path: Path, value: Any) -> None:
        path.write_text(json.dumps({"check": _check(value), "value": value}))
        flush(path)

    def read(self, path: Path) -> Any:
        found = json.loads(path.read_text())
        if (
            not isinstance(found, dict)
            or found.keys() != {"check", "value"}
            or _check(found["value"]) != found["check"]
        ):
            raise ValueError(f"{path}: the check sum does not match")
        return found["value"]


class RecordFormat(Generic[T]):
    """A dataclass whose fields are arrays, None, or such dataclasses, in one .npz file."""

    suffix = ".npz"

    def __init__(self, kind: type[T]) -> None:
        self._kind = kind

    def write(self, path: Path, value: T) -> None:
        ARRAYS.write(path, arrays_of(value))

    def read(self, path: Path) -> T:
        return record_of(self._kind, ARRAYS.read(path))


ARRAYS, COLUMNS, JSON = ArraysFormat(), ColumnsFormat(), JsonFormat()


def arrays_of(record: Any, prefix: str = "") -> Arrays:
    """Return the arrays of a dataclass by name; those of a dataclass inside it are called 'field.name'."""
    found: Arrays = {}
    for field in fields(record):
        value, name = getattr(record, field.name), prefix + field.name
        if is_dataclass(value):
            found |= arrays_of(value, f"{name}.")
        elif value is not None:
            found[name] = np.asarray(value)
    return found


def record_of(kind: type[T], arrays: Mapping[str, np.ndarray], prefix: str = "") -> T:
    """Return the dataclass that ``arrays_of`` took apart; ``ValueError`` where a field without a default is missing."""
    hints, values = get_type_hints(kind), {}
    for field in fields(kind):  # type: ignore[arg-type]
        name, hint = prefix + field.name, hints[field.name]
        if is_dataclass(hint):
            values[field.name] = record_of(hint, arrays, f"{name}.")
        elif name in arrays:
            values[field.name] = arrays[name]
    try:
        return kind(**values)
    except TypeError as error:
        raise ValueError(f"not the arrays of {kind.__name__} ({error})") from error


def _no_objects(name: str, array: np.ndarray) -> np.ndarray:
    array = np.asarray(array)
    if array.dtype == object:
        raise TypeError(f"store: '{name}' holds Python objects; store numbers")
    return array


def _column(path: Path, kind: str, shape: list[int], check: str) -> np.ndarray:
    array = np.load(path, mmap_mode="r" if np.prod(shape) else None, allow_pickle=False)
    if array.dtype.str != kind or list(array.shape) != shape or array_digest(array) != check:
        raise ValueError(f"{path}: the check sum does not match")
    return array


def _check(value: Any) -> str:
    return digest(json.dumps(value, sort_keys=True).encode())
