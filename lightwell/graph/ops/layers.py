"""How a kernel multiplies a small stored matrix with one vector per lane: cooperative vectors, or gathered rows.

Dr.Jit 1.5 has cooperative vectors of 32-bit floats on the processor only. On CUDA it has them in half precision, for
matrices in its own layout. What must agree with NumPy to 1e-5 reads the weights by gathers there.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from lightwell.graph.ops.fetch import gather_row

# Largest layer, in multiply-adds, whose instructions are written out one by one.
WRITTEN_OUT = 2048


@functools.cache
def cooperative() -> bool:
    """Find out whether this backend has cooperative vectors of 32-bit floats.

    Returns:
        True on the processor, False on CUDA.
    """
    from lightwell.backend import ACTIVE

    return not ACTIVE.variant.startswith("cuda")


@functools.cache
def half_cooperative() -> bool:
    """Find out by a trial whether this backend has cooperative vectors of half floats.

    Returns:
        False on the processor, which needs none, and on GPUs or drivers that refuse them.
    """
    if cooperative():
        return False
    from lightwell.backend import dr, mi

    try:
        import drjit.nn as nn

        (weights,) = pack_half([np.ones((16, 16), np.float32)])
        out = nn.matvec(weights, half_vector([mi.Float(1)] * 16))
        return float(mi.Float(next(iter(out)))[0]) == 16
    except RuntimeError:
        return False
    finally:
        dr.sync_thread()


def pack_half(matrices: list[Any]) -> tuple[Any, ...]:
    """Pack matrices as half floats in the layout of cooperative vectors.

    Args:
        matrices: [out, in] arrays or tensors, rounded to half floats.

    Returns:
        One view per matrix.
    """
    import drjit.nn as nn

    from lightwell.backend import dr, mi

    tensor = dr.tensor_t(dr.float16_array_t(mi.Float))
    packed = nn.pack(*[tensor(mi.TensorXf(m)) for m in matrices], layout="inference")
    return packed if isinstance(packed, tuple) else (packed,)


def half_vector(components: list[Any]) -> Any:
    """Make a cooperative vector of half floats.

    Args:
        components: [N] floats each.

    Returns:
        The vector.
    """
    import drjit.nn as nn

    from lightwell.backend import dr, mi

    half = dr.float16_array_t(mi.Float)
    return nn.CoopVec(*[half(c) for c in components])


def row_stride(inputs: int) -> int:
    """Return the floats of a row of weights with its bias, in whole packets of four.

    Args:
        inputs: Weights of a row.

    Returns:
        Floats from one row to the next.
    """
    return -(-(inputs + 1) // 4) * 4


def gathered_rows(weights: np.ndarray, bias: np.ndarray) -> Any:
    """Upload rows of weights with the bias behind them.

    Args:
        weights: [experts, out, in].
        bias: [experts, out].

    Returns:
        Flat Dr.Jit array of [experts * out, ``row_stride``].
    """
    from lightwell.backend import dr, upload_floats

    rows = np.zeros((*bias.shape, row_stride(weights.shape[2])), np.float32)
    rows[..., : weights.shape[2]], rows[..., weights.shape[2]] = weights, bias
    table = upload_floats(rows.ravel())
    dr.make_opaque(table)
    return table


def row_table(matrix: Any) -> Any:
    """Lay a matrix that is on the device out as ``gathered_rows`` does, without biases.

    Args:
        matrix: Tensor [out, in].

    Returns:
        Flat Dr.Jit array of [out, ``row_stride``].
    """
    from lightwell.backend import dr, mi

    outputs, inputs = matrix.shape
    stride = row_stride(inputs)
    at = dr.arange(mi.UInt32, outputs * stride)
    column = at % stride
    table = dr.gather(mi.Float, matrix.array, at // stride * inputs + column, column < inputs)
    dr.eval(table)
    return table


def gathered_product(table: Any, first: Any, outputs: int, x: list[Any]) -> list[Any]:
    """Multiply rows of a table with a vector and add the bias behind each row.

    Small products are written out; large ones loop over the rows, because compilers take minutes for tens of thousands
    of instructions.

    Args:
        table: Result of ``gathered_rows``.
        first: Index of the first row, a Dr.Jit integer of width N or 1.
        outputs: Number of rows.
        x: Components of the vector, [N] floats each.

    Returns:
        ``outputs`` floats, [N] each.
    """
    if outputs * len(x) <= WRITTEN_OUT:
        return [_row_product(table, first + row, x) for row in range(outputs)]
    from lightwell.backend import dr, mi

    def body(row: Any, results: Any) -> tuple[Any, Any]:
        results.write(_row_product(table, first + row, x), row)
        return row + 1, results

    # A loop is as wide as its state.
    row = dr.zeros(mi.UInt32, max(dr.width(first), *(dr.width(component) for component in x)))
    _, results = dr.while_loop(
        (row, dr.alloc_local(mi.Float, outputs)), lambda row, results: row < outputs, body, labels=("row", "results")
    )
    return [results.read(mi.UInt32(i)) for i in range(outputs)]


def _row_product(table: Any, row: Any, x: list[Any]) -> Any:
    from lightwell.backend import dr

    numbers = gather_row(table, row, row_stride(len(x)))
    total = numbers[len(x)]
    for weight, component in zip(numbers, x):
        total = dr.fma(weight, component, total)
    return total
