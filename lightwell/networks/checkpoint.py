"""Names of the arrays in checkpoints of fits."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lightwell.files import Arrays


def prefixed(prefix: str, arrays: Mapping[str, np.ndarray]) -> Arrays:
    """The arrays under ``prefix.name``."""
    return {f"{prefix}.{name}": value for name, value in arrays.items()}


def under(prefix: str, arrays: Mapping[str, np.ndarray]) -> Arrays:
    """What ``prefixed`` was given."""
    start = f"{prefix}."
    return {name[len(start) :]: value for name, value in arrays.items() if name.startswith(start)}
