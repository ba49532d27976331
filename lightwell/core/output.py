"""Output folders: one writer at a time, and files of other programs are not overwritten."""

from __future__ import annotations

import functools
import json
import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Protocol, TypeVar

from filelock import FileLock, Timeout

import lightwell
from lightwell.files import write_atomically

# Lock of a folder, and a description of its holder. Both exist only while a command writes, or after it was killed.
LOCK, HOLDER = ".lightwell.lock", ".lightwell.holder.json"
# Files that identify a folder as written by lightwell, and a key that their JSON then contains.
OWN_FILES = {
    "report.json": "versions",
    "compare.json": "versions",
    "rebake.json": "roles",
    "batch.json": "scenes",
    "animation.json": "frames",
    HOLDER: "generator",
    ".lightwell/bake.json": "signature",
}
# Files that commands write; patterns of ``Path.glob``.
BAKE_FILES = ("scene.glb", "*.html", "report.json", "rebake.json", "probes-*.lwp")
BATCH_FILES = ("batch.html", "batch.json")
COMPARE_FILES = ("compare.html", "compare.json")
FRAME_FILES = ("frame-*.exr", "frame-*.png", "animation.json", "exposure.txt", "radiance-cache.npz")


class HasOutput(Protocol):
    """Settings of a command that writes a folder."""

    out: Path
    """Folder to write."""
    force: bool
    """Overwrite files that lightwell did not write."""


Settings = TypeVar("Settings", bound=HasOutput)
Result = TypeVar("Result")


@contextmanager
def output_folder(out: Path, command: str, writes: Sequence[str], force: bool = False) -> Iterator[Path]:
    """Hold an output folder for the time of a block; create it first.

    The operating system releases the lock when the process ends, also when it is killed.

    Args:
        out: Folder to write.
        command: Name of the command, for messages.
        writes: Patterns of the files that the command writes.
        force: Overwrite files that lightwell did not write.

    Yields:
        ``out``. A folder that is in use, cannot be written, or holds files of other programs is a one-line
        ``ValueError`` that names the cure.
    """
    fresh = _make(out, command)
    try:
        _check_files(out, command, writes, force)
        with _lock(out, command):
            yield out
    finally:
        if fresh:
            _remove_empty(out)


def holds_output(
    command: str, writes: Callable[[Settings], Sequence[str]]
) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Return a decorator that holds the output folder of a command while it runs.

    Args:
        command: Name of the command, for messages.
        writes: Returns the patterns of the files that the command writes, for its settings.

    Returns:
        Decorator for functions whose first argument has ``out`` and ``force``.
    """

    def decorate(function: Callable[..., Result]) -> Callable[..., Result]:
        @functools.wraps(function)
        def held(settings: Settings, *arguments: Any, **named: Any) -> Result:
            with output_folder(settings.out, command, writes(settings), settings.force):
                return function(settings, *arguments, **named)

        return held

    return decorate


def _make(out: Path, command: str) -> bool:
    """Create the folder; return whether it was new."""
    if out.exists() and not out.is_dir():
        raise ValueError(f"{command}: output '{out}' is a file; name a folder with -o")
    fresh = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"{command}: cannot create output folder '{out}' ({error.strerror}); choose another with -o"
        ) from error
    return fresh


def _check_files(out: Path, command: str, writes: Sequence[str], force: bool) -> None:
    if force or is_own(out):
        return
    found = sorted(path.relative_to(out).as_posix() for pattern in writes for path in out.glob(pattern))
    if found:
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        raise ValueError(
            f"{command}: '{out}' holds '{found[0]}'{more}, which lightwell did not write; "
            "choose another folder with -o, or overwrite with --force"
        )


def is_own(out: Path) -> bool:
    """Return whether lightwell wrote a folder.

    Args:
        out: The folder.

    Returns:
        True when it holds a report of lightwell, or the files that an interrupted command leaves.
    """
    for name, key in OWN_FILES.items():
        try:
            found = json.loads((out / name).read_text())
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(found, dict) and key in found:
            return True
    return False


@contextmanager
def _lock(out: Path, command: str) -> Iterator[None]:
    lock = FileLock(out / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise ValueError(
            f"{command}: '{out}' is in use by {_holder(out)}; wait until that ends, or choose another folder with -o"
        ) from None
    except OSError as error:
        raise ValueError(
            f"{command}: cannot write to output folder '{out}' ({error.strerror}); "
            "choose another with -o or free some space"
        ) from error
    try:
        since = datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
        holder: dict[str, Any] = {"generator": f"lightwell {lightwell.__version__}", "command": command}
        holder |= {"pid": os.getpid(), "host": socket.gethostname(), "since": since}
        write_atomically(out / HOLDER, json.dumps(holder))
        yield
    finally:
        # Removed while the lock is held; filelock notices where another process waits at the removed file.
        for name in (HOLDER, LOCK):
            (out / name).unlink(missing_ok=True)
        lock.release()


def _holder(out: Path) -> str:
    try:
        found = json.loads((out / HOLDER).read_text())
        return f"'lightwell {found['command']}', process {int(found['pid'])} on {found['host']}, since {found['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another lightwell process"


def _remove_empty(out: Path) -> None:
    try:
        out.rmdir()
    except OSError:
        pass  # It holds what the command wrote.
