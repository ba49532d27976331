"""A trainable multi-resolution hash grid in tensor mode: Müller et al., Instant Neural Graphics Primitives, 2022.

The layout is that of the shading graph's ``hashgrid`` op (format/FORMAT.md). Notation: B points, L levels, C channels.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.graph.ops.hashgrid import PRIMES, HashGridLevel, levels

# Gradients are summed as integers in units of 1 / FIXED_POINT: sums of integers do not depend on their order, so that
# the same seed gives the same weights; range (± 2^23) and resolution exceed those of sums of 32-bit floats.
FIXED_POINT = 2.0**40
# Channels that are read, and summed, at once.
PACKET = 4
Int64x4, UInt64x4 = (getattr(sys.modules[mi.Float.__module__], f"Array4{kind}64") for kind in "iu")


@dataclass(frozen=True)
class HashGrid:
    """A multi-resolution hash grid: maps points [B, 3] in [0, 1]³ to features [B, L · C], level-major."""

    levels: int = 3
    base: float = 8.0
    """Cells of the first level along each axis."""
    growth: float = 2.0
    """Cells of a level relative to the one before."""
    entries_log2: int = 13
    """Levels with more vertices than 2^this share entries by a hash."""
    channels: int = 4
    """Features per level, a multiple of four: entries are read and written in packets."""
    decay: tuple[float, ...] = ()
    """Weight of each level's mean square in the loss: keeps fine levels from learning noise; empty: none."""

    def __post_init__(self) -> None:
        if self.channels % PACKET:
            raise ValueError(f"hash grid: {self.channels} channels, expected a multiple of {PACKET}")
        if self.decay and len(self.decay) != self.levels:
            raise ValueError(f"hash grid: {len(self.decay)} decays for {self.levels} levels; give one for each")

    @cached_property
    def layout(self) -> list[HashGridLevel]:
        """Lattices of the levels.

        Returns:
            One record per level, coarse to fine.
        """
        return levels(self.levels, self.base, self.growth, self.entries_log2)

    @property
    def entries(self) -> int:
        """Rows of the table."""
        return self.layout[-1].offset + self.layout[-1].entries

    @property
    def packets(self) -> int:
        """Packets of four channels per entry."""
        return self.channels // PACKET

    @property
    def width(self) -> int:
        """Features per point."""
        return self.levels * self.channels

    def initial(self, rng: np.random.Generator, bound: float = 1e-4) -> np.ndarray:
        """Draw an initial table U(±bound): small, because entries that no sample reaches keep these values.

        Args:
            rng: Random generator.
            bound: Largest magnitude.

        Returns:
            [entries, C] float32.
        """
        return rng.uniform(-bound, bound, (self.entries, self.channels)).astype(np.float32)

    def even(self, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Divide the table by the largest magnitude of each level and channel, so that one step of storage suits all.

        Args:
            table: [entries, C] table.

        Returns:
            [entries, C] divided table, and these magnitudes [L · C].
        """
        values, steps = np.array(table, np.float32), []
        for lattice in self.layout:
            level = values[lattice.offset : lattice.offset + lattice.entries]
            largest = np.maximum(np.abs(level).max(axis=0), 1e-12)
            level /= largest
            steps.append(largest)
        return values, np.concatenate(steps)

    def __call__(self, table: Any, points: Any) -> Any:
        """Interpolate features at [B, 3] points; differentiable in the table, not in the points."""
        return dr.custom(_Encode, self, table, points)

    def evaluate(self, table: Any, points: Any) -> Any:
        """Interpolate features without derivatives.

        Args:
            table: [entries, C] tensor.
            points: [B, 3] points in [0, 1]³.

        Returns:
            [B, L · C] features.
        """
        out = dr.empty(mi.Float, points.shape[0] * self.width)
        self.write(out, self.width, 0, table, points)
        return mi.TensorXf(out, (points.shape[0], self.width))

    def write(self, out: Any, width: int, first: int, table: Any, points: Any, factor: Any = None) -> None:
        """Write features to neighbouring columns of a table, without derivatives.

        Args:
            out: [B · width] array of the table.
            width: Columns of the table.
            first: First column.
            table: [entries, C] tensor.
            points: [B, 3] points in [0, 1]³.
            factor: [B] what the features of each point are multiplied by; None: 1.
        """
        total = [mi.Vector4f(0)] * self.packets
        for entry, weight in self._corners(points):
            rows = [dr.gather(mi.Vector4f, table.array, entry * self.packets + k) for k in range(self.packets)]
            total = [t + weight * row for t, row in zip(total, rows)]
        # One lane per (point, level): its channels are adjacent.
        point, at = self._places(points.shape[0], width, first)
        scale = 1 if factor is None else dr.gather(mi.Float, factor, point)
        for packet, value in enumerate(total):
            for k in range(PACKET):
                # Without the mode each of these would be a kernel of its own.
                dr.scatter(out, value[k] * scale, at + (PACKET * packet + k), mode=dr.ReduceMode.Permute)

    def gradient(self, points: Any, features: Any, first: int = 0, factor: Any = None) -> Any:
        """Compute the gradient of the table; the sum does not depend on the order of its terms.

        Args:
            points: [B, 3] points in [0, 1]³.
            features: [B, ≥ first + L · C] gradient of the features, from the column ``first`` on.
            first: First column.
            factor: [B] what the features of each point were multiplied by; None: 1.

        Returns:
            [entries, C] gradient.
        """
        # Unsigned sums of two's complement numbers are exact. Packets are ten times faster than single numbers.
        total = dr.zeros(mi.UInt64, self.entries * self.channels)
        point, at = self._places(points.shape[0], features.shape[1], first)
        scale = FIXED_POINT if factor is None else FIXED_POINT * dr.gather(mi.Float, factor, point)
        single = [dr.gather(mi.Float, features.array, at + k) * scale for k in range(self.channels)]
        parts = [mi.Vector4f(*single[k : k + PACKET]) for k in range(0, self.channels, PACKET)]
        for entry, weight in self._corners(points):
            for packet, part in enumerate(parts):
                value = UInt64x4(Int64x4(weight * part))
                dr.scatter_add(total, value, entry * self.packets + packet)
        return mi.TensorXf(mi.Float(mi.Int64(total)) / FIXED_POINT, (self.entries, self.channels))

    def _places(self, points: int, width: int, first: int) -> tuple[Any, Any]:
        """Point of each (point, level), and index of its first channel in rows of ``width`` columns."""
        lane = dr.arange(mi.UInt32, points * self.levels)
        point = lane // self.levels
        return point, point * width + (lane - point * self.levels) * self.channels + first

    def decayed(self, table: Any, gradient: Any) -> Any:
        """Add the gradient of the penalty Σ decay · mean square of a level.

        Args:
            table: [entries, C] tensor.
            gradient: [entries, C] gradient of the loss.

        Returns:
            [entries, C] sum of both gradients.
        """
        if not any(self.decay):
            return gradient
        entry = dr.arange(mi.UInt32, self.entries * self.channels) // self.channels
        factor = mi.Float(0)
        for lattice, weight in zip(self.layout, self.decay):
            factor = dr.select(entry >= lattice.offset, 2 * weight / (lattice.entries * self.channels), factor)
        return mi.TensorXf(gradient.array + factor * table.array, gradient.shape)

    def _corners(self, points: Any) -> Iterator[tuple[Any, Any]]:
        """Yield (entry, weight) of the eight vertices around each (point, level)."""
        lane = dr.arange(mi.UInt32, points.shape[0] * self.levels)
        point = lane // self.levels
        level = lane - point * self.levels

        def pick(name: str) -> Any:
            return _by_level(level, [int(getattr(lattice, name)) for lattice in self.layout])

        cells, offset, dense, entries = (pick(name) for name in ("cells", "offset", "dense", "entries"))
        at = [dr.clip(dr.gather(mi.Float, points.array, point * 3 + k), 0, 1) * mi.Float(cells) for k in range(3)]
        low = [dr.minimum(mi.UInt32(a), cells - 1) for a in at]
        fraction = [a - mi.Float(i) for a, i in zip(at, low)]
        side = cells + 1
        for corner in range(8):
            upper = [corner >> axis & 1 for axis in range(3)]
            x, y, z = (i + u for i, u in zip(low, upper))
            hashed = (x ^ y * mi.UInt32(PRIMES[1]) ^ z * mi.UInt32(PRIMES[2])) & (entries - 1)
            weight = mi.Float(1)
            for f, u in zip(fraction, upper):
                weight *= f if u else 1 - f
            yield offset + dr.select(dense != 0, x + side * (y + side * z), hashed), weight


def _by_level(level: Any, values: list[int]) -> Any:
    """Select the value of each lane's level among literals: a table would be an input of frozen functions."""
    chosen = mi.UInt32(values[0])
    for number, value in enumerate(values[1:], 1):
        chosen = dr.select(level == number, mi.UInt32(value), chosen)
    return chosen


class _Encode(dr.CustomOp):
    """Interpolation with a gradient whose sum does not depend on the order of its terms."""

    def eval(self, grid: HashGrid, table: Any, points: Any) -> Any:
        self._grid, self._points = grid, points
        return grid.evaluate(table, points)

    def backward(self) -> None:
        self.set_grad_in("table", self._grid.gradient(self._points, self.grad_out()))

    def forward(self) -> None:
        raise NotImplementedError("a hash grid is differentiated in reverse mode only")

    def name(self) -> str:
        return "hash grid"
