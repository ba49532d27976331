"""Checkpoints of fits: names of their arrays, and reading of files that may be damaged or belong to another fit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from lightwell.files import Arrays, load_arrays

# Last words of the names of arrays that may hold infinity or NaN: errors that have not been measured yet.
UNMEASURED = ("best_error", "errors", "least", "round_error", "history")
CURE = "delete it and train again"


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


def read_checkpoint(path: str | Path, like: Mapping[str, np.ndarray], varying: tuple[str, ...] = ()) -> Arrays:
    """Read a checkpoint and check it against the arrays of the fit that is to be resumed.

    Args:
        path: An .npz file.
        like: Arrays [...] by name of a fit of the same field, preset and samples.
        varying: Beginnings of the names of arrays whose shape depends on the progress of the training; the fit checks
            them.

    Returns:
        The arrays of the file; those of ``like`` that do not vary have the same shapes and types.

    Raises:
        ValueError: The file is no checkpoint, or one of another fit, or holds numbers that are not finite.
    """
    arrays = load_arrays(path)
    fixed = {name: value for name, value in like.items() if not name.startswith(varying or ("/",))}
    with taking_up(path):
        check_like(arrays, fixed)
        for name, value in arrays.items():
            if value.dtype.kind not in "biufU":
                raise ValueError(f"'{name}' holds {value.dtype}")
            if value.dtype.kind == "f" and name.split(".")[-1] not in UNMEASURED and not np.isfinite(value).all():
                raise ValueError(f"'{name}' holds numbers that are not finite")
    return arrays


def check_like(arrays: Mapping[str, np.ndarray], like: Mapping[str, np.ndarray]) -> None:
    """Check that arrays have the names, shapes and types of others.

    Args:
        arrays: Arrays [...] to check, by name; further names are allowed.
        like: Expected arrays [...] by name.

    Raises:
        ValueError: An array is missing or has another shape or type.
    """
    for name, value in like.items():
        found = arrays.get(name)
        if found is None or found.shape != np.shape(value):
            shape = None if found is None else found.shape
            raise ValueError(f"'{name}' has shape {shape}, the network needs {np.shape(value)}")
        if found.dtype != np.asarray(value).dtype:
            raise ValueError(f"'{name}' holds {found.dtype}, the network needs {np.asarray(value).dtype}")


def check_rows(arrays: Mapping[str, np.ndarray], like: Mapping[str, np.ndarray], count: int) -> None:
    """Check arrays as ``check_like`` does, with another number of rows.

    Args:
        arrays: Arrays [count, ...] to check, by name.
        like: Expected arrays [any, ...] by name.
        count: Expected number of rows.
    """
    check_like(arrays, {name: np.empty((count, *value.shape[1:]), value.dtype) for name, value in like.items()})


@contextmanager
def taking_up(path: str | Path) -> Iterator[None]:
    """Add the name of the file and the cure to errors of a checkpoint whose content is inconsistent.

    Args:
        path: File that the checkpoint was read from.

    Yields:
        Nothing; read the content in the body of ``with``.

    Raises:
        ValueError: The body raised an error.
    """
    try:
        yield
    except (ValueError, KeyError, TypeError, IndexError, OverflowError) as error:
        message = str(error)
        if not message.startswith(f"{path}: "):
            message = f"{path}: does not fit ({' '.join(message.split())[:200]}); {CURE}"
        raise ValueError(message) from error


def counters(arrays: Mapping[str, np.ndarray]) -> tuple[int, int, int, float, list[tuple[int, float, float]]]:
    """Read and check the progress of a training.

    Args:
        arrays: Arrays of a checkpoint by name: ``step`` [3], ``history`` [K, 3], ``best_error`` scalar.

    Returns:
        Steps, samples seen, best step, best error and history [(step, loss, error)].

    Raises:
        ValueError: An array has the wrong shape or holds impossible values.
    """
    steps, history = arrays["step"], arrays["history"]
    if steps.shape != (3,) or steps.dtype.kind not in "iu" or (steps < 0).any():
        raise ValueError("'step' is not three counts")
    if history.ndim != 2 or history.shape[1] != 3 or not np.isfinite(history).all():
        raise ValueError("'history' is not rows of step, loss and error")
    best = float(arrays["best_error"])
    # Infinity before the first evaluation; afterwards an error.
    if not best >= 0:
        raise ValueError(f"'best_error' is {best}")
    step, seen, best_step = (int(v) for v in steps)
    if best_step and not math.isfinite(best):
        raise ValueError(f"'best_error' is {best} though step {best_step} was the best")
    return step, seen, best_step, best, [(int(s), float(a), float(b)) for s, a, b in history]
