"""ReLU field: one small grid over the cube, ρ = clip(tri(G, u), 0, 1).

Karnewar, Ritschel, Wang and Mitra, ReLU Fields, 2022.

Clipping after the interpolation puts a sharp edge anywhere inside a grid cell. ``fit`` solves a convex problem, the
squared hinge loss (a value below 0 costs nothing where the target is 0, nor one above 1 where it is 1), by Newton's
method on the active points; ``refine`` polishes with the clip itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from lightwell.probes.pattern import Pattern
from lightwell.probes.weights.common import THRESHOLD
from lightwell.probes.weights.refine import refine

# Stored values: uint8 over this range. It bounds how steeply the clip can cut: 1 to 0 in a fifth of a grid cell.
LOW, HIGH = -2.0, 3.0
NEWTON = 12
# Steps of the polish, and their size.
POLISH, RATE = 60, 0.01
# Pull of the grid towards its middle, relative to the mean diagonal of the normal equations of an empty cube.
RIDGE = 2e-4
# Probes that are solved together.
BATCH = 256


@dataclass(frozen=True)
class ReluField:
    """A grid of G³ numbers over the cube [-1, 1]³, x fastest, vertices on the cube's faces."""

    side: int = 4

    @property
    def name(self) -> str:
        return f"relu-field-{self.side}"

    @property
    def parameters(self) -> int:
        return self.side**3

    @property
    def stored(self) -> int:
        return self.side**3

    def corners(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices [N, 8] and weights [N, 8] of probe-local places [N, 3]."""
        at = np.clip((np.asarray(u, np.float64) + 1) * 0.5, 0, 1) * (self.side - 1)
        low = np.minimum(at.astype(np.int64), self.side - 2)
        f = at - low
        bits = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
        vertex = (low[:, None] + bits) @ np.array([1, self.side, self.side**2])
        return vertex, np.where(bits, f[:, None], 1 - f[:, None]).prod(axis=-1)

    def matrix(self, u: np.ndarray) -> np.ndarray:
        """[N, G³] float32: values are its products with grids."""
        vertex, weight = self.corners(u)
        out = np.zeros((len(u), self.parameters), np.float32)
        np.put_along_axis(out, vertex, weight.astype(np.float32), axis=1)
        return out

    def raw(self, params: np.ndarray, u: np.ndarray) -> np.ndarray:
        vertex, weight = self.corners(u)
        return (np.take_along_axis(params, vertex, axis=1) * weight).sum(axis=1)

    def values(self, params: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        matrix = self.matrix(u)
        return params @ matrix.T, matrix

    def gradient(self, state: np.ndarray, slope: np.ndarray) -> np.ndarray:
        return slope @ state

    def quantised(self, params: np.ndarray) -> np.ndarray:
        return decode(encode(params))

    def bounded(self, params: np.ndarray) -> np.ndarray:
        """Within what can be stored."""
        return np.clip(params, LOW, HIGH)

    def fit(self, target: np.ndarray, weight: np.ndarray, layout: Pattern) -> np.ndarray:
        batches = [slice(k, k + BATCH) for k in range(0, len(target), BATCH)]
        parts = [self._newton(target[rows], weight[rows], layout) for rows in batches]
        grid = np.concatenate(parts) if parts else np.zeros((0, self.parameters), np.float32)
        return refine(self, grid, target, weight, layout, steps=POLISH, rate=RATE)

    def _newton(self, target: np.ndarray, weight: np.ndarray, layout: Pattern) -> np.ndarray:
        basis, pairs = _operators(self.side, layout)
        goal = np.where(target > 0, THRESHOLD + (1 - THRESHOLD) * target, THRESHOLD).astype(np.float32)
        grid = np.full((len(target), self.parameters), 0.5, np.float32)
        eye = np.eye(self.parameters, dtype=np.float32)
        ridge = RIDGE * float(layout.hat.astype(np.float32) ** 2 @ (basis**2).mean(axis=1))
        active = weight
        for _ in range(NEWTON):
            left = (pairs @ active.T).T.reshape(-1, *eye.shape) + ridge * eye
            right = (active * goal) @ basis + 0.5 * ridge
            grid = self.bounded(np.linalg.solve(left, right[..., None])[..., 0])
            value = grid @ basis.T
            idle = ((target == 0) & (value < goal)) | ((target >= 1) & (value > 1))
            before, active = active, np.where(idle, 0, weight)
            if np.array_equal(before, active):
                break
        return grid


# (side, points) → interpolation matrix [Q, G³] and its products of pairs of columns [G⁶, Q].
_KEPT: dict[tuple[int, bytes], tuple[np.ndarray, csr_matrix]] = {}


def _operators(side: int, layout: Pattern) -> tuple[np.ndarray, csr_matrix]:
    """What every fit on a pattern shares."""
    key = (side, layout.u.tobytes())
    if key not in _KEPT:
        field = ReluField(side)
        vertex, weight = field.corners(layout.u)
        product = (weight[:, :, None] * weight[:, None, :]).reshape(len(vertex), -1)
        cell = (vertex[:, :, None] * field.parameters + vertex[:, None, :]).reshape(len(vertex), -1)
        column = np.repeat(np.arange(len(vertex)), 64)
        shape = (field.parameters**2, len(vertex))
        pairs = csr_matrix((product.ravel().astype(np.float32), (cell.ravel(), column)), shape=shape)
        _KEPT[key] = field.matrix(layout.u), pairs
    return _KEPT[key]


def encode(params: np.ndarray) -> np.ndarray:
    """uint8 of grid values."""
    return np.clip(np.rint((params - LOW) / (HIGH - LOW) * 255), 0, 255).astype(np.uint8)


def decode(stored: np.ndarray) -> np.ndarray:
    """float32 of stored grid values."""
    return (stored.astype(np.float32) * np.float32((HIGH - LOW) / 255) + np.float32(LOW)).astype(np.float32)
