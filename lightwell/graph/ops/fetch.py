"""Interpolated tables: texture (bilinear) and grid (trilinear)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from lightwell.graph.ops.example import unit_cube_tables
from lightwell.graph.ops.op import MAX_WIDTH, Op, Parameter, Use, expect_width, register

# Longest side of a table: the size of texture that every WebGL2 device takes.
MAX_SIDE = 4096


def table_width(dimensions: int, kind: str) -> Callable[[Use], int]:
    """Make the width rule of a table that is read at a point: as wide as the table has channels.

    Args:
        dimensions: Axes of the table without the channels, the width of the point.
        kind: What the table is called in messages.

    Returns:
        The rule, a function of the use of an op.
    """

    def width(use: Use) -> int:
        expect_width(use, 0, dimensions, "coordinates")
        shape = use.buffers["buffer"].shape
        use.expect(
            max(shape[:-1]) <= MAX_SIDE and shape[-1] <= MAX_WIDTH,
            f"a {kind} of at most {MAX_SIDE} a side",
            f"{list(shape)}",
            "resample it",
        )
        return shape[-1]

    return width


def _numpy_interpolate(use: Use, p: np.ndarray) -> np.ndarray:
    """Multilinear fetch, clamped, texel centres at (i + ½) / size: [N, D] -> [N, C]. The last axis but one is x."""
    table = use.values("buffer")
    sizes = np.asarray(table.shape[-2::-1], np.int32)  # in the order x, y, z
    at = np.clip(p, np.float32(0), np.float32(1)) * sizes.astype(np.float32) - np.float32(0.5)
    at = np.clip(at, np.float32(0), (sizes - 1).astype(np.float32))
    low = np.minimum(at.astype(np.int32), sizes - 1)
    high = np.minimum(low + 1, sizes - 1)
    fraction = at - low.astype(np.float32)
    out = np.zeros((len(p), table.shape[-1]), np.float32)
    for corner in range(1 << len(sizes)):
        upper = np.array([corner >> axis & 1 for axis in range(len(sizes))], bool)
        index = np.where(upper, high, low)
        weight = np.where(upper, fraction, np.float32(1) - fraction).prod(axis=1, keepdims=True, dtype=np.float32)
        out += weight * table[tuple(index.T[::-1])]
    return out


def upload_table(use: Use) -> dict[str, Any]:
    """Upload the numbers of the parameter ``buffer`` for Dr.Jit.

    Args:
        use: Use of the op.

    Returns:
        "table" to the flat array.
    """
    from lightwell.backend import dr, upload_floats

    table = upload_floats(use.values("buffer").ravel())
    dr.make_opaque(table)
    return {"table": table}


def _drjit_interpolate(use: Use, p: Any) -> Any:
    from lightwell.backend import dr, mi

    shape = use.buffers["buffer"].shape
    sizes, channels = shape[-2::-1], shape[-1]
    low, high, fraction = [], [], []
    for coordinate, size in zip(p, sizes):
        at = dr.clip(dr.clip(coordinate, 0, 1) * size - 0.5, 0, size - 1)
        low.append(mi.UInt32(at))
        high.append(dr.minimum(low[-1] + 1, size - 1))
        fraction.append(at - mi.Float(low[-1]))
    out = [mi.Float(0)] * channels
    for corner in range(1 << len(sizes)):
        index, weight, stride = mi.UInt32(0), mi.Float(1), 1
        for axis, size in enumerate(sizes):
            upper = corner >> axis & 1
            index += (high if upper else low)[axis] * stride
            weight *= fraction[axis] if upper else 1 - fraction[axis]
            stride *= size
        texel = gather_row(use.state["table"], index, channels)
        out = [total + weight * value for total, value in zip(out, texel)]
    return out


def gather_row(table: Any, row: Any, channels: int) -> list[Any]:
    """Read neighbouring floats of a flat table in as few loads as their number allows.

    Args:
        table: Flat Dr.Jit array of rows.
        row: Dr.Jit index of the row, [N].
        channels: Floats of a row.

    Returns:
        ``channels`` Dr.Jit floats, [N] each.
    """
    from lightwell.backend import dr, mi

    packets = {4: mi.Vector4f, 2: mi.Vector2f}
    for size, packet in packets.items():
        if channels % size == 0:
            per_row = channels // size
            loads: list[Any] = [dr.gather(packet, table, row * per_row + i) for i in range(per_row)]
            return [component for load in loads for component in load]
    return [dr.gather(mi.Float, table, row * channels + i) for i in range(channels)]


TEXTURE = register(
    Op(
        name="texture",
        arity=(1, 1),
        parameters={"buffer": Parameter("buffer", ranks=(3,))},
        width=table_width(2, "texture"),
        numpy=_numpy_interpolate,
        drjit=_drjit_interpolate,
        fetches=lambda use: 4,
        prepare=upload_table,
        examples=unit_cube_tables((1, 1, 3), (5, 7, 4), (8, 4, 6), (3, 9, 1), (4, 4, 2)),
    )
)

GRID = register(
    Op(
        name="grid",
        arity=(1, 1),
        parameters={"buffer": Parameter("buffer", ranks=(4,))},
        width=table_width(3, "grid"),
        numpy=_numpy_interpolate,
        drjit=_drjit_interpolate,
        fetches=lambda use: 8,
        prepare=upload_table,
        examples=unit_cube_tables((1, 2, 3, 1), (4, 5, 6, 2), (3, 3, 3, 12), (2, 3, 4, 3)),
    )
)
