"""A gate without a network: scores of M experts on a lattice over the scene, read at one point.

The point is p + δ n, half a step above the surface, so that the two sides of a thin wall read different vertices, and
so do the two faces of a crease. Scores depend on position and normal alone, so borders do not move with light or
camera.

Between the vertices the scores are interpolated. The op ``top2`` converts them to two experts and the share of the
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
from lightwell.files import Arrays
from lightwell.graph import Builder, pack
from lightwell.graph.buffers import UINT8_STEPS
from lightwell.transport.samples import Query

# Distance from the surface at which a point is looked up, in steps of the lattice. With the vertices in the middle of
# cells whose faces lie on the scene's bounds, points of a wall on the bounds are looked up in a plane of vertices.
OFFSET = 0.5


@dataclass(frozen=True)
class VertexLattice:
    """Vertices around the surfaces of a scene; a cell is the cube of points nearest to its vertex."""

    corner: np.ndarray
    """[3] float64 x, y, z of the lattice's least corner, half a step outside its first vertex; metres."""
    step: float
    """Distance of neighbouring vertices, metres."""
    shape: tuple[int, int, int]
    """(D, H, W): vertices along z, y and x."""

    @staticmethod
    def around(setup: FieldSetup, query: Query, cells: int) -> VertexLattice:
        """Make the smallest lattice around surface points.

        Args:
            setup: Bounds of the scene.
            query: N queries.
            cells: Steps along the longest edge of the bounds, ≥ 1.

        Returns:
            The lattice.
        """
        step = 2 * setup.half_extent / cells
        size = np.array(setup.size or (2 * setup.half_extent,) * 3)
        low = np.array(setup.center) - 0.5 * size
        at = np.floor((_off(query, step) - low) / step)
        first, last = at.min(axis=0), at.max(axis=0)
        width, height, depth = (int(n) for n in last - first + 1)
        return VertexLattice(low + first * step, step, (depth, height, width))

    def __len__(self) -> int:
        return int(np.prod(self.shape))

    def cell(self, query: Query) -> np.ndarray:
        """Find the cell of each point; points outside belong to the nearest cell.

        Args:
            query: N queries.

        Returns:
            [N] int64 number of the cell, x fastest.
        """
        d, h, w = self.shape
        at = np.floor((_off(query, self.step) - self.corner) / self.step).astype(np.int64)
        x, y, z = np.clip(at, 0, [w - 1, h - 1, d - 1]).T
        return (z * h + y) * w + x

    def node(self, b: Builder) -> str:
        """Add to a graph the point at which the op ``grid`` reads the lattice.

        Args:
            b: Graph to add nodes to.

        Returns:
            Name of the node with the point in [0, 1]³, width 3.
        """
        scale = 1 / (self.step * np.array(self.shape[::-1]))
        surface = b.affine("position", scale.tolist(), (-self.corner * scale).tolist())
        return b.add(surface, b.affine("normal", (OFFSET * self.step * scale).tolist(), [0.0, 0.0, 0.0]))

    def neighbours(self, cells: np.ndarray) -> np.ndarray:
        """List pairs of occupied cells that touch.

        Args:
            cells: [K] numbers of the occupied cells.

        Returns:
            [P, 2] int pairs of indices into ``cells``; each pair in both orders.
        """
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
        """Compute the stored scores: 255 for the expert of each occupied cell; other cells copy the nearest occupied
        one.

        Args:
            cells: [K] numbers of the occupied cells.
            expert: [K] int expert of each.
            experts: M.
            passes: How often scores are averaged over neighbouring occupied cells, ≥ 0.

        Returns:
            [D, H, W, M] uint8 scores.
        """
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
    """The two experts of each point and the share of the second one, computed by the nodes that are stored."""

    lattice: VertexLattice
    scores: np.ndarray
    """[D, H, W, M] uint8."""

    def node(self, b: Builder) -> str:
        """Add the gate to a graph.

        Args:
            b: Graph to add nodes to.

        Returns:
            Name of the node with first expert, second expert and share of the second, width 3.
        """
        return b.top2(b.grid(self.lattice.node(b), pack(self.scores, "uint8")))

    def arrays(self) -> Arrays:
        """Return the arrays of a checkpoint.

        Returns:
            Arrays by name.
        """
        return {"scores": self.scores, "corner": self.lattice.corner, "step": np.array(self.lattice.step)}

    @staticmethod
    def of(arrays: Arrays) -> Gate:
        """Restore a gate.

        Args:
            arrays: The result of ``arrays`` by name: scores [D, H, W, M], corner [3], step (scalar). A missing name is
                a
                ``KeyError``.

        Returns:
            The gate.

        Raises:
            ValueError: The arrays do not describe a gate.
        """
        scores, corner = arrays["scores"], arrays["corner"]
        if scores.ndim != 4 or scores.dtype != np.uint8 or min(scores.shape) < 1 or corner.shape != (3,):
            raise ValueError("'scores' is not a lattice of bytes with a corner")
        if not float(arrays["step"]) > 0:
            raise ValueError("'step' is no length")
        return Gate(VertexLattice(arrays["corner"], float(arrays["step"]), scores.shape[:3]), scores)

    @cached_property
    def _table(self) -> Tabulated:
        b = open_builder()
        return Tabulated(b.build(top=self.node(b)))

    def __call__(self, query: Query) -> Split:
        """Evaluate the gate at N points."""
        top = self._table(query)["top"]
        return Split(top[:, 0].astype(np.int64), top[:, 1].astype(np.int64), top[:, 2])


@dataclass(frozen=True)
class Split:
    """The split of N points between experts."""

    first: np.ndarray
    """[N] int64 expert with the larger share."""
    second: np.ndarray
    """[N] int64 the other one; undefined where ``share`` is 0."""
    share: np.ndarray
    """[N] share of the second expert, 0 … ½."""

    @property
    def band(self) -> np.ndarray:
        """Rows of the points that two experts share."""
        return np.flatnonzero(self.share > 0)
