"""Inputs of a field at surface points: position, normals, view, light and material."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from lightwell.backend import dr
from lightwell.scenes.corners import Corners, Vertices, crosses, dots, lengths, vertices_of
from lightwell.scenes.materials import surface_lookup
from lightwell.scenes.normal_maps import relief, shading_normals
from lightwell.scenes.scene import Scene
from lightwell.transport.moved import by_pose, poses_of, with_rest
from lightwell.transport.samples import Query, SurfacePoints, columns_of

# Interpolated normals shorter than this (opposite vertex normals) have no direction; the geometric one is used.
SHORTEST_NORMAL = 1e-6
# Points of a block, of 2^13 to 2^17 the best on three scenes: smaller ones have few points of each material.
ROWS_AT_ONCE = 1 << 15


def make_query(scene: Scene, points: SurfacePoints, light: np.ndarray) -> Query:
    """Make the named inputs of a shading graph.

    Args:
        scene: Scene of the points.
        points: N points.
        light: [N, 3] or [3] positions of the light, metres (directions of a sun).

    Returns:
        N rows of inputs.
    """
    return _moving_query(scene, points, light) if scene.movers else _query(scene, points, light)


def _moving_query(scene: Scene, points: SurfacePoints, light: np.ndarray) -> Query:
    """Queries of points in their poses; without a pose they are at rest."""
    light = np.broadcast_to(np.asarray(light, np.float32), (len(points), 3))
    initial = [mover.initial for mover in scene.movers]
    pose = poses_of(len(points), initial) if points.pose is None else points.pose
    rows, parts = [np.zeros(0, np.int64)], []
    for found, scene_of_pose, own in by_pose(scene, points):
        rows.append(found)
        parts.append(_query(scene_of_pose, own, light[found]))
    if not parts:
        parts.append(_query(replace(scene, movers=()), replace(points, pose=None), light))
    order = np.argsort(np.concatenate(rows), kind="stable")
    columns = [columns_of(part) for part in parts]
    query = Query(**{name: np.concatenate([part[name] for part in columns]) for name in columns[0]})
    return with_rest(scene.movers, query[order] if len(order) else query, points.shape, pose)


def _query(scene: Scene, points: SurfacePoints, light: np.ndarray) -> Query:
    # What the cache of the scene holds is read here: another thread would wait for the one that makes a result.
    vertices, bends = vertices_of(scene), relief(scene)
    view = np.asarray(points.view, np.float32)
    position, normal, bent, reflectance = np.empty((4, len(points), 3), np.float32)
    roughness, metallic = np.empty((2, len(points), 1), np.float32)

    def fill(rows: slice) -> None:
        shape, corners = _corners(vertices, points, rows)
        place, smooth, flat = _frames(vertices, corners)
        towards = view[rows].T
        # The side is that of the triangle, not of the interpolated normal: it must not switch inside a silhouette
        # triangle.
        smooth = np.where((dots(flat, towards) < 0) != (dots(flat, smooth) < 0), -smooth, smooth)
        looked = surface_lookup(scene, vertices, shape, corners)
        position[rows], normal[rows] = place.T, smooth.T
        bent[rows] = shading_normals(scene, vertices, bends, shape, corners, smooth).T
        reflectance[rows], roughness[rows, 0], metallic[rows, 0] = looked[0].T, looked[1], looked[2]

    _by_blocks(len(points), fill)
    return Query(
        position=position,
        normal=normal,
        shading_normal=bent,
        view=view,
        light=np.array(np.broadcast_to(np.asarray(light, np.float32), (len(points), 3))),
        reflectance=reflectance,
        roughness=roughness,
        metallic=metallic,
    )


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compute dot products by row.

    Args:
        a: [..., C] vectors.
        b: [..., C] vectors.

    Returns:
        [..., 1] products.
    """
    return (a * b).sum(-1, keepdims=True)


def frames(scene: Scene, points: SurfacePoints) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Interpolate positions and normals at points.

    Args:
        scene: Scene of the points.
        points: N points.

    Returns:
        Positions, unit interpolated vertex normals (geometric where a mesh has none) and unit geometric normals on the
        front of the triangles; [N, 3] float32 each.
    """
    vertices = vertices_of(scene)
    position, normal, flat = np.empty((3, len(points), 3), np.float32)

    def fill(rows: slice) -> None:
        found = _frames(vertices, _corners(vertices, points, rows)[1])
        position[rows], normal[rows], flat[rows] = (v.T for v in found)

    _by_blocks(len(points), fill)
    return position, normal, flat


def _frames(vertices: Vertices, corners: Corners) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What ``frames`` returns, [3, N] float32 each."""
    place = corners.values(vertices.positions)
    flat = _unit(crosses(place[1] - place[0], place[2] - place[0])).astype(np.float32)
    smooth = corners.between(corners.values(vertices.normals))
    normal = _unit(np.where(lengths(smooth) > SHORTEST_NORMAL, smooth, flat))
    return corners.between(place).astype(np.float32), normal.astype(np.float32), flat


def _corners(vertices: Vertices, points: SurfacePoints, rows: slice) -> tuple[np.ndarray, Corners]:
    """Meshes and corners of some points."""
    shape = np.asarray(points.shape[rows], np.int64)
    return shape, Corners.of(vertices, shape, points.triangle[rows], points.barycentric[rows])


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.maximum(lengths(v), 1e-30)


def _by_blocks(count: int, fill: Callable[[slice], None]) -> None:
    """Do work for all rows, by all threads, in blocks that stay in their caches."""
    blocks = [slice(begin, begin + ROWS_AT_ONCE) for begin in range(0, count, ROWS_AT_ONCE)]
    if len(blocks) < 2:
        for rows in blocks:
            fill(rows)
        return
    with ThreadPoolExecutor(dr.thread_count()) as pool:
        for _ in pool.map(fill, blocks):
            pass
