"""Tensors on the device, aligned so that frozen functions accept them without recording again.

They are copies: later changes of the NumPy arrays do not reach them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lightwell.backend import aligned, dr, mi


def tensor(array: np.ndarray) -> Any:
    """Copy an array to a float32 tensor.

    Args:
        array: [...] numbers.

    Returns:
        Tensor of the same shape.
    """
    return mi.TensorXf(aligned(array, np.float32))


def tensors(arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Copy named arrays to float32 tensors.

    Args:
        arrays: Arrays [...] by name.

    Returns:
        Tensors of the same shapes.
    """
    found = {name: tensor(value) for name, value in arrays.items()}
    dr.eval(found)
    return found
