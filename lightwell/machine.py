"""Processors and memory that this process may use, limits of containers (cgroups) included."""

from __future__ import annotations

import math
import os
from pathlib import Path

# Number of worker threads; the option --threads sets it for the process and for its children.
THREADS_VARIABLE = "LIGHTWELL_THREADS"
_CGROUP = Path("/sys/fs/cgroup")


def threads() -> int:
    """Count the worker threads that this process should use.

    Returns:
        ``LIGHTWELL_THREADS`` where it is set; else the processors of this machine, or fewer where the affinity of the
        process or its container allows fewer.

    Raises:
        ValueError: The variable is not a whole number of 1 or more.
    """
    text = os.environ.get(THREADS_VARIABLE, "")
    if text:
        if not text.isdecimal() or int(text) < 1:
            raise ValueError(f"{THREADS_VARIABLE}='{text}' is not a number of threads; give 1 or more")
        return int(text)
    return available_processors()


def available_processors(root: Path = _CGROUP) -> int:
    """Count the processors that this process may use.

    Args:
        root: Folder of the control groups.

    Returns:
        At least 1.
    """
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    share = _processor_share(root)
    return max(1, allowed if share is None else min(allowed, math.ceil(share)))


def _processor_share(root: Path) -> float | None:
    """Return the processors that the control group grants (version 2, then 1); None: all of them."""
    words = _words(root / "cpu.max") or [
        *_words(root / "cpu/cpu.cfs_quota_us"),
        *_words(root / "cpu/cpu.cfs_period_us"),
    ]
    if len(words) != 2 or not all(word.isdecimal() for word in words) or int(words[1]) == 0:
        return None
    return int(words[0]) / int(words[1])


def container_memory(root: Path = _CGROUP) -> int | None:
    """Return the memory that the container of this process may use.

    Args:
        root: Folder of the control groups.

    Returns:
        Bytes, or None where nothing but the machine limits it.
    """
    for name in ("memory.max", "memory/memory.limit_in_bytes"):
        words = _words(root / name)
        if words and words[0].isdecimal() and int(words[0]) < _physical_memory():
            return int(words[0])
    return None


def limit_memory(count: int) -> None:
    """Bound the memory that this process may allocate; beyond it an allocation fails, which is reported in one line.

    Does nothing on systems without such a limit (macOS, Windows).

    Args:
        count: Bytes of data, ≥ 1.
    """
    try:
        import resource
    except ImportError:
        return
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (count if most == resource.RLIM_INFINITY else min(count, most), most))


def _words(path: Path) -> list[str]:
    try:
        return path.read_text().split()
    except OSError:
        return []


def _physical_memory() -> float:
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return math.inf
