"""Options of every verb that computes: processors, memory, and a log file."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import lightwell
from lightwell.core.options import parsed
from lightwell.core.units import byte_count
from lightwell.machine import THREADS_VARIABLE, limit_memory

LOG = logging.getLogger("lightwell")
# What lightwell and its libraries take before any scene is loaded, rounded up, bytes.
LEAST_MEMORY = 1_000_000_000
_FORMAT = "%(asctime)s %(levelname)-7s %(message)s"


def add_machine_options(parser: argparse.ArgumentParser) -> argparse._ActionsContainer:
    """Add ``--threads``, ``--memory`` and ``--log``.

    Args:
        parser: Parser to add to.

    Returns:
        Their group.
    """
    group = parser.add_argument_group("this machine")
    group.add_argument(
        "--threads", type=int, metavar="N", help="worker threads (default: the processors that the process may use)"
    )
    group.add_argument(
        "--memory", metavar="SIZE", help="memory that the process may take, such as 4GB (default: what there is)"
    )
    group.add_argument("--log", metavar="FILE", help="append what is done, with times, to a file")
    return group


def apply_machine_options(arguments: argparse.Namespace) -> None:
    """Set threads and memory of this process; before Mitsuba is imported.

    Args:
        arguments: Parsed arguments.

    Raises:
        ValueError: A number is out of range, or a size cannot be read.
    """
    threads = getattr(arguments, "threads", None)
    if threads is not None:
        if threads < 1:
            raise ValueError(f"{arguments.verb}: --threads {threads} is too small; give 1 or more")
        os.environ[THREADS_VARIABLE] = os.environ["OMP_NUM_THREADS"] = str(threads)
    memory = getattr(arguments, "memory", None)
    if memory is not None:
        count = parsed(arguments.verb, "--memory", memory, byte_count)
        if count < LEAST_MEMORY:
            raise ValueError(f"{arguments.verb}: --memory {memory} is too small; give 1GB or more")
        limit_memory(count)


@contextmanager
def logged(path: str | None, words: Sequence[str]) -> Iterator[None]:
    """Write a log while a command runs: its words, messages of lightwell, and how it ended.

    Args:
        path: File to append to; None: no log.
        words: Words of the command line.

    Yields:
        Nothing.

    Raises:
        OSError: The file cannot be written.
        BaseException: Whatever ends the command; it is logged.
    """
    if path is None:
        yield
        return
    try:
        handler = logging.FileHandler(Path(path), encoding="utf-8")
    except OSError as error:
        raise OSError(error.errno, error.strerror, f"--log {path}") from None
    handler.setFormatter(logging.Formatter(_FORMAT))
    level = LOG.level
    LOG.addHandler(handler)
    LOG.setLevel(logging.INFO)
    start = time.perf_counter()
    LOG.info("lightwell %s, Python %s: lightwell %s", lightwell.__version__, sys.version.split()[0], " ".join(words))
    try:
        yield
        LOG.info("ended after %.1f s", time.perf_counter() - start)
    except BaseException as error:
        LOG.error("%s: %s", type(error).__name__, " ".join(str(error).split()))
        raise
    finally:
        LOG.setLevel(level)
        LOG.removeHandler(handler)
        handler.close()
