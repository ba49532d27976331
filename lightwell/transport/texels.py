"""Surface points of the texels of an atlas.

Notation: n texels along each edge, K texels that lie on a chart, row-major.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_integers
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.scene import Scene
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.visible import side_points

# Places in a texel where a triangle may cover it: its centre first, then the rest of a lattice of 5 x 5.
STEPS = (0.5, 0.3, 0.7, 0.1, 0.9)
# Triangles lower than this, in texels, may pass between these places; they are followed in steps of half a texel, on a
# line at this share of their height.
SLIVER, FOLLOWED = 0.3, 0.1
# Height above the plane of the atlas from which rays are traced.
HEIGHT = 1.0
# Points keep this share of the scene's extent away from the edges of their triangle: charts begin at texel centres, and
# a ray from an edge that two walls share would pass between them.
CLEARANCE = 2e-4
# ... but no more than this share of its height: the texels of a long and narrow triangle stay apart along its length.
MOST_CLEARANCE = 0.125


@dataclass(frozen=True)
class Texels:
    """The covered texels of an atlas."""

    index: np.ndarray
    """[K] int64, row-major number of the texel."""
    points: SurfacePoints
    """[K] the point nearest to the texel's centre on its chart, seen along the geometric normal of the stored side."""
    chart: np.ndarray
    """[n, n] int32: the chart of each texel, -1 where there is none."""


def texels(scene: Scene, atlas: Atlas) -> Texels:
    """Find the surface point of each texel, by conservative rasterisation.

    A texel belongs to the chart whose triangle covers its centre, else any part of a 5 x 5 lattice in it, else one that
    is too narrow for the lattice.

    Args:
        scene: Scene that was unwrapped.
        atlas: Its atlas of n x n texels.

    Returns:
        K texels with their points and charts.
    """
    side, triangle = np.nonzero(atlas.chart >= 0)
    n = atlas.size
    index, row, points = _covered(scene, n, side, triangle, atlas.uv[side, triangle])
    chart = np.full(n * n, -1, np.int32)
    chart[index] = atlas.chart[side[row], triangle[row]]
    return Texels(index, points, chart.reshape(n, n))


def texel_points(atlas: Atlas, count: int, rows: np.ndarray | None = None) -> Recipe:
    """Describe the points of texels to workers.

    Args:
        atlas: The atlas.
        count: K, texels that are covered.
        rows: [R] increasing numbers of the texels that are traced; None: all.

    Returns:
        The recipe.
    """
    side, triangle = np.nonzero(atlas.chart >= 0)
    arrays = {"side": side.astype(np.uint8), "triangle": triangle.astype(np.uint32), "uv": atlas.uv[side, triangle]}
    if rows is not None:
        arrays["chosen"] = np.packbits(np.bincount(rows, minlength=count).astype(bool))
    return Recipe("texels", {"size": atlas.size}, arrays)


def texel_inputs(scene: Scene, settings: Mapping[str, Any], arrays: Arrays) -> Inputs:
    """Find the points of texels; see ``row_recipes.RecipeFunction``.

    Args:
        scene: Scene that was unwrapped.
        settings: ``size``, texels along the edge.
        arrays: ``side``, ``triangle`` [S] and ``uv`` [S, 3, 2] of the stored sides, and ``chosen``, a bit for each
            texel where not all are traced.

    Returns:
        Columns of ``SurfacePoints``.
    """
    stored = (arrays["side"].astype(np.int64), arrays["triangle"].astype(np.int64), arrays["uv"])
    points = _covered(scene, settings["size"], *stored)[2]
    if "chosen" in arrays:
        points = points[np.flatnonzero(np.unpackbits(arrays["chosen"], count=len(points)))]
    return Inputs(columns_of(points))


def _covered(
    scene: Scene, n: int, side: np.ndarray, triangle: np.ndarray, uv: np.ndarray
) -> tuple[np.ndarray, np.ndarray, SurfacePoints]:
    """Covered texels [K], the stored side of each, by row of ``side`` [S], and the points."""
    flat = _flat_scene(uv)
    owner, barycentric = np.full(n * n, -1, np.int64), np.zeros((n * n, 2), np.float32)
    places = sorted(((x, y) for x in STEPS for y in STEPS), key=lambda p: (p[0] - 0.5) ** 2 + (p[1] - 0.5) ** 2)
    for x, y in places:
        left = np.flatnonzero(owner < 0)
        if not len(left):
            break
        hit, found, weights = _met(flat, n, left, x, y)
        owner[left[hit]], barycentric[left[hit]] = found[hit], weights[hit]
    texel, found, weights = _slivers(n, uv)
    new = np.flatnonzero(owner[texel] < 0)
    new = new[np.unique(texel[new], return_index=True)[1]]
    owner[texel[new]], barycentric[texel[new]] = found[new], weights[new]
    index = np.flatnonzero(owner >= 0)
    row = owner[index]
    inner = _off_the_edges(scene, triangle[row], barycentric[index])
    return index, row, side_points(scene, triangle[row], side[row], inner)


def _slivers(n: int, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Follow narrow triangles along their longest edge: texel, triangle and barycentric weights [., 2] of each step."""
    corners = uv.astype(np.float64) * n
    edge = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)
    longest = edge.argmax(axis=1)
    length = edge.max(axis=1)
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    thin = np.flatnonzero(area < SLIVER * length)
    steps = np.ceil(2 * length[thin]).astype(np.int64) + 1
    triangle, count = np.repeat(thin, steps), np.repeat(steps, steps)
    along = (np.arange(len(triangle)) - np.repeat(np.cumsum(steps) - steps, steps) + 0.5) / count
    weights = np.full((len(triangle), 3), FOLLOWED)
    row, apex = np.arange(len(triangle)), longest[triangle]
    weights[row, (apex + 1) % 3] = (1 - FOLLOWED) * (1 - along)
    weights[row, (apex + 2) % 3] = (1 - FOLLOWED) * along
    place = np.einsum("nk,nkc->nc", weights, corners[triangle])
    x, y = np.clip(place.astype(np.int64), 0, n - 1).T
    return y * n + x, triangle, weights[:, 1:].astype(np.float32)


def _off_the_edges(scene: Scene, triangle: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Move points that lie on an edge towards the middle of their triangle; returns barycentric weights [K, 2]."""
    corners = np.concatenate([mesh.positions[mesh.indices.astype(np.int64)] for mesh in scene.meshes])[triangle]
    corners = corners.astype(np.float64)
    weights = np.concatenate([1 - barycentric.sum(axis=1, keepdims=True), barycentric], axis=1).astype(np.float64)
    opposite = np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    height = area[:, None] / np.maximum(np.linalg.norm(opposite, axis=2), 1e-30)
    wanted = np.minimum(CLEARANCE * scene.core_extent / np.maximum(height, 1e-30), MOST_CLEARANCE)
    # The least share s of the middle with which w + s (1/3 - w) reaches the wanted value of every weight.
    share = np.where(weights < wanted, (wanted - weights) / np.maximum(1 / 3 - weights, 1e-9), 0).max(axis=1)
    weights += np.clip(share, 0, 1)[:, None] * (1 / 3 - weights)
    return weights[:, 1:].astype(np.float32)


def _flat_scene(uv: np.ndarray):
    """Make a mesh of the triangles [S, 3, 2] of the atlas in the plane z = 0."""
    mesh = mi.Mesh("atlas", 3 * len(uv), len(uv))
    corners = np.concatenate([uv.reshape(-1, 2), np.zeros((3 * len(uv), 1), np.float32)], axis=1)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(np.ascontiguousarray(corners, np.float32).ravel())
    parameters["faces"] = mi.UInt32(np.arange(3 * len(uv), dtype=np.uint32))
    parameters.update()
    return mi.load_dict({"type": "scene", "atlas": mesh})


def _met(flat, n: int, texel: np.ndarray, x: float, y: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Trace rays through one place of some texels; returns hits, triangles and barycentric weights."""
    index = upload_integers(texel)
    at = mi.Point3f((mi.Float(index % n) + x) / n, (mi.Float(index // n) + y) / n, HEIGHT)
    pi = flat.ray_intersect_preliminary(mi.Ray3f(at, mi.Vector3f(0, 0, -1)))
    hit, triangle, uv = pi.is_valid(), pi.prim_index, pi.prim_uv
    dr.eval(hit, triangle, uv)
    return np.array(hit, bool), np.array(triangle).astype(np.int64), np.array(uv).T.astype(np.float32)
