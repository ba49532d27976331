"""Atomic file writes (temporary name, flush to disk, rename) and checked reading of .npz files."""

from __future__ import annotations

import errno
import math
import os
import stat
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from lightwell.limits import Limits

Arrays = dict[str, np.ndarray]

# Beginning of the names of files that lightwell keeps for itself: locks, checkpoints, samples.
OWN_PREFIX = ".lightwell"
# Largest unpacked size of an array file that lightwell writes, bytes.
MOST_ARRAY_BYTES = 1 << 32

# What the user can do about common failures.
CURES = {
    errno.ENOSPC: "the disk is full; free some space or choose another folder",
    errno.EFBIG: "the file is larger than the system allows; choose another folder, or raise the limit (ulimit -f)",
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

# Errors that numpy.load raises over damaged files, intended and not.
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
    """Provide a temporary name beside a file; on success it is renamed to the file, on failure it is removed.

    The data are flushed to the disk before the rename, so that a power cut leaves either the old file or the new one.

    Args:
        path: File to write.
        suffix: End of the temporary name, for writers that infer the format from it.

    Yields:
        The temporary name.

    Raises:
        OSError: An error of the system; its one-line message says what failed, where, and the cure.
        BaseException: Any other error of the calling code, unchanged.
    """
    path = Path(path)
    temporary = _temporary(path, suffix)
    try:
        yield temporary
        flush(temporary)
        os.replace(temporary, path)
    except OSError as error:
        _remove(temporary)
        error = explained(error, f"write '{path}'")
        raise error
    except BaseException:
        _remove(temporary)
        raise


def _temporary(path: Path, suffix: str = ".part") -> Path:
    """The temporary name of a file; the process id keeps two processes from writing the same one."""
    return path.with_name(f".{path.name}.{os.getpid()}{suffix}")


def check_writable(path: str | Path) -> None:
    """Refuse a file that cannot be written, before the work for it begins.

    Args:
        path: File to write. It need not exist, and is not changed.

    Raises:
        OSError: Its folder is missing or cannot be written, or a folder has its name; the message is that of
            ``whole_file``.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        # Only an attempt tells whether a folder can be written: permissions do not say all.
        temporary = _temporary(path)
        temporary.touch()
    except OSError as error:
        error = explained(error, f"write '{path}'")
        raise error
    _remove(temporary)


def files_beside(path: str | Path, without: Iterable[str | Path] = ()) -> Iterator[tuple[Path, os.stat_result]]:
    """List the files that a scene's file may name: those in its folder and below, in the order of their names.

    Names that begin with ``OWN_PREFIX`` are left out, and files that vanish meanwhile.

    Args:
        path: File of the scene.
        without: Files and folders that are left out, such as what a command writes.

    Yields:
        Each file, as the folder of ``path`` and the name below it, with its size and time.
    """
    left_out = {os.path.realpath(name) for name in without}
    for root, folders, names in os.walk(Path(path).parent):
        here = os.path.realpath(root)
        kept = {
            name
            for name in (*folders, *names)
            if not name.startswith(OWN_PREFIX) and os.path.join(here, name) not in left_out
        }
        folders[:] = sorted(kept.intersection(folders))
        for name in sorted(kept.intersection(names)):
            try:
                state = os.stat(os.path.join(root, name))
            except FileNotFoundError:
                continue
            if stat.S_ISREG(state.st_mode):
                yield Path(root, name), state


def write_atomically(path: str | Path, data: bytes | str) -> int:
    """Write a file so that it is either complete or absent; see ``whole_file``.

    Args:
        path: File to write.
        data: Contents; text is encoded as UTF-8.

    Returns:
        Length of the file, bytes.
    """
    raw = data.encode() if isinstance(data, str) else data
    with whole_file(path) as temporary:
        temporary.write_bytes(raw)
    return len(raw)


def save_arrays(path: str | Path, arrays: Mapping[str, np.ndarray], compressed: bool = False) -> None:
    """Write named arrays to an .npz file, atomically.

    Args:
        path: File to write.
        arrays: Name → array of any shape.
        compressed: Compress the arrays (deflate).
    """
    with whole_file(path) as temporary, open(temporary, "wb") as stream:
        save: Callable[..., None] = np.savez_compressed if compressed else np.savez
        save(stream, **arrays)


def load_arrays(
    path: str | Path,
    cure: str = "not a checkpoint; delete it and bake without --resume",
    limits: Limits | None = None,
) -> Arrays:
    """Read all arrays of an .npz file, without pickle.

    Args:
        path: The file.
        cure: Text of the error message for a file that is damaged or of another kind.
        limits: Limits on the unpacked size; default ``MOST_ARRAY_BYTES`` of decoded bytes.

    Returns:
        Name → array.

    Raises:
        ValueError: The file is damaged, or exceeds a limit; one line.
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
    """Compare the members of an .npz with limits and with their shapes, before memory is allocated."""
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
    """Return the beginning of an error's message, on one line."""
    return " ".join(str(error).split())[:120]


def prefixed(prefix: str, arrays: Mapping[str, np.ndarray]) -> Arrays:
    """Put arrays under a prefix.

    Args:
        prefix: First part of the names.
        arrays: Arrays [...] by name.

    Returns:
        The arrays under ``prefix.name``.
    """
    return {f"{prefix}.{name}": value for name, value in arrays.items()}


def under(prefix: str, arrays: Mapping[str, np.ndarray]) -> Arrays:
    """Select the arrays under a prefix: the inverse of ``prefixed``.

    Args:
        prefix: First part of the names.
        arrays: Arrays [...] by name.

    Returns:
        The arrays whose names begin with ``prefix.``, without it.
    """
    start = f"{prefix}."
    return {name[len(start) :]: value for name, value in arrays.items() if name.startswith(start)}


def flush(path: Path) -> None:
    """Wait until a file's data are on the disk.

    Args:
        path: An existing file.
    """
    with open(path, "rb+") as file:
        os.fsync(file.fileno())


def make_folder(path: str | Path) -> Path:
    """Create a folder and its missing parents; an existing folder is left as it is.

    Args:
        path: The folder.

    Returns:
        The folder.

    Raises:
        OSError: An error of the system; its one-line message names the cure.
    """
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        error = explained(error, f"create the folder '{path}'")
        raise error
    return path


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        pass  # the first failure is the one to report


def explained(error: OSError, attempt: str) -> OSError:
    """Make a copy of an error whose one-line message says what was attempted, the reason and the cure.

    Args:
        error: Error of the system.
        attempt: What failed, as an infinitive: ``write 'out.glb'``.

    Returns:
        An error of the same type and ``errno``.
    """
    cure = CURES.get(error.errno or 0, "choose another folder")
    reason = error.strerror or type(error).__name__
    return type(error)(error.errno, f"cannot {attempt}: {reason}; {cure}")
