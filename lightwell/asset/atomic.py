"""Files that are either whole or absent: written under a temporary name, then renamed."""

from __future__ import annotations

import errno
import os
from pathlib import Path

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


def write_atomically(path: str | Path, data: bytes) -> int:
    """Write ``data`` to ``path`` and return its length in bytes.

    A failure leaves what stood at ``path`` untouched and no temporary file behind, and raises an ``OSError`` of the
    same class and ``errno`` whose one-line message says what was being written, where, and the cure.
    """
    path = Path(path)
    # The process id keeps two bakes into the same folder from writing the same temporary file.
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with open(temporary, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        _remove(temporary)
        raise _explained(error, f"write '{path}' ({len(data)} bytes)") from error
    except BaseException:
        _remove(temporary)
        raise
    return len(data)


def make_folder(path: str | Path) -> Path:
    """Create a folder and those above it unless it exists; a failure is an ``OSError`` that names the cure."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _explained(error, f"create the folder '{path}'") from error
    return path


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        pass  # the first failure is the one to report


def _explained(error: OSError, attempt: str) -> OSError:
    cure = CURES.get(error.errno or 0, "choose another folder")
    reason = error.strerror or type(error).__name__
    return type(error)(error.errno, f"cannot {attempt}: {reason}; {cure}")
