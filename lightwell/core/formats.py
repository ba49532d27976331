"""File formats of the store: named arrays, memory-mapped columns, JSON. Nothing is pickled.

Every format detects damage when it reads: .npz by the check sums of its members, the others by BLAKE2b hashes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, cast, get_type_hints

import numpy as np

from lightwell.core.keys import array_digest, digest
from lightwell.files import Arrays, flush, load_arrays

T = TypeVar("T")
COLUMNS_HEAD = "columns.json"


class Format(Protocol[T]):
    """File format of one kind of value."""

    suffix: str
    """Ending of the names of its entries."""

    def write(self, path: Path, value: T) -> None:
        """Write a value and flush it to the disk.

        Args:
            path: File or folder to create; it does not exist yet.
            value: The value.
        """

    def read(self, path: Path) -> T:
        """Read what ``write`` wrote; anything else is a ``ValueError`` or an ``OSError``.

        Args:
            path: File or folder that ``write`` created.

        Returns:
            The value.
        """


class ArraysFormat:
    """Named arrays in one .npz file."""

    suffix = ".npz"

    def __init__(self, compressed: bool = False) -> None:
        """Create the format.

        Args:
            compressed: Compress the arrays (deflate).
        """
        self._save: Callable[..., None] = np.savez_compressed if compressed else np.savez

    def write(self, path: Path, value: Arrays) -> None:
        """Write named arrays to an .npz file.

        Args:
            path: File to create.
            value: Arrays of any shape by name.
        """
        with open(path, "wb") as stream:
            self._save(stream, **{name: _no_objects(name, array) for name, array in value.items()})
        flush(path)

    def read(self, path: Path) -> Arrays:
        """Read named arrays from an .npz file.

        Args:
            path: File that ``write`` created.

        Returns:
            The arrays by name.
        """
        return load_arrays(path, "not arrays of the store")


class ColumnsFormat:
    """Named arrays in a folder of .npy files, read as memory maps: they take no memory until they are used."""

    suffix = ".columns"

    def write(self, path: Path, value: Arrays) -> None:
        """Write named arrays to a folder of .npy files.

        Args:
            path: Folder to create.
            value: Arrays of any shape by name.
        """
        path.mkdir()
        head = {}
        for name, array in value.items():
            np.save(path / f"{name}.npy", _no_objects(name, array))
            flush(path / f"{name}.npy")
            head[name] = [array.dtype.str, list(array.shape), array_digest(array)]
        (path / COLUMNS_HEAD).write_text(json.dumps(head))
        flush(path / COLUMNS_HEAD)

    def read(self, path: Path) -> Arrays:
        """Map the arrays of a folder into memory, after their check sums have been compared.

        Args:
            path: Folder that ``write`` created.

        Returns:
            The arrays by name, read-only.

        Raises:
            ValueError: The folder's index does not name columns.
        """
        head = json.loads((path / COLUMNS_HEAD).read_text())
        if not isinstance(head, dict) or any(Path(name).name != name for name in head):
            raise ValueError(f"{path}: {COLUMNS_HEAD} does not name columns")
        return {name: _column(path / f"{name}.npy", *facts) for name, facts in head.items()}


class JsonFormat:
    """A value of JSON types in one file, with its check sum."""

    suffix = ".json"

    def write(self, path: Path, value: Any) -> None:
        """Write a value with its check sum.

        Args:
            path: File to create.
            value: A value of JSON types.
        """
        path.write_text(json.dumps({"check": _check(value), "value": value}))
        flush(path)

    def read(self, path: Path) -> Any:
        """Read a value and compare its check sum.

        Args:
            path: File that ``write`` created.

        Returns:
            The value.

        Raises:
            ValueError: The check sum does not match.
        """
        found = json.loads(path.read_text())
        if (
            not isinstance(found, dict)
            or found.keys() != {"check", "value"}
            or _check(found["value"]) != found["check"]
        ):
            raise ValueError(f"{path}: the check sum does not match")
        return found["value"]


class RecordFormat(Generic[T]):
    """A dataclass whose fields are arrays, None, or dataclasses of that kind, in one .npz file."""

    suffix = ".npz"

    def __init__(self, kind: type[T]) -> None:
        """Create the format of one dataclass.

        Args:
            kind: The dataclass.
        """
        self._kind = kind

    def write(self, path: Path, value: T) -> None:
        """Write the arrays of a record to an .npz file.

        Args:
            path: File to create.
            value: Instance of the dataclass.
        """
        ARRAYS.write(path, arrays_of(value))

    def read(self, path: Path) -> T:
        """Read a record from an .npz file.

        Args:
            path: File that ``write`` created.

        Returns:
            Instance of the dataclass.
        """
        return record_of(self._kind, ARRAYS.read(path))


ARRAYS, COMPRESSED, COLUMNS, JSON = ArraysFormat(), ArraysFormat(compressed=True), ColumnsFormat(), JsonFormat()


def arrays_of(record: Any, prefix: str = "") -> Arrays:
    """Collect the arrays of a dataclass by name.

    Args:
        record: Dataclass whose fields are arrays, None, or dataclasses of that kind.
        prefix: Put before every name.

    Returns:
        Arrays by field name; those of a dataclass in field ``f`` are called 'f.name'.
    """
    found: Arrays = {}
    for field in fields(record):
        value, name = getattr(record, field.name), prefix + field.name
        if is_dataclass(value):
            found |= arrays_of(value, f"{name}.")
        elif value is not None:
            found[name] = np.asarray(value)
    return found


def record_of(kind: type[T], arrays: Mapping[str, np.ndarray], prefix: str = "") -> T:
    """Build a dataclass from the arrays that ``arrays_of`` returned.

    Args:
        kind: The dataclass.
        arrays: Arrays of any shape by name.
        prefix: Stands before the names of this record's fields.

    Returns:
        The record; fields without an array keep their default.

    Raises:
        ValueError: A field without a default is missing.
    """
    hints, values = get_type_hints(kind), dict[str, Any]()
    for field in fields(kind):  # type: ignore[arg-type]
        name, hint = prefix + field.name, hints[field.name]
        if is_dataclass(hint):
            values[field.name] = record_of(cast(type, hint), arrays, f"{name}.")
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
    array: np.ndarray = np.load(path, mmap_mode="r" if np.prod(shape) else None, allow_pickle=False)
    if array.dtype.str != kind or list(array.shape) != shape or array_digest(array) != check:
        raise ValueError(f"{path}: the check sum does not match")
    return array


def _check(value: Any) -> str:
    return digest(json.dumps(value, sort_keys=True).encode())
