"""Copies of NumPy arrays on the device, aligned so that frozen functions accept them without recording again.

Dr.Jit wraps the memory of a NumPy array without copying it, and records a frozen function again for memory with another
alignment. Copies at multiples of ``ALIGNMENT`` bytes all have the same alignment, and later changes of the original do
not reach them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lightwell.backend import dr, mi

# Bytes of the widest vector registers.
ALIGNMENT = 64


def _aligned(array: np.ndarray, kind: type) -> np.ndarray:
    array = np.asarray(array, kind)
    memory = np.empty(array.nbytes + ALIGNMENT, np.uint8)
    begin = -memory.ctypes.data % ALIGNMENT
    copy: np.ndarray = memory[begin : begin + array.nbytes].view(kind).reshape(array.shape)
    copy[...] = array
    return copy


def tensor(array: np.ndarray) -> Any:
    """Copy an array to a float32 tensor.

    Args:
        array: [...] numbers.

    Returns:
        Tensor of the same shape.
    """
    return mi.TensorXf(_aligned(array, np.float32))


def integers(array: np.ndarray) -> Any:
    """Copy integers to the device.

    Args:
        array: [n] numbers of 0 … 2³² − 1.

    Returns:
        UInt32 of width n.
    """
    return mi.UInt32(_aligned(array, np.uint32))


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
