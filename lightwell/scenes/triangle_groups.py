"""Groups of small triangles: a light map has no room for charts of millions of triangles, nor a bake the time to test
each of them.

Triangles of the same mesh, about the same direction and the same cell of a regular grid form a group. It is tested by a
few of its triangles, and has one chart: its projection along the nearest axis.

Notation: T triangles of M meshes behind one another, G groups.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived

# Scenes of more triangles are grouped. Below, xatlas cuts each mesh, which takes about a minute at this number.
MOST_TRIANGLES = 1 << 17
# Triangles of more than this share of the surface stay alone: 16 texels of a well filled light map of 1024 x 1024.
LARGE = 16 / (0.6 * 1024**2)
# Groups of one scene, at most; beyond so many meshes, meshes of the same material share groups.
MOST_GROUPS, MOST_MESHES = 3000, 250
# Cells along the longest axis at most; factor from one edge of the cells to the next one that is tried, and triangles
# that the groups are counted by.
FINEST, COARSER, COUNTED = 1 << 12, 1.25, 1 << 18
# Triangles of each group that are tested.
TESTED = 4


@dataclass(frozen=True)
class TriangleGroups:
    """The groups of a scene."""

    label: np.ndarray
    """[T] int64: group of each triangle, from 0; -1 where it stays alone."""
    tested: np.ndarray
    """[T] bool: triangles that stand for their group, and those that stay alone."""

    @property
    def count(self) -> int:
        """G."""
        return int(self.label.max(initial=-1)) + 1

    @property
    def alone(self) -> np.ndarray:
        """[T] bool: triangles of no group."""
        return self.label < 0

    def spread(self, sides: np.ndarray) -> np.ndarray:
        """Extend sides of triangles to the same side of all triangles of their group.

        Args:
            sides: [2, T] bool.

        Returns:
            [2, T] bool.
        """
        if not self.count:
            return sides
        grouped = np.flatnonzero(self.label >= 0)
        label = self.label[grouped]
        found = sides.copy()
        for row in found:
            row[grouped] = (np.bincount(label, weights=row[grouped], minlength=self.count) > 0)[label]
        return found

    def readers(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Choose one triangle for each group, and each triangle that is alone.

        Args:
            chosen: [T] bool: N triangles.

        Returns:
            [K] triangles, and [N] row among them of each of the N.
        """
        rows = np.flatnonzero(chosen)
        key = np.where(self.label[rows] >= 0, self.label[rows], self.count + rows)
        _, first, of = np.unique(key, return_index=True, return_inverse=True)
        return rows[first], of.reshape(-1)


GROUPS = Derived[TriangleGroups]("scenes.triangle_groups")


def triangle_groups(scene: Scene) -> TriangleGroups:
    """Group the small triangles of a scene of many; the groups are kept with it.

    Args:
        scene: Scene with T triangles.

    Returns:
        The groups; none where the scene has few triangles.
    """
    return scene.cache.get(GROUPS, lambda: _grouped(scene))


def _grouped(scene: Scene) -> TriangleGroups:
    count = sum(len(mesh.indices) for mesh in scene.meshes)
    label, tested = np.full(count, -1, np.int64), np.ones(count, bool)
    if count <= MOST_TRIANGLES:
        return TriangleGroups(label, tested)
    middle, area, key = _described(scene)
    small = np.flatnonzero(area <= LARGE * area.sum())
    label[small] = _labels(middle[small], key[small], np.sqrt(area[small].sum() / MOST_GROUPS))
    tested[small] = False
    # The first triangles of each group in a random order.
    order = np.random.default_rng(0x6709).permutation(small)
    order = order[np.argsort(label[order], kind="stable")]
    sizes = np.bincount(label[order])
    rank = np.arange(len(order)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    tested[order[rank < TESTED]] = True
    return TriangleGroups(label, tested)


def _described(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles [T, 3], areas [T], and a number [T] for every mesh (or material) and nearest direction of an axis."""
    parts = []
    merged = len(scene.meshes) > MOST_MESHES
    for number, mesh in enumerate(scene.meshes):
        a, b, c = (mesh.positions[mesh.indices[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        size = np.linalg.norm(normal, axis=1).astype(np.float64) / 2
        parts.append(((a + b + c) / 3, size, 6 * (mesh.material if merged else number) + nearest_axis(normal)))
    middle, area, key = (np.concatenate(column) for column in zip(*parts))
    return middle, area, key


def nearest_axis(normal: np.ndarray) -> np.ndarray:
    """Number the directions of axes that are nearest to normals.

    Args:
        normal: [N, 3] normals of any length.

    Returns:
        [N] int64: twice the axis, plus one for the direction of its smaller values.
    """
    axis = np.abs(normal).argmax(axis=1)
    return 2 * axis + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0)


def _labels(middle: np.ndarray, key: np.ndarray, edge: float) -> np.ndarray:
    """Number the groups [N] of cells that are as small as the number of groups allows."""
    low = middle.min(axis=0)
    extent = float((middle - low).max())
    sample = np.random.default_rng(0x6708).permutation(len(middle))[:COUNTED]
    edge = max(edge, extent / FINEST, 1e-30)
    while len(np.unique(_cells(middle[sample], key[sample], low, edge, extent))) > MOST_GROUPS and edge < extent:
        edge *= COARSER
    return np.unique(_cells(middle, key, low, edge, extent), return_inverse=True)[1].reshape(-1)


def _cells(middle: np.ndarray, key: np.ndarray, low: np.ndarray, edge: float, extent: float) -> np.ndarray:
    """Number the cell and direction [N] of triangles."""
    cells = int(extent / edge) + 1
    x, y, z = np.minimum(((middle - low) / edge).astype(np.int64), cells - 1).T
    return ((key * cells + x) * cells + y) * cells + z


def planar(corners: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Project the corners of triangles along axes, so that their fronts are counter-clockwise.

    Args:
        corners: [N, 3, 3] corners, metres.
        axis: [N] directions as ``nearest_axis`` numbers them.

    Returns:
        [N, 3, 2] points, metres.
    """
    first, second = (axis // 2 + 1) % 3, (axis // 2 + 2) % 3
    u, v = (np.take_along_axis(corners, a[:, None, None], axis=2)[..., 0] for a in (first, second))
    return np.stack([np.where((axis % 2)[:, None] == 1, -u, u), v], axis=-1)
