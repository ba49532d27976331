"""Quantise values to 16-bit integers: charges with a sum of exactly zero, kernels with a sum of exactly one.

A spreadlet's values are q_k · scale with |q_k| ≤ ``LARGEST``. Rounding errors are carried along the stored order of
the points, so that the sum is exact and no error accumulates in one place.
"""

from __future__ import annotations

import numpy as np

# Largest magnitude of a stored value: int16 without its lowest value.
LARGEST = 32767


def angular_order(px: np.ndarray, py: np.ndarray) -> np.ndarray:
    """Order points as a walk to the nearest unvisited neighbour, so that a carried remainder stays near its origin.

    The walk starts at the point of the smallest angle around the centre. Ties go to the smaller index.

    Args:
        px: Integer x of the points [n].
        py: Integer y of the points [n].

    Returns:
        Order [n] int64.
    """
    n = len(px)
    left = np.ones(n, bool)
    order = np.empty(n, np.int64)
    at = int(np.lexsort((py, px, np.arctan2(py, px)))[0]) if n else 0
    for step in range(n):
        order[step] = at
        left[at] = False
        if step + 1 < n:
            distance = (px - px[at]) ** 2 + (py - py[at]) ** 2
            at = int(np.argmin(np.where(left, distance, np.iinfo(np.int64).max)))
    return order


def quantise_charges(values: np.ndarray) -> tuple[np.ndarray, float]:
    """Quantise charges so that their integer sum is zero.

    Args:
        values: Charges [n] that sum to nearly zero.

    Returns:
        q [n] int16 with Σ q = 0, and the scale: values ≈ q · scale. A sum far from zero raises ``ValueError``.
    """
    largest = float(np.abs(values).max())
    scale = float(np.float32(largest / (LARGEST - 1)))
    return _carried(values / scale, 0), scale


def quantise_kernel(values: np.ndarray) -> tuple[np.ndarray, float]:
    """Quantise the values of a primal kernel so that it keeps its mass.

    Args:
        values: Values [n], ≥ 0.

    Returns:
        q [n] int16 ≥ 0, and the scale Σ values / Σ q.
    """
    unit = float(values.max()) / LARGEST
    q = np.rint(values / unit).astype(np.int64)
    return q.astype(np.int16), float(np.float32(values.sum() / q.sum()))


def _carried(real: np.ndarray, total: int) -> np.ndarray:
    """Round real numbers to integers with a given sum, by carrying the remainder to the next one."""
    steps = np.diff(np.rint(np.cumsum(real)), prepend=0.0).astype(np.int64)
    steps[-1] += total - steps.sum()
    # A step is within one of its value, so that values up to LARGEST − 1 stay in range.
    if len(steps) and np.abs(steps).max() > LARGEST:
        raise ValueError("lens: the values of a spreadlet do not sum to zero; solve them with the zero-sum constraint")
    return steps.astype(np.int16)
