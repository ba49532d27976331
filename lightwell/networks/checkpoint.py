"""Checkpoints of fits: names of their arrays, and restoring from arrays that may belong to another fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from lightwell.files import Arrays

# Last words of the names of arrays that may hold infinity or NaN: errors that have not been measured yet.
UNMEASURED = ("best_error", "errors", "least", "round_error", "history")


class Restorable(Protocol):
    """A fit whose state can be stored and restored."""

    def arrays(self) -> Arrays:
        """Return the state that a resumed training needs.

        Returns:
            Arrays [...] by name.
        """

    def restore(self, arrays: Arrays) -> None:
        """Restore the state of a fit of the same field, settings and samples; other arrays are a ``ValueError`` or a
        ``KeyError``.

        Args:
            arrays: Result of ``arrays``.
        """


def restore(fit: Restorable, arrays: Arrays) -> None:
    """Restore the state of a fit from a checkpoint that may be damaged or belong to another fit.

    Args:
        fit: Fit of the same field, preset and samples.
        arrays: Arrays [...] by name.

    Raises:
        ValueError: The arrays are not those of such a fit, or hold numbers that are not finite; one line.
    """
    try:
        for name, value in arrays.items():
            if value.dtype.kind not in "biufU":
                raise ValueError(f"'{name}' holds {value.dtype}")
            if value.dtype.kind == "f" and name.split(".")[-1] not in UNMEASURED and not np.isfinite(value).all():
                raise ValueError(f"'{name}' holds numbers that are not finite")
        fit.restore(arrays)
    except (ValueError, KeyError, TypeError, IndexError, OverflowError) as error:
        raise ValueError(f"the checkpoint does not fit ({' '.join(str(error).split())[:200]})") from error


def check_like(arrays: Mapping[str, np.ndarray], like: Mapping[str, np.ndarray], varying: tuple[str, ...] = ()) -> None:
    """Check that arrays have the names, shapes and types of others.

    Args:
        arrays: Arrays [...] to check, by name; further names are allowed.
        like: Expected arrays [...] by name.
        varying: Beginnings of the names of arrays whose shape depends on the progress of the training; not checked.

    Raises:
        ValueError: An array is missing or has another shape or type.
    """
    for name, value in like.items():
        if varying and name.startswith(varying):
            continue
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
