"""ReLU field: one small grid over the cube, ρ = clip(tri(G, u), 0, 1).

Karnewar, Ritschel, Wang and Mitra, ReLU Fields, 2022.

The clip after the interpolation can place a sharp edge anywhere inside a grid cell. ``fit`` solves a convex
problem, the squared hinge loss (a value below 0 costs nothing where the target is 0, nor one above 1 where it is
1), with Newton's method on the active points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_matrix

from lightwell.probes.pattern import Pattern
from lightwell.probes.weights.common import THRESHOLD, Close, State, padded

# Stored values: uint8 over this range. It bounds how steeply ρ can fall: 1 to 0 in a seventeenth of a grid cell,
# 2 per cent of the spacing for 4³. With -2 … 3 and a spacing of 1 m, ρ could not fall within a wall of 5 cm, and
# probes that see its face were not trusted there: bright leak 0.053 instead of 0.028.
LOW, HIGH = -8.0, 9.0
# Newton steps, and iterations of a step's line search; a step that moves no value by more than ``STILL`` is the last.
NEWTON, SECANTS, STILL = 20, 7, 3e-3
# Regularisation of the grid towards 0.5, relative to the mean diagonal of the normal equations of an empty cube.
RIDGE = 2e-4
# Penalty on values outside of the range that can be stored, in the same unit.
WALL = 100.0
# Goal where the target is 0: below the threshold by half a step of a byte.
SAFE = THRESHOLD - 0.55 * (HIGH - LOW) / 255
# Probes that are solved together.
BATCH = 64


@dataclass(frozen=True)
class ReluField:
    """A grid of G³ numbers over the cube [-1, 1]³, x fastest, with vertices on the cube's faces."""

    side: int = 4
    """G, vertices along an edge."""

    @property
    def name(self) -> str:
        """Name with its size."""
        return f"relu-field-{self.side}"

    @property
    def parameters(self) -> int:
        """C = G³, the number of parameters."""
        return self.side**3

    @property
    def stored(self) -> int:
        """Bytes of a record."""
        return self.side**3

    def corners(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the grid vertices around some places.

        Args:
            u: [..., 3] probe-local positions in [-1, 1].

        Returns:
            [..., 8] indices of the vertices, and [..., 8] trilinear weights.
        """
        at = np.clip((np.asarray(u, np.float64) + 1) * 0.5, 0, 1) * (self.side - 1)
        low = np.minimum(at.astype(np.int64), self.side - 2)
        f = at - low
        bits = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
        vertex = (low[..., None, :] + bits) @ np.array([1, self.side, self.side**2])
        return vertex, np.where(bits, f[..., None, :], 1 - f[..., None, :]).prod(axis=-1)

    def matrix(self, u: np.ndarray) -> np.ndarray:
        """Build the interpolation matrix of some places.

        Args:
            u: [..., 3] probe-local positions in [-1, 1].

        Returns:
            [..., C] float32; its product with a grid gives the values.
        """
        vertex, weight = self.corners(u)
        out = np.zeros((*u.shape[:-1], self.parameters), np.float32)
        np.put_along_axis(out, vertex, weight.astype(np.float32), axis=-1)
        return out

    def raw(self, params: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Evaluate one probe at one place per row, before the clip.

        Args:
            params: [N, C] grids.
            u: [N, 3] probe-local positions in [-1, 1].

        Returns:
            [N] values.
        """
        vertex, weight = self.corners(u)
        return (np.take_along_axis(params, vertex, axis=1) * weight).sum(axis=1)

    def values(self, params: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, State]:
        """Evaluate probes at many places, before the clip.

        Args:
            params: [B, C] grids.
            u: [Q, 3] probe-local positions for all probes, or [B, Q, 3] for each.

        Returns:
            [B, Q] values, and the state that ``gradient`` needs.
        """
        matrix = self.matrix(u)
        return product(matrix, params), (matrix,)

    def gradient(self, state: State, slope: np.ndarray) -> np.ndarray:
        """Compute the gradient of a loss by the parameters.

        Args:
            state: State of ``values``.
            slope: [B, Q] derivative of the loss by each value.

        Returns:
            [B, C] gradient.
        """
        return turned(state[0], slope)

    def quantised(self, params: np.ndarray) -> np.ndarray:
        """Round grids to those that can be stored.

        Args:
            params: [B, C] grids.

        Returns:
            [B, C] float32 grids.
        """
        return decode(encode(params))

    def bounded(self, params: np.ndarray) -> np.ndarray:
        """Clamp grids to the range that can be stored.

        Args:
            params: [B, C] grids.

        Returns:
            [B, C] grids.
        """
        return np.clip(params, LOW, HIGH)

    def fit(self, target: np.ndarray, weight: np.ndarray, layout: Pattern, close: Close | None = None) -> np.ndarray:
        """Fit grids to targets.

        Args:
            target: [B, Q] trust ρ at the points of the pattern.
            weight: [B, Q] weights of ``point_weight``.
            layout: The pattern.
            close: Places at surfaces; None for none.

        Returns:
            [B, C] float32 grids.
        """
        return self.convex(target, weight, layout, close)

    def convex(
        self,
        target: np.ndarray,
        weight: np.ndarray,
        layout: Pattern,
        close: Close | None = None,
        start: np.ndarray | None = None,
        steps: int = NEWTON,
    ) -> np.ndarray:
        """Minimise the squared hinge loss in batches of one size, so that a probe's bits do not depend on other probes.

        Args:
            target: [B, Q] trust ρ at the points of the pattern.
            weight: [B, Q] weights of ``point_weight``.
            layout: The pattern.
            close: Places at surfaces; None for none.
            start: [B, C] grids to start from; None for 0.5 everywhere.
            steps: Largest number of Newton steps.

        Returns:
            [B, C] float32 grids.
        """
        out = np.empty((len(target), self.parameters), np.float32)
        first = np.full(out.shape, 0.5, np.float32) if start is None else start
        for begin in range(0, len(out), BATCH):
            rows = slice(begin, begin + BATCH)
            near = close and close.part(rows, BATCH)
            t, w, grid = padded(BATCH, target[rows], weight[rows], first[rows])
            out[rows] = self._newton(t, w, grid, layout, near, steps)[: len(out[rows])]
        return out

    def _newton(
        self,
        target: np.ndarray,
        weight: np.ndarray,
        grid: np.ndarray,
        layout: Pattern,
        close: Close | None,
        steps: int,
    ) -> np.ndarray:
        """Newton's method on the active points with a line search, because whole steps can cycle."""
        problem = _Hinge(self, target, weight, layout, close)
        going = np.ones(len(grid), bool)
        for _ in range(steps):
            step = problem.step(grid)
            share = problem.share(grid, step)
            grid = np.where(going[:, None], grid + share[:, None] * step, grid)
            # Each probe ends independently: its bits do not depend on the others of the batch.
            going &= share * np.abs(step).max(axis=1) >= STILL
            if not going.any():
                break
        return self.bounded(grid)


def product(matrix: np.ndarray, params: np.ndarray) -> np.ndarray:
    """Multiply interpolation matrices with grids.

    Args:
        matrix: [Q, C] for all probes, or [B, Q, C] for each.
        params: [B, C] grids.

    Returns:
        [B, Q] values.
    """
    return params @ matrix.T if matrix.ndim == 2 else np.matmul(matrix, params[..., None])[..., 0]


def turned(matrix: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Multiply transposed interpolation matrices with slopes.

    Args:
        matrix: [Q, C] for all probes, or [B, Q, C] for each.
        slope: [B, Q] derivative of a loss by each value.

    Returns:
        [B, C] gradient.
    """
    return slope @ matrix if matrix.ndim == 2 else np.matmul(slope[:, None], matrix)[:, 0]


class _Hinge:
    """Σ w h(tri(G, u) - goal)² with h one-sided where values beyond the clip are free, and a penalty on the range."""

    def __init__(
        self, field: ReluField, target: np.ndarray, weight: np.ndarray, layout: Pattern, close: Close | None
    ) -> None:
        self.basis, self.pairs = _operators(field.side, layout)
        self.parts = [_Points(target, weight)]
        self.own = None
        if close is not None:
            self.own = field.matrix(close.u)
            self.parts.append(_Points(close.target, close.weight))
        mean = float(layout.hat.astype(np.float32) ** 2 @ (self.basis**2).mean(axis=1))
        self.ridge, self.wall = np.float32(RIDGE * mean), np.float32(WALL * mean)

    def _values(self, grid: np.ndarray) -> list[np.ndarray]:
        """Values at the points of each part."""
        return [product(m, grid) for m in (self.basis, self.own) if m is not None]

    def share(self, grid: np.ndarray, step: np.ndarray) -> np.ndarray:
        """[B] in [0, 1]: the position along a step with the least loss, found by the sign of its slope."""
        values, ways = self._values(grid), self._values(step)

        def slope(s: np.ndarray) -> np.ndarray:
            there = grid + s[:, None] * step
            rest = self.ridge * (there - 0.5) + self.wall * (there - np.clip(there, LOW, HIGH))
            total = (rest * step).sum(axis=1)
            for part, value, way in zip(self.parts, values, ways):
                miss, idle = part.miss(value + s[:, None] * way)
                miss[idle] = 0
                total += (part.weight * miss * way).sum(axis=1)
            return total

        low, high = np.zeros(len(grid), np.float32), np.ones(len(grid), np.float32)
        a, b = slope(low), slope(high)
        whole, tiny = b <= 0, np.float32(1e-30)
        for _ in range(SECANTS):
            # Regula falsi; the end that is kept twice loses half its weight (Illinois).
            middle = np.clip((low * b - high * a) / np.maximum(b - a, tiny), low, high)
            c = slope(middle)
            over = c > 0
            a, b = np.where(over, 0.5 * a, c), np.where(over, c, 0.5 * b)
            low, high = np.where(over, low, middle), np.where(over, middle, high)
        return np.where(whole, np.float32(1), np.float32(0.5) * (low + high))

    def step(self, grid: np.ndarray) -> np.ndarray:
        """[B, G³] Newton step to the minimum of the quadratic of the active points."""
        size, left, gradient = grid.shape[1], np.zeros(0), np.zeros(0)
        for part, matrix, value in zip(self.parts, (self.basis, self.own), self._values(grid)):
            miss, idle = part.miss(value)
            curved = np.where(idle, np.float32(0), part.weight)
            miss[idle] = 0
            slope = turned(matrix, part.weight * miss)
            if matrix.ndim == 2:
                left, gradient = (self.pairs @ curved.T).T.reshape(-1, size, size), slope
            else:
                left = left + np.matmul(np.swapaxes(matrix, 1, 2) * curved[:, None], matrix)
                gradient = gradient + slope
        outside = grid - np.clip(grid, LOW, HIGH)
        gradient = gradient + self.ridge * (grid - 0.5) + self.wall * outside
        diagonal = np.arange(size)
        left[:, diagonal, diagonal] += self.ridge + np.where(outside != 0, self.wall, np.float32(0))
        return -np.linalg.solve(left, gradient[..., None])[..., 0]


class _Points:
    """Targets at some points: arrays [B, Q]."""

    def __init__(self, target: np.ndarray, weight: np.ndarray) -> None:
        self.weight = weight.astype(np.float32)
        self.goal = np.where(target > 0, THRESHOLD + (1 - THRESHOLD) * target, SAFE).astype(np.float32)
        self.low, self.high = target == 0, target >= 1

    def miss(self, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Value minus goal, and where this difference costs nothing."""
        miss = value - self.goal
        return miss, (self.low & (miss < 0)) | (self.high & (miss > 0))


def _operators(side: int, layout: Pattern) -> tuple[np.ndarray, csr_matrix]:
    """Shared data of all fits on a pattern: interpolation matrix [Q, G³], products of pairs of its columns [G⁶, Q]."""
    return _operators_at(side, layout.u.tobytes(), layout.u.dtype.str)


# There are two sizes of patterns (lattice and bricks) and two of grids.
@lru_cache(maxsize=4)
def _operators_at(side: int, places: bytes, kind: str) -> tuple[np.ndarray, csr_matrix]:
    """``places``: bytes of [Q, 3] numbers of type ``kind``."""
    field, u = ReluField(side), np.frombuffer(places, kind).reshape(-1, 3)
    vertex, weight = field.corners(u)
    product = (weight[:, :, None] * weight[:, None, :]).reshape(len(vertex), -1)
    cell = (vertex[:, :, None] * field.parameters + vertex[:, None, :]).reshape(len(vertex), -1)
    column = np.repeat(np.arange(len(vertex)), 64)
    shape = (field.parameters**2, len(vertex))
    pairs = csr_matrix((product.ravel().astype(np.float32), (cell.ravel(), column)), shape=shape)
    return field.matrix(u), pairs


def encode(params: np.ndarray) -> np.ndarray:
    """Encode grid values as bytes.

    Args:
        params: [...] values, clamped to [``LOW``, ``HIGH``].

    Returns:
        [...] uint8.
    """
    return np.clip(np.rint((params - LOW) / (HIGH - LOW) * 255), 0, 255).astype(np.uint8)


def decode(stored: np.ndarray) -> np.ndarray:
    """Decode bytes to grid values.

    Args:
        stored: [...] uint8.

    Returns:
        [...] float32 in [``LOW``, ``HIGH``].
    """
    return (stored.astype(np.float32) * np.float32((HIGH - LOW) / 255) + np.float32(LOW)).astype(np.float32)
