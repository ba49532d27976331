"""Files that are either whole or absent: written under a temporary name, flushed to the disk, then renamed."""

from __future__ import annotations

import errno
import math
import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from lightwell.limits import Limits

Arrays = dict[str, np.ndarray]

# No array file that lightwell writes unpacks to more.
MOST_ARRAY_BYTES = 1 << 32

# What a reader can do about the failures that happen in practice.
CURES = {
    errno.ENOSPC: "the disk is full; free some space or choose another folder",
    errno.EDQUOT: "your disk quota is used up; free some space or choose another folder",
    errno.EACCES: "the folder cannot be written; choose another one or change its permissions",
    errno.EPERM: "the folder cannot be written; choose another one or change its permissions",
    errno.EROFS: "the file system is read-only; choose another folder",
    errno.ENOENT: "the folder does not exist; create it first",
    errno.ENOTDIR: "a file stands where a folder is expected; choose another path",
    errno.EEXIST: "a file stands where a folder is expected; choose another path",
    errno.EISDIR: "a folder of that name exists; choose another file name",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
}

# Everything that numpy.load raises at damaged bytes, besides what it means to raise.
DAMAGED = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    SyntaxError,
    MemoryError,
    OverflowError,
    NotImplementedError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


@contextmanager
def whole_file(path: str | Path, suffix: str = ".part") -> Iterator[Path]:
    """A temporary name beside ``path`` to write to; renamed to ``path`` at the end, removed on a failure.

    Flushed to the disk before the rename, so that a power cut leaves the old file or the new one. An ``OSError`` gets a
    one-line message: what, where, and the cure. ``suffix``: how the temporary name ends, for writers that look at it.
    """
    path = Path(path)
    # The process id keeps two bakes into the same folder from writing the same temporary file.
    temporary = path.with_name(f".{path.name}.{os.getpid()}{suffix}")
    try:
        yield temporary
        flush(temporary)
        os.replace(temporary, path)
    except OSError as error:
        _remove(temporary)
        raise explained(error, f"write '{path}'") from error
    except BaseException:
        _remove(temporary)
        raise


def write_atomically(path: str | Path, data: bytes | str) -> int:
    """Write ``data`` (text as UTF-8) to ``path`` and return its length in bytes; see ``whole_file``."""
    raw = data.encode() if isinstance(data, str) else data
    with whole_file(path) as temporary:
        temporary.write_bytes(raw)
    return len(raw)


def save_arrays(path: str | Path, arrays: Mapping[str, np.ndarray], compressed: bool = False) -> None:
    """Named arrays as one .npz."""
    with whole_file(path) as temporary, open(temporary, "wb") as stream:
        (np.savez_compressed if compressed else np.savez)(stream, **arrays)


def load_arrays(
    path: str | Path,
    cure: str = "not a checkpoint; delete it and bake without --resume",
    limits: Limits | None = None,
) -> Arrays:
    """Read all arrays of an .npz, without pickle.

    Args:
        path: The file.
        cure: What the message says of a file that is none.
        limits: What it may unpack to; default ``MOST_ARRAY_BYTES``.

    Raises:
        ValueError: The file is damaged, or unpacks to more; one line.
        FileNotFoundError: There is no such file.
    """
    try:
        _check_members(path, limits or Limits(decoded_bytes=MOST_ARRAY_BYTES))
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except FileNotFoundError:
        raise
    except (*DAMAGED, AttributeError) as error:
        raise ValueError(f"{path}: {cure} ({_reason(error)})") from error


def _check_members(path: str | Path, limits: Limits) -> None:
    """Compare the members of an .npz with limits and with their shapes, before memory is asked for."""
    budget = limits.budget(Path(path).name)
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            budget.charge("decoded_bytes", member.file_size, member.filename)
            with archive.open(member) as stream:
                version = np.lib.format.read_magic(stream)
                read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
                shape, _, kind = read[version](stream)
                if math.prod(shape) * kind.itemsize != member.file_size - stream.tell():
                    raise ValueError(f"'{member.filename}' has {member.file_size} bytes, not those of its shape")


def _reason(error: BaseException) -> str:
    """The first words of an error, on one line."""
    return " ".join(str(error).split())[:120]


def flush(path: Path) -> None:
    """Wait until the disk has the file."""
    with open(path, "rb+") as file:
        os.fsync(file.fileno())


def make_folder(path: str | Path) -> Path:
    """Create a folder and those above it unless it exists; a failure is an ``OSError`` that names the cure."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise explained(error, f"create the folder '{path}'") from error
    return path


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        pass  # the first failure is the one to report


def explained(error: OSError, attempt: str) -> OSError:
    """Return an error of the same type whose one-line message says what was attempted, the reason and the cure."""
    cure = CURES.get(error.errno or 0, "choose another folder")
    reason = error.strerror or type(error).__name__
    return type(error)(error.errno, f"cannot {attempt}: {reason}; {cure}")
