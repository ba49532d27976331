"""The store: keeps finished work between runs.

An entry is named by a hash of everything that it was made from (``keys.key``), so that it is never stale: other
settings give another name. Entries are written under a temporary name, flushed and renamed, so that an entry under its
final name is complete. Several processes may use a store at once: an entry that two need is made by one of them while
the other waits.

    FOLDER/samples.shard/3f2a….columns     a folder of arrays that are memory-mapped
    FOLDER/reference.view/90cd….npz        named arrays
    FOLDER/plan/77aa….json                 JSON
"""

from __future__ import annotations

import logging
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from filelock import FileLock

from lightwell.core.formats import ARRAYS, Format
from lightwell.core.keys import Key
from lightwell.files import DAMAGED, explained, make_folder

T = TypeVar("T")
LOG = logging.getLogger("lightwell.store")

# Largest size of the user's store, bytes; beyond it the least recently used entries are removed.
DEFAULT_LIMIT = 20_000_000_000
# A store beyond its limit is reduced to this fraction of it, so that the next entries do not trigger it again.
CUT_TO = 0.9
# Seconds after which a process counts all entries again: others may use the store too.
RECOUNT = 60.0
# Age in seconds from which a temporary file is taken to be left by a process that ended.
ABANDONED = 24 * 3600.0
# Endings of files that are being written, and of locks.
PART, LOCK = ".part", ".lock"
# Names of entries (``Store._path``), and of what is beside them while they are written. Others are files of the user,
# which are neither counted nor removed.
_ENTRY = re.compile(r"[0-9a-f]{40}\.[a-z0-9]+")
_BESIDE = re.compile(r"\.[0-9a-f]{4,40}\.[a-z0-9]+(\.\d+)*(\.part|\.lock)")


def default_folder() -> Path:
    """Return the folder of the user's store.

    Returns:
        The value of LIGHTWELL_STORE, else 'lightwell' in the platform's folder for caches.
    """
    if chosen := os.environ.get("LIGHTWELL_STORE"):
        return Path(chosen)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "lightwell"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "lightwell"


def user_store(folder: str | os.PathLike[str] | None = None) -> Store:
    """Open the user's store with the limit that LIGHTWELL_STORE_LIMIT sets.

    Args:
        folder: Folder of the store; None for ``default_folder``.

    Returns:
        The store.

    Raises:
        ValueError: LIGHTWELL_STORE_LIMIT is not a positive number of bytes.
    """
    text = os.environ.get("LIGHTWELL_STORE_LIMIT", str(DEFAULT_LIMIT))
    if not text.isascii() or not text.isdigit() or int(text) < 1:
        raise ValueError(
            f"store: LIGHTWELL_STORE_LIMIT is '{text[:40]}'; set it to a number of bytes, such as 20000000000"
        )
    return Store(folder or default_folder(), int(text))


@dataclass(frozen=True)
class Entry:
    """A stored result on disk."""

    path: Path
    """Its file or folder."""
    function: str
    """Name of the function that made it."""
    bytes: int
    """Size on disk."""
    used: float
    """Time of the last write or read, seconds since the epoch."""


class Store:
    """Results of expensive functions in a folder, by key."""

    def __init__(self, folder: str | os.PathLike[str], limit: int | None = DEFAULT_LIMIT) -> None:
        """Open a store; its folder is created when the first entry is written.

        Args:
            folder: Folder that only this store uses.
            limit: Largest size in bytes; beyond it the least recently used entries are removed. None: no limit.
        """
        self.folder = Path(folder)
        self.limit = limit
        # Bytes of all entries that this process knows of (None: not counted yet), and when it counted them.
        self._bytes: int | None = None
        self._counted = 0.0

    def get(self, key: Key, make: Callable[[], T], format: Format[T] = ARRAYS) -> T:  # type: ignore[assignment]
        """Return the result of a key; make and store it if it is absent.

        A damaged entry is made again, with a warning in the log. A folder that cannot be written is an ``OSError``
        whose message names the cure.

        Args:
            key: See ``keys.key``.
            make: Makes the result; called at most once, and by one process at a time.
            format: File format: ``ARRAYS``, ``COLUMNS``, ``JSON`` or a ``RecordFormat``.

        Returns:
            The result as the format reads it, also when it was just made.
        """
        path = self._path(key, format)
        if found := _read(path, format):
            return found[0]
        with self._locked(path):
            # Another process may have made it while this one waited.
            if found := _read(path, format):
                return found[0]
            self._write(path, make(), format)
            return format.read(path)

    def find(self, key: Key, format: Format[T] = ARRAYS) -> T | None:  # type: ignore[assignment]
        """Return the result of a key, if the store has it.

        Args:
            key: See ``keys.key``.
            format: File format of the entry.

        Returns:
            The result, or None when it is absent or damaged.
        """
        found = _read(self._path(key, format), format)
        return found[0] if found else None

    def put(self, key: Key, value: T, format: Format[T] = ARRAYS) -> None:  # type: ignore[assignment]
        """Store a value, replacing the present one, such as the next checkpoint of a training.

        A folder that cannot be written is an ``OSError`` whose message names the cure.

        Args:
            key: See ``keys.key``.
            value: The value.
            format: File format of the entry.
        """
        self._write(self._path(key, format), value, format)

    def update(self, key: Key, change: Callable[[T | None], T], format: Format[T] = ARRAYS) -> None:  # type: ignore[assignment]
        """Change the value of a key while other processes that want to change it wait.

        A folder that cannot be written is an ``OSError`` whose message names the cure.

        Args:
            key: See ``keys.key``.
            change: Takes the present value, or None when it is absent or damaged; returns the new one.
            format: File format of the entry.
        """
        path = self._path(key, format)
        with self._locked(path):
            found = _read(path, format)
            self._write(path, change(found[0] if found else None), format)

    def remove(self, key: Key, format: Format[T] = ARRAYS) -> None:  # type: ignore[assignment]
        """Remove the entry of a key, if it exists.

        Args:
            key: See ``keys.key``.
            format: File format of the entry.
        """
        _delete(self._path(key, format))

    # ------------------------------------------------------------------ all entries

    def entries(self) -> list[Entry]:
        """List all entries.

        Returns:
            The entries, least recently used first.
        """
        found = []
        for path in self.folder.glob("*/*"):
            if not _ENTRY.fullmatch(path.name):
                continue
            try:
                found.append(Entry(path, path.parent.name, _size(path), path.stat().st_mtime))
            except OSError:
                continue  # Another process has just removed it.
        return sorted(found, key=lambda entry: entry.used)

    def clear(self) -> int:
        """Remove all entries, except those that another process is writing.

        Returns:
            Their size in bytes.
        """
        entries = self.entries()
        for entry in entries:
            _delete(entry.path)
        self._bytes = None
        return sum(entry.bytes for entry in entries)

    def sweep(self, age: float = ABANDONED) -> None:
        """Remove the temporary files that killed processes left.

        Args:
            age: Least age of the files that are removed, seconds.
        """
        oldest = time.time() - age
        for path in self.folder.glob("*/.*"):
            try:
                if _BESIDE.fullmatch(path.name) and path.stat().st_mtime <= oldest:
                    _delete(path)
            except OSError:
                continue

    # ------------------------------------------------------------------ one entry

    def _path(self, key: Key, format: Format[T]) -> Path:
        return self.folder / key.function / f"{key.digest}{format.suffix}"

    def _write(self, path: Path, value: T, format: Format[T]) -> None:
        make_folder(path.parent)
        temporary = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}{PART}")
        _delete(temporary)
        try:
            format.write(temporary, value)
            _rename(temporary, path)
        except OSError as error:
            _delete(temporary)
            raise explained(error, f"write '{path}'") from error
        except BaseException:
            _delete(temporary)
            raise
        self._bound(_size(path))

    def _bound(self, added: int) -> None:
        """Count an entry; remove the least recently used ones when the store exceeds its limit."""
        if self.limit is None:
            return
        old = time.monotonic() - self._counted > RECOUNT
        self._bytes = None if self._bytes is None or old else self._bytes + added
        if self._bytes is not None and self._bytes <= self.limit:
            return
        self._counted = time.monotonic()
        self.sweep()
        entries = self.entries()
        self._bytes = sum(entry.bytes for entry in entries)
        if self._bytes <= self.limit:
            return
        # The newest entry stays, whatever its size: the caller reads it next.
        for entry in entries[:-1]:
            if self._bytes <= CUT_TO * self.limit:
                break
            _delete(entry.path)
            self._bytes -= entry.bytes

    @contextmanager
    def _locked(self, path: Path) -> Iterator[None]:
        """Hold the lock of an entry. The system releases it when the process ends, also when it is killed."""
        make_folder(path.parent)
        name = path.with_name(f".{path.name}{LOCK}")
        lock = FileLock(name)
        try:
            lock.acquire()
        except (OSError, NotImplementedError):
            # A file system without locks: at worst two processes do the same work, and one result is dropped.
            yield
            return
        try:
            yield
        finally:
            _delete(name)
            lock.release()


def _read(path: Path, format: Format[T]) -> tuple[T] | None:
    """The entry, or None; a damaged one is removed, with a warning in the log."""
    try:
        value = format.read(path)
    except FileNotFoundError:
        return None
    except (*DAMAGED, AttributeError, RecursionError) as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        LOG.warning("store: '%s' is damaged and is made again (%s)", path, reason)
        _delete(path)
        return None
    try:
        os.utime(path)
    except OSError:
        pass  # A store that cannot be written can still be read.
    return (value,)


def _rename(temporary: Path, path: Path) -> None:
    """Give a finished entry its name; a folder that has the name is removed first, as folders cannot be replaced."""
    if temporary.is_dir() and path.exists():
        _delete(path)
    os.replace(temporary, path)
    _flush_folder(path.parent)


def _flush_folder(folder: Path) -> None:
    """Flush the names in a folder to the disk, where the system can (not on Windows)."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:
        pass
    finally:
        os.close(handle)


def _size(path: Path) -> int:
    if path.is_dir():
        return sum(file.stat().st_size for file in path.iterdir())
    return path.stat().st_size


def _delete(path: Path) -> None:
    """Remove a file or folder, if it exists; a folder is renamed first, so that nobody sees it half removed."""
    try:
        if path.is_dir():
            doomed = path.with_name(f".{path.name}.{os.getpid()}.{time.monotonic_ns()}{PART}")
            os.replace(path, doomed)
            shutil.rmtree(doomed, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    except OSError:
        pass  # Another process was faster.
