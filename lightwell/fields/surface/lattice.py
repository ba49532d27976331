"""A gate that is a picture of the scene: scores of M experts on a lattice, read at one point, without a network.

The point is p + δ n, half a step off the surface, so that the two sides of a thin wall read different vertices and so
do the two faces of a crease. Scores depend on place and normal alone: no light and no eye moves a border.

Between the vertices the scores are interpolated, and the op ``top2`` turns them into two experts and the share of the
second one, which is 0 away from borders and ½ on them. Notation: [D, H, W] vertices, z the first axis; M experts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import distance_transform_edt, uniform_filter

from lightwell.fields.base import FieldSetup
from lightwell.fields.features import open_builder
from lightwell.fields.tabulate import Tabulated
from lightwell.graph import Builder, pack
from lightwell.graph.buffers import UINT8_STEPS
from lightwell.networks.checkpoint import Arrays
from lightwell.transport.samples import Query

# How far off its surface a point is looked up, in steps of the lattice. With the vertices in the middle of cells whose
# faces lie on the scene's bounds, points of a wall on the bounds are looked up in a plane of vertices.
OFFSET = 0.5


@dataclass(frozen=True)
class Lattice:
    """Vertices that surround the surfaces of a scene; a cell is the cube of points nearest to its vertex."""

    corner: np.ndarray
    """[3] float64 x, y, z of the lattice's least corner, half a step outside its first vertex; metres."""
    step: float
    """Distance of neighbouring vertices, metres."""
    shape: tuple[int, int, int]
    """(D, H, W): vertices along z, y and x."""

    @staticmethod
    def around(setup: FieldSetup, query: Query, cells: int) -> Lattice:
        """What points of ``query`` need of a lattice with ``cells`` steps along the longest edge of a scene."""
        step = 2 * setup.half_extent / cells
        size = np.array(setup.size or (2 * setup.half_extent,) * 3)
        low = np.array(setup.center) - 0.5 * size
        at = np.floor((_off(query, step) - low) / step)
        first, last = at.min(axis=0), at.max(axis=0)
        width, height, depth = (int(n) for n in last - first + 1)
        return Lattice(low + first * step, step, (depth, height, width))

    def __len__(self) -> int:
        return int(np.prod(self.shape))

    def cell(self, query: Query) -> np.ndarray:
        """[N] number of the cell of each point, x fastest; points outside belong to the nearest cell."""
        d, h, w = self.shape
        at = np.floor((_off(query, self.step) - self.corner) / self.step).astype(np.int64)
        x, y, z = np.clip(at, 0, [w - 1, h - 1, d - 1]).T
        return (z * h + y) * w + x

    def node(self, b: Builder) -> str:
        """Add to a graph the point in [0, 1]³ at which the op ``grid`` reads the lattice."""
        scale = 1 / (self.step * np.array(self.shape[::-1]))
        surface = b.affine("position", scale.tolist(), (-self.corner * scale).tolist())
        return b.add(surface, b.affine("normal", (OFFSET * self.step * scale).tolist(), [0.0, 0.0, 0.0]))

    def neighbours(self, cells: np.ndarray) -> np.ndarray:
        """[K, 2] pairs of indices into ``cells``, numbers of occupied cells: each cell and those that touch it."""
        place = np.full(len(self), -1)
        place[cells] = np.arange(len(cells))
        padded = np.pad(place.reshape(self.shape), 1, constant_values=-1)
        (d, h, w), inner = self.shape, place.reshape(self.shape)
        pairs = []
        for z, y, x in np.ndindex(3, 3, 3):
            other = padded[z : z + d, y : y + h, x : x + w]
            both = (inner >= 0) & (other >= 0) & (inner != other)
            pairs.append(np.stack([inner[both], other[both]], axis=1))
        return np.concatenate(pairs)

    def scores(self, cells: np.ndarray, expert: np.ndarray, experts: int, passes: int = 0) -> np.ndarray:
        """[D, H, W, M] uint8 scores: 255 for the expert [K] of each of the occupied ``cells`` [K], and as much for that
        of the nearest occupied cell elsewhere. Each of ``passes`` averages over the occupied cells that touch."""
        full = np.zeros((len(self), experts), np.float32)
        full[cells, expert] = 1
        full = full.reshape(*self.shape, experts)
        known = full.sum(axis=3) > 0
        for _ in range(passes):
            near = uniform_filter(known.astype(np.float32), 3, mode="constant")
            total = np.stack([uniform_filter(full[..., e], 3, mode="constant") for e in range(experts)], axis=3)
            full = np.where(known[..., None], total / np.maximum(near, 1e-6)[..., None], 0)
        nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
        return np.rint(full[tuple(nearest)] * UINT8_STEPS).astype(np.uint8)


def _off(query: Query, step: float) -> np.ndarray:
    """[N, 3] float64 points half a step off their surfaces."""
    return query.position.astype(np.float64) + OFFSET * step * query.normal


@dataclass(frozen=True)
class Gate:
    """Which two experts a point asks, and how much of the second; computed by the nodes that ship."""

    lattice: Lattice
    scores: np.ndarray
    """[D, H, W, M] uint8."""

    def node(self, b: Builder) -> str:
        """Add the gate to a graph: (first expert, second expert, share of the second), width 3."""
        return b.top2(b.grid(self.lattice.node(b), pack(self.scores, "uint8")))

    def arrays(self) -> Arrays:
        """For checkpoints."""
        return {"scores": self.scores, "corner": self.lattice.corner, "step": np.array(self.lattice.step)}

    @staticmethod
    def of(arrays: Arrays) -> Gate:
        """What ``arrays`` gave; ``ValueError`` or ``KeyError`` for what it cannot have been."""
        scores, corner = arrays["scores"], arrays["corner"]
        if scores.ndim != 4 or scores.dtype != np.uint8 or min(scores.shape) < 1 or corner.shape != (3,):
            raise ValueError("'scores' is not a lattice of bytes with a corner")
        if not float(arrays["step"]) > 0:
            raise ValueError("'step' is no length")
        return Gate(Lattice(arrays["corner"], float(arrays["step"]), scores.shape[:3]), scores)

    @cached_property
    def _table(self) -> Tabulated:
        b = open_builder()
        return Tabulated(b.build(top=self.node(b)))

    def __call__(self, query: Query) -> Split:
        """Of [N] points."""
        top = self._table(query)["top"]
        return Split(top[:, 0].astype(np.int64), top[:, 1].astype(np.int64), top[:, 2])


@dataclass(frozen=True)
class Split:
    """How N points are split between experts."""

    first: np.ndarray
    """[N] int64 expert with the larger share."""
    second: np.ndarray
    """[N] int64 the other one; means nothing where ``share`` is 0."""
    share: np.ndarray
    """[N] share of the second expert, 0 … ½."""

    @property
    def band(self) -> np.ndarray:
        """Rows that two experts share."""
        return np.flatnonzero(self.share > 0)
