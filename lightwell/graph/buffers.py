"""Typed storage of weights and tables, and how it is quantised."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

TYPES = {"float32": np.float32, "float16": np.float16, "int8": np.int8, "uint8": np.uint8}
# Largest magnitude used of a signed byte: -128 is left out, so that zero is in the middle.
INT8_STEPS = 127
UINT8_STEPS = 255


@dataclass(frozen=True)
class Buffer:
    """A stored array: float32, float16, or bytes with value = stored · scale + offset."""

    array: np.ndarray
    """Stored numbers; the dtype is the storage type."""
    type: str = "float32"
    """One of ``TYPES``."""
    scale: np.ndarray | None = None
    """Step of an integer type, float32: [] or one per index of the first axis, or of the first two."""
    offset: float = 0.0
    """Value of a stored zero of an integer type."""

    def __post_init__(self) -> None:
        if self.type not in TYPES:
            raise ValueError(f"buffer: expected type {', '.join(TYPES)}, found '{self.type}'; convert it")
        object.__setattr__(self, "array", np.ascontiguousarray(self.array, TYPES[self.type]))
        if self.scale is not None:
            object.__setattr__(self, "scale", np.asarray(self.scale, np.float32))

    def __repr__(self) -> str:
        return f"<Buffer {self.type} {list(self.shape)}, {self.nbytes:,} bytes>"

    @property
    def shape(self) -> tuple[int, ...]:
        return self.array.shape

    @property
    def nbytes(self) -> int:
        """Bytes of the stored numbers and their scales."""
        scales = self.scale.size if self.scale is not None else 0
        return self.array.nbytes + 4 * scales

    @cached_property
    def _values(self) -> np.ndarray:
        values = self.array.astype(np.float32)
        if self.scale is not None:
            values = values * self.row_scale() + np.float32(self.offset)
        values.flags.writeable = False
        return values

    def values(self) -> np.ndarray:
        """Return the stored numbers as they are read, dequantised.

        Returns:
            [...] float32, of the stored shape, read-only.
        """
        return self._values

    def row_scale(self) -> np.ndarray:
        """Return the step of each stored number.

        Returns:
            float32 scalar, or an array that broadcasts against the stored one.
        """
        if self.scale is None or self.scale.size == 1:
            return np.float32(1 if self.scale is None else self.scale.ravel()[0])
        leading = leading_axes(self.shape, self.scale.size)
        return self.scale.reshape(self.shape[:leading] + (1,) * (self.array.ndim - leading))


def leading_axes(shape: tuple[int, ...], count: int) -> int:
    """Find the axes that a list of scales belongs to.

    Args:
        shape: Shape of the stored array.
        count: Number of scales.

    Returns:
        1 or 2 for one scale per index of the first axis or of the first two; 0 when ``count`` fits neither.
    """
    for axes in (1, 2):
        if len(shape) >= axes and int(np.prod(shape[:axes], dtype=np.int64)) == count:
            return axes
    return 0


def pack(values: np.ndarray, type: str, *, per_row: bool = True) -> Buffer:
    """Store float32 values in a smaller type, rounded to nearest.

    Integer types take their step from the range of the values: ``int8`` is symmetric about zero, ``uint8`` runs from
    the least to the greatest value.

    Args:
        values: [...] numbers.
        type: "float32", "float16", "int8" or "uint8".
        per_row: Give every output row of [out, in] or [experts, out, in] weights a step of its own (``int8`` only).

    Returns:
        The buffer.

    Raises:
        ValueError: The type is unknown, or a magnitude exceeds the range of float16.
    """
    values = np.asarray(values, np.float32)
    if type == "float32":
        return Buffer(values)
    if type == "float16":
        limit = np.float32(np.finfo(np.float16).max)
        if values.size and np.abs(values).max() > limit:
            raise ValueError(f"buffer: expected magnitudes up to {limit} for float16, found more; keep float32")
        return Buffer(values.astype(np.float16), "float16")
    if type == "int8":
        axes = tuple(range(values.ndim - 1, values.ndim)) if per_row and values.ndim in (2, 3) else None
        largest = np.abs(values).max(axis=axes, keepdims=axes is not None)
        scale = np.where(largest > 0, largest / INT8_STEPS, 1).astype(np.float32)
        stored = np.clip(np.rint(values / scale), -INT8_STEPS, INT8_STEPS)
        return Buffer(stored, "int8", scale.ravel())
    if type == "uint8":
        low, high = float(values.min()), float(values.max())
        scale = np.float32((high - low) / UINT8_STEPS if high > low else 1.0)
        stored = np.clip(np.rint((values - np.float32(low)) / scale), 0, UINT8_STEPS)
        return Buffer(stored, "uint8", scale, low)
    raise ValueError(f"buffer: expected type {', '.join(TYPES)}, found '{type}'; choose one of them")
