"""Tables that are read without interpolation: rows (by number) and nearest (by place)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lightwell.graph.ops.example import Example, indices, unit_cube_tables
from lightwell.graph.ops.fetch import gather_row, table_width, upload_table
from lightwell.graph.ops.op import MAX_EXACT, MAX_WIDTH, Op, Parameter, Use, expect_width, register


def _rows_width(use: Use) -> int:
    expect_width(use, 0, 1, "an index")
    rows, channels = use.buffers["buffer"].shape
    use.expect(
        rows <= MAX_EXACT and channels <= MAX_WIDTH,
        f"at most {MAX_EXACT} rows of at most {MAX_WIDTH}",
        f"{[rows, channels]}",
        "split the table",
    )
    return channels


def rounded_index(index: np.ndarray, count: int) -> np.ndarray:
    """Round indices half up and clamp them to what there is.

    Args:
        index: [N, 1] indices.
        count: Number of things, ≥ 1.

    Returns:
        [N] int64 in 0 … count − 1.
    """
    return np.clip(np.floor(index[:, 0] + np.float32(0.5)), 0, count - 1).astype(np.int64)


def drjit_rounded_index(index: Any, count: int) -> Any:
    """Round indices half up and clamp them to what there is, with Dr.Jit.

    Args:
        index: Dr.Jit float, [N].
        count: Number of things, ≥ 1.

    Returns:
        Dr.Jit unsigned integers in 0 … count − 1, [N].
    """
    from lightwell.backend import dr, mi

    return mi.UInt32(dr.clip(dr.floor(index + 0.5), 0, count - 1))


def _drjit_rows(use: Use, index: Any) -> Any:
    rows, channels = use.buffers["buffer"].shape
    return gather_row(use.state["table"], drjit_rounded_index(index[0], rows), channels)


def _numpy_nearest(use: Use, p: np.ndarray) -> np.ndarray:
    """[N, 3] -> [N, C]. The last axis but one of the table is x."""
    table = use.values("buffer")
    sizes = np.asarray(table.shape[-2::-1], np.int64)  # in the order x, y, z
    at = np.clip(p, np.float32(0), np.float32(1)) * sizes.astype(np.float32)
    x, y, z = np.minimum(at.astype(np.int64), sizes - 1).T
    return table[z, y, x]


def _drjit_nearest(use: Use, p: Any) -> Any:
    from lightwell.backend import dr, mi

    shape = use.buffers["buffer"].shape
    row = mi.UInt32(0)
    for coordinate, size in zip(p[::-1], shape[:3]):
        row = row * size + dr.minimum(mi.UInt32(dr.clip(coordinate, 0, 1) * size), size - 1)
    return gather_row(use.state["table"], row, shape[-1])


def _rows_examples(rng: np.random.Generator) -> Iterator[Example]:
    for rows, channels in ((1, 3), (7, 4), (300, 6)):
        yield Example(f"{rows}x{channels}", (indices(rng, rows),), {"buffer": rng.normal(size=(rows, channels))})


ROWS = register(
    Op(
        name="rows",
        arity=(1, 1),
        parameters={"buffer": Parameter("buffer", ranks=(2,))},
        width=_rows_width,
        numpy=lambda use, index: use.values("buffer")[rounded_index(index, use.buffers["buffer"].shape[0])],
        drjit=_drjit_rows,
        fetches=lambda use: 1,
        prepare=upload_table,
        examples=_rows_examples,
    )
)

NEAREST = register(
    Op(
        name="nearest",
        arity=(1, 1),
        parameters={"buffer": Parameter("buffer", ranks=(4,))},
        width=table_width(3, "grid"),
        numpy=_numpy_nearest,
        drjit=_drjit_nearest,
        fetches=lambda use: 1,
        prepare=upload_table,
        examples=unit_cube_tables((1, 2, 3, 1), (4, 5, 6, 2), (3, 3, 3, 12)),
    )
)
