"""Multi-resolution hash grid: Müller et al., Instant Neural Graphics Primitives with a Multiresolution Hash Encoding,
2022. `format/FORMAT.md` gives the exact definition that every runtime shares.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.graph.ops.example import Example, coordinates
from lightwell.graph.ops.fetch import gather_row, upload_table
from lightwell.graph.ops.op import Op, Parameter, Use, expect_width, register

# Primes of the spatial hash, from the paper; the first is 1 so that neighbours in x stay neighbours in memory.
PRIMES = (1, 2654435761, 805459861)
# Finest lattice: (cells + 1)³ must not leave 64 bits, and cells * x must resolve in 32-bit floats.
MAX_CELLS = 1 << 16


@dataclass(frozen=True)
class HashGridLevel:
    """One lattice of a hash grid."""

    cells: int
    """Cells along each axis; there are cells + 1 vertices."""
    offset: int
    """First entry of the level in the buffer."""
    entries: int
    """Entries of the level."""
    dense: bool
    """Whether every vertex has an entry of its own."""


def levels(count: int, base: float, growth: float, entries_log2: int) -> list[HashGridLevel]:
    """Lay out the levels of a hash grid (Müller et al. 2022).

    Args:
        count: Number of levels, ≥ 1.
        base: Cells along an edge of the first level.
        growth: Factor of the cells from level to level, ≥ 1.
        entries_log2: Logarithm of the most entries of a level; a level of more vertices is hashed.

    Returns:
        Vertices along an edge, entries and offset of each level.
    """
    out, offset, size = [], 0, float(base)
    for _ in range(count):
        # The slack makes a size that is meant to be whole, such as 16 · 1.26ⁿ = 32, whole in every language.
        cells = math.floor(min(size, float(MAX_CELLS)) + 1e-6)
        dense = (cells + 1) ** 3 <= 1 << entries_log2
        entries = (cells + 1) ** 3 if dense else 1 << entries_log2
        out.append(HashGridLevel(cells, offset, entries, dense))
        offset, size = offset + entries, size * float(growth)
    return out


def _levels(use: Use) -> list[HashGridLevel]:
    return levels(use["levels"], use["base"], use["growth"], use["entries_log2"])


def _width(use: Use) -> int:
    expect_width(use, 0, 3, "a point")
    entries, channels = use.buffers["buffer"].shape
    last = _levels(use)[-1]
    expected = last.offset + last.entries
    use.expect(
        entries == expected, f"a buffer of {expected} entries", f"{entries}", "match levels, base, growth, entries_log2"
    )
    return use["levels"] * channels


def _numpy_hashgrid(use: Use, p: np.ndarray) -> np.ndarray:
    """[N, 3] -> [N, levels * channels], level-major."""
    table = use.values("buffer")
    clamped = np.clip(p, np.float32(0), np.float32(1))
    out = []
    for level in _levels(use):
        at = clamped * np.float32(level.cells)
        low = np.minimum(at.astype(np.uint32), np.uint32(level.cells - 1))
        fraction = at - low.astype(np.float32)
        total = np.zeros((len(p), table.shape[1]), np.float32)
        for corner in range(8):
            upper = np.array([corner >> axis & 1 for axis in range(3)], np.uint32)
            weight = np.where(upper, fraction, np.float32(1) - fraction).prod(axis=1, keepdims=True, dtype=np.float32)
            total += weight * table[level.offset + _entry(level, low + upper).astype(np.int64)]
        out.append(total)
    return np.concatenate(out, axis=1)


def _entry(level: HashGridLevel, vertex: np.ndarray) -> np.ndarray:
    """Entry of a vertex within its level: [N, 3] uint32 -> [N] uint32."""
    x, y, z = vertex.T
    if level.dense:
        side = np.uint32(level.cells + 1)
        return x + side * (y + side * z)
    return (x * np.uint32(PRIMES[0]) ^ y * np.uint32(PRIMES[1]) ^ z * np.uint32(PRIMES[2])) & np.uint32(
        level.entries - 1
    )


def drjit_vertices(level: HashGridLevel, clamped: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    """Find the eight vertices around points on the device.

    Args:
        level: Level of the grid.
        clamped: Three coordinates in [0, 1], [N] each.

    Yields:
        Entry of a vertex in the table of all levels, and its trilinear weight, [N] each.
    """
    from lightwell.backend import dr, mi

    at = [coordinate * level.cells for coordinate in clamped]
    low = [dr.minimum(mi.UInt32(a), level.cells - 1) for a in at]
    fraction = [a - mi.Float(i) for a, i in zip(at, low)]
    for corner in range(8):
        upper = [corner >> axis & 1 for axis in range(3)]
        x, y, z = (i + u for i, u in zip(low, upper))
        if level.dense:
            entry = x + (level.cells + 1) * (y + (level.cells + 1) * z)
        else:
            entry = (x ^ y * mi.UInt32(PRIMES[1]) ^ z * mi.UInt32(PRIMES[2])) & (level.entries - 1)
        weight = mi.Float(1)
        for f, u in zip(fraction, upper):
            weight *= f if u else 1 - f
        yield entry + level.offset, weight


def _drjit_hashgrid(use: Use, p: Any) -> Any:
    from lightwell.backend import dr, mi

    channels = use.buffers["buffer"].shape[1]
    clamped = [dr.clip(coordinate, 0, 1) for coordinate in p]
    out = []
    for level in _levels(use):
        total = [mi.Float(0)] * channels
        for entry, weight in drjit_vertices(level, clamped):
            values = gather_row(use.state["table"], entry, channels)
            total = [t + weight * v for t, v in zip(total, values)]
        out += total
    return out


def _examples(rng: np.random.Generator) -> Iterator[Example]:
    for count, base, growth, log2, channels in (
        (1, 1, 1, 3, 1),
        (4, 4, 1.5, 8, 2),
        (6, 2, 2, 6, 4),
        (3, 16, 1.3, 7, 3),
    ):
        last = levels(count, base, growth, log2)[-1]
        table = rng.normal(0, 0.5, (last.offset + last.entries, channels))
        params = {"buffer": table, "levels": count, "base": base, "growth": growth, "entries_log2": log2}
        yield Example(f"{count}x{channels}_{log2}", (coordinates(rng, 3),), params)


HASHGRID = register(
    Op(
        name="hashgrid",
        arity=(1, 1),
        parameters={
            "buffer": Parameter("buffer", ranks=(2,)),
            "levels": Parameter("integer", 1, 32),
            "base": Parameter("number", 1, MAX_CELLS),
            "growth": Parameter("number", 1, 16),
            "entries_log2": Parameter("integer", 3, 24),
        },
        width=_width,
        numpy=_numpy_hashgrid,
        drjit=_drjit_hashgrid,
        fetches=lambda use: 8 * use["levels"],
        prepare=upload_table,
        examples=_examples,
    )
)
