"""Keys of stored results: a hash of all inputs of a result."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

import lightwell

# BLAKE2b-160: collisions do not occur in practice, and every file system accepts names of 40 hexadecimal digits.
DIGEST_BYTES = 20
_FUNCTION = re.compile(r"[a-z0-9][a-z0-9._-]*")


@dataclass(frozen=True)
class Key:
    """The name of a stored result."""

    function: str
    """Name of the function that made it, such as 'samples.shard'; also the name of its folder in the store."""
    digest: str
    """Hash of its inputs, 40 hexadecimal digits."""


def key(function: str, version: int, /, **made_from: Any) -> Key:
    """Return the key of a result.

    Args:
        function: Name of the function that makes the result: lower-case letters, digits, '.', '_' and '-'.
        version: Version of that function; raise it when the same arguments give other bytes than before.
        **made_from: Everything that decides the result, such as ``scene=scene.digest``, ``settings=…``, ``seed=…``:
            numbers, text, bytes, paths, arrays, dataclasses, and lists and dictionaries of those.

    Returns:
        A key that is the same in every process and on every machine, for one version of lightwell. Inputs that cannot
        be hashed by value are a ``TypeError``.

    Raises:
        ValueError: ``function`` is not a name.
    """
    if not _FUNCTION.fullmatch(function):
        raise ValueError(f"store: '{function}' is not a function name; use a-z, 0-9, '.', '_' and '-'")
    content = {
        "function": function,
        "version": version,
        "lightwell": lightwell.__version__,
        "made_from": _plain(made_from),
    }
    return Key(function, digest(json.dumps(content, sort_keys=True).encode()))


def digest(data: bytes | memoryview) -> str:
    """Return the BLAKE2b-160 hash of bytes.

    Args:
        data: The bytes.

    Returns:
        40 hexadecimal digits.
    """
    return hashlib.blake2b(data, digest_size=DIGEST_BYTES).hexdigest()


def array_digest(array: np.ndarray) -> str:
    """Return the hash of the numbers of an array, without its type and shape.

    Args:
        array: Array of any shape; its bytes are hashed in C order.

    Returns:
        40 hexadecimal digits.
    """
    return digest(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)


def _plain(value: Any) -> Any:
    """The value in JSON types; different values give different JSON."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, os.PathLike):
        return {"path": os.fspath(value)}
    if isinstance(value, bytes):
        return {"bytes": digest(value)}
    if isinstance(value, np.ndarray) and value.dtype != object:
        return {"array": [value.dtype.str, list(value.shape), array_digest(value)]}
    if is_dataclass(value) and not isinstance(value, type):
        return {
            "record": type(value).__name__,
            "fields": {f.name: _plain(getattr(value, f.name)) for f in fields(value)},
        }
    if isinstance(value, Mapping) and all(isinstance(name, str) for name in value):
        return {"mapping": {name: _plain(item) for name, item in value.items()}}
    if isinstance(value, Sequence):
        return [_plain(item) for item in value]
    raise TypeError(f"store: a key cannot be made from {type(value).__name__}; pass its digest or its numbers")
