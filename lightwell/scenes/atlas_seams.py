"""Seams of an atlas: edges whose two triangles lie at different places of the light map.

Notation: T triangles of all meshes behind one another, E seams; end k of a triangle's edge is its corner k or k + 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.scenes.atlas import Atlas
from lightwell.scenes.scene import Mesh, Scene
from lightwell.scenes.welding import equal_rows

# Light is continuous across a seam when the shading normals of both sides are as near as this, in degrees.
SMOOTH = 5.0
# Ends whose uv differ by less than this many texels are the same place.
SAME = 0.01


@dataclass(frozen=True)
class Seams:
    """E seam edges."""

    triangle: np.ndarray
    """[E, 2] triangles on both sides."""
    corner: np.ndarray
    """[E, 2, 2] corners of each triangle at the first and the second end of the edge."""
    side: np.ndarray
    """[E] 0: fronts, 1: backs."""
    smooth: np.ndarray
    """[E] bool: light is continuous across it."""
    length: np.ndarray
    """[E] length, metres."""

    def __len__(self) -> int:
        return len(self.triangle)

    def barycentric(self, rows: np.ndarray, which: int, t: np.ndarray) -> np.ndarray:
        """Compute barycentric weights of points on seam edges, on one of their triangles.

        Args:
            rows: [N] seams.
            which: Triangle of the seam, 0 or 1.
            t: [N] positions along the edges, in [0, 1].

        Returns:
            [N, 2] float32 weights of the second and third vertex.
        """
        weights = np.zeros((len(rows), 3), np.float32)
        first, second = self.corner[rows, which].T
        weights[np.arange(len(rows)), first] = 1 - t
        weights[np.arange(len(rows)), second] += t
        return weights[:, 1:]


def seams(scene: Scene, atlas: Atlas) -> Seams:
    """Find all seams between stored triangles of the same mesh and side.

    Args:
        scene: Scene that was unwrapped.
        atlas: Its atlas.

    Returns:
        The seams.
    """
    parts = [_of_mesh(scene, atlas, number, side) for number in range(len(scene.meshes)) for side in (0, 1)]
    columns = [np.concatenate(c) for c in zip(*parts)]
    return Seams(*columns)


def _of_mesh(scene: Scene, atlas: Atlas, number: int, side: int) -> tuple[np.ndarray, ...]:
    mesh, first = scene.meshes[number], atlas.first[number]
    indices = mesh.indices.astype(np.int64)
    stored = atlas.chart[side, first : first + len(indices)] >= 0
    corners = equal_rows(mesh.positions)[1][indices]
    begin, triangle = np.tile([0, 1, 2], len(indices)), np.repeat(np.arange(len(indices)), 3)
    a, b = corners[triangle, begin], corners[triangle, (begin + 1) % 3]
    use = stored[triangle] & (a != b)
    begin, triangle, a, b = begin[use], triangle[use], a[use], b[use]
    key = np.minimum(a, b) * (int(corners.max(initial=0)) + 1) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    one, two = order[same], order[same + 1]
    ends = np.stack([_ends(begin[r], a[r] > b[r]) for r in (one, two)], axis=1)
    pair = np.stack([triangle[one], triangle[two]], axis=1)
    uv = atlas.uv[side, first + pair[..., None], ends]
    apart = (np.abs(uv[:, 0] - uv[:, 1]).max(axis=(1, 2)) * atlas.size) > SAME
    pair, ends = pair[apart], ends[apart]
    place = mesh.positions[indices[pair[:, 0, None], ends[:, 0]]].astype(np.float64)
    length = np.linalg.norm(place[:, 1] - place[:, 0], axis=1)
    return first + pair, ends, np.full(len(pair), side), _smooth(mesh, indices, pair, ends), length


def _ends(begin: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """Order the corners of edges [E, 2] by the number of their welded vertex."""
    ends = np.stack([begin, (begin + 1) % 3], axis=1)
    return np.where(turned[:, None], ends[:, ::-1], ends)


def _smooth(mesh: Mesh, indices: np.ndarray, pair: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Test [E] whether both sides have the same normals at both ends."""
    p = mesh.positions[indices].astype(np.float64)
    flat = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30)
    if mesh.normals is None:
        n = np.repeat(flat[pair][:, :, None], 2, axis=2)
    else:
        n = mesh.normals[indices[pair[..., None], ends]].astype(np.float64)
    return ((n[:, 0] * n[:, 1]).sum(axis=-1) > np.cos(np.radians(SMOOTH))).all(axis=1)
