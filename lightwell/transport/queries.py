"""Inputs of a field at surface points: position, normals, view, light and material."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lightwell.scenes.normal_maps import shading_normals
from lightwell.scenes.scene import Scene
from lightwell.transport.moved import by_pose, poses_of, with_rest
from lightwell.transport.samples import Query, SurfacePoints, columns_of

# Smallest reflectance by which a learned value is multiplied (format/FORMAT.md).
SMALLEST_REFLECTANCE = 1e-3
# Interpolated normals shorter than this (opposite vertex normals) have no direction; the geometric one is used.
SHORTEST_NORMAL = 1e-6


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
    from lightwell.scenes.materials import surface_lookup

    reflectance, roughness, metallic = surface_lookup(scene, points.shape, points.triangle, points.barycentric)
    position, normal, flat = frames(scene, points)
    view = np.asarray(points.view, np.float32)
    # The side is that of the triangle, not of the interpolated normal: it must not switch inside a silhouette triangle.
    turned = (dot(flat, view) < 0) != (dot(flat, normal) < 0)
    normal = np.where(turned, -normal, normal)
    return Query(
        position=position,
        normal=normal,
        shading_normal=shading_normals(scene, points.shape, points.triangle, points.barycentric, normal),
        view=view,
        light=np.array(np.broadcast_to(np.asarray(light, np.float32), (len(points), 3))),
        reflectance=np.maximum(np.asarray(reflectance, np.float32), SMALLEST_REFLECTANCE),
        roughness=np.asarray(roughness, np.float32).reshape(-1, 1),
        metallic=np.asarray(metallic, np.float32).reshape(-1, 1),
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
    position, normal, flat = np.zeros((3, len(points), 3), np.float32)
    order = np.argsort(points.shape, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(points.shape[order])) + 1) if len(order) else ():
        index = int(points.shape[rows[0]])
        mesh = scene.meshes[index]
        corners = mesh.indices[points.triangle[rows]]
        b1, b2 = np.asarray(points.barycentric[rows], np.float64).T
        weights = np.stack([1 - b1 - b2, b1, b2], axis=-1)[..., None]
        vertices = mesh.positions[corners].astype(np.float64)
        position[rows] = (weights * vertices).sum(axis=1)
        flat[rows] = _unit(np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0]))
        smooth = flat[rows] if mesh.normals is None else (weights * mesh.normals[corners]).sum(axis=1)
        usable = np.linalg.norm(smooth, axis=-1, keepdims=True) > SHORTEST_NORMAL
        normal[rows] = _unit(np.where(usable, smooth, flat[rows]))
    return position, normal, flat


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-30)
