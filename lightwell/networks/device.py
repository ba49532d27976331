"""NumPy arrays on the device, so that frozen functions take them as they are.

Dr.Jit wraps the memory of a NumPy array without copying it, and records a frozen function anew for memory that is
aligned otherwise. Copies at multiples of ``ALIGNMENT`` bytes all look the same, and nobody can change them later.
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
    copy = memory[begin : begin + array.nbytes].view(kind).reshape(array.shape)
    copy[...] = array
    return copy


def tensor(array: np.ndarray) -> Any:
    """A float32 tensor of the same shape."""
    return mi.TensorXf(_aligned(array, np.float32))


def integers(array: np.ndarray) -> Any:
    """[n] numbers of 0 … 2³² − 1 as UInt32."""
    return mi.UInt32(_aligned(array, np.uint32))


def tensors(arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Named float32 tensors."""
    found = {name: tensor(value) for name, value in arrays.items()}
    dr.eval(found)
    return found
