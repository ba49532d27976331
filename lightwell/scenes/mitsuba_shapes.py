"""Mitsuba shapes as triangle meshes in world space. V vertices, T triangles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import mi

# Segments of a full turn of a tessellated disk, cylinder or sphere: the silhouette of a circle is off by 0.03 % of
# its radius, its area by 0.04 %.
TURN = 128


@dataclass(frozen=True)
class Triangles:
    """A surface; the arrays are those of ``scene.Mesh``."""

    positions: np.ndarray
    indices: np.ndarray
    normals: np.ndarray | None
    uv0: np.ndarray | None
    colors: np.ndarray | None = None


def of_mesh(shape: Any) -> Triangles:
    """Read the triangles of a Mitsuba mesh; their winding follows the shading normals, which Mitsuba uses for
    orientation.

    Args:
        shape: Mitsuba mesh.

    Returns:
        Its triangles in world space.
    """
    positions = _rows(shape.vertex_positions_buffer(), 3)
    indices = np.array(shape.faces_buffer()).reshape(-1, 3).astype(np.uint32)
    smooth = shape.has_vertex_normals() and not shape.has_face_normals()
    normals = _rows(shape.vertex_normals_buffer(), 3) if smooth else None
    uv = _rows(shape.vertex_texcoords_buffer(), 2) if shape.has_vertex_texcoords() else None
    colors = None
    if shape.has_attribute("vertex_color"):
        rgb = _rows(shape.attribute_buffer("vertex_color"), 3)
        colors = np.concatenate([rgb, np.ones((len(rgb), 1), np.float32)], axis=1)
    if shape.has_flipped_normals():
        indices = indices[:, [0, 2, 1]]
        normals = None if normals is None else -normals
    if normals is not None and _against(positions, indices, normals):
        indices = indices[:, [0, 2, 1]]
    return Triangles(positions, np.ascontiguousarray(indices), normals, uv, colors)


def _against(positions: np.ndarray, indices: np.ndarray, normals: np.ndarray) -> bool:
    """Test whether the winding of most of the surface contradicts its vertex normals (after a mirroring transform)."""
    a, b, c = (positions[indices[:, k]].astype(np.float64) for k in range(3))
    return float((np.cross(b - a, c - a) * normals[indices].sum(axis=1)).sum()) < 0


def _rows(buffer: Any, width: int) -> np.ndarray:
    return np.array(buffer).reshape(-1, width).astype(np.float32)


def rectangle() -> Triangles:
    """Make the square [-1, 1]² in z = 0 that faces +Z.

    Returns:
        Its triangles.
    """
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)
    positions = np.concatenate([uv * 2 - 1, np.zeros((4, 1))], axis=1)
    return Triangles(positions, np.array([[0, 1, 2], [0, 2, 3]], np.uint32), None, uv)


def disk() -> Triangles:
    """Make the unit disk in z = 0 that faces +Z; (u, v) = (radius, angle / 2π).

    Returns:
        Its triangles.
    """
    turn = np.arange(TURN + 1) / TURN
    angle = 2 * np.pi * turn
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    middle_turn = (turn[:-1] + turn[1:]) / 2
    uv = np.concatenate([np.stack([0 * middle_turn, middle_turn], 1), np.stack([0 * turn + 1, turn], 1)])
    i = np.arange(TURN, dtype=np.uint32)
    return Triangles(np.concatenate([np.zeros((TURN, 3)), rim]), np.stack([i, TURN + i, TURN + i + 1], 1), None, uv)


def cylinder() -> Triangles:
    """Make the open cylinder of radius 1 from z = 0 to z = 1, facing outwards; (u, v) = (angle / 2π, z).

    Returns:
        Its triangles.
    """
    u, v = (a.ravel() for a in np.meshgrid(np.arange(TURN + 1) / TURN, [0.0, 1.0]))
    normals = np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 0 * u], axis=1)
    positions = normals + np.stack([0 * v, 0 * v, v], axis=1)
    return Triangles(positions, _grid(1, TURN), normals, np.stack([u, v], 1))


def sphere() -> Triangles:
    """Make the unit sphere, facing outwards, with poles on the z axis; (u, v) = (azimuth / 2π, polar angle / π).

    Returns:
        Its triangles.
    """
    u, v = (a.ravel() for a in np.meshgrid(np.arange(TURN + 1) / TURN, np.arange(TURN // 2 + 1) / (TURN // 2)))
    phi, theta = 2 * np.pi * u, np.pi * v
    ring = np.sin(theta)
    positions = np.stack([ring * np.cos(phi), ring * np.sin(phi), np.cos(theta)], axis=1)
    indices = _grid(TURN // 2, TURN)[:, ::-1]
    # At the poles one of the two triangles of each cell has no area.
    a, b, c = (positions[indices[:, k]] for k in range(3))
    kept = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-12
    return Triangles(positions, np.ascontiguousarray(indices[kept]), positions.copy(), np.stack([u, v], 1))


def _grid(rows: int, columns: int) -> np.ndarray:
    """Make [2 rows columns, 3] triangles of a grid of (rows + 1) x (columns + 1) vertices."""
    r, c = (a.ravel() for a in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    first = r * (columns + 1) + c
    above = first + columns + 1
    lower = np.stack([first, first + 1, above + 1], 1)
    upper = np.stack([first, above + 1, above], 1)
    return np.concatenate([lower, upper]).astype(np.uint32)


ANALYTIC = {"rectangle": rectangle, "disk": disk, "cylinder": cylinder, "sphere": sphere}


def of_analytic(shape: Any, plugin: str, flipped: bool) -> Triangles:
    """Tessellate a ``rectangle``, ``disk``, ``cylinder`` or ``sphere`` in world space.

    Args:
        shape: Mitsuba shape.
        plugin: Name of its plug-in.
        flipped: The shape faces inwards.

    Returns:
        Its triangles.
    """
    matrix = np.array(mi.traverse(shape)["to_world"].matrix, np.float64).reshape(4, 4)
    if plugin == "disk":  # its matrix holds the flip already
        flipped = False
    elif plugin == "sphere":  # a mirroring transform turns it inside out
        flipped = flipped != (np.linalg.det(matrix[:3, :3]) < 0)
    return moved(ANALYTIC[plugin](), matrix, flipped, keep_facing=True)


def moved(local: Triangles, matrix: np.ndarray, flipped: bool = False, keep_facing: bool = False) -> Triangles:
    """Transform triangles.

    Args:
        local: Triangles to transform; not changed.
        matrix: [4, 4] transform.
        flipped: Reverse the orientation.
        keep_facing: A mirroring transform keeps the outside outside.

    Returns:
        The transformed triangles.
    """
    linear = matrix[:3, :3]
    positions = local.positions @ linear.T + matrix[:3, 3]
    normals, indices = local.normals, local.indices
    if normals is not None:
        normals = normals @ np.linalg.inv(linear)
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True) * (-1 if flipped else 1)
        normals = normals.astype(np.float32)
    if flipped != (keep_facing and np.linalg.det(linear) < 0):
        indices = indices[:, [0, 2, 1]]
    uv = None if local.uv0 is None else local.uv0.astype(np.float32)
    return Triangles(positions.astype(np.float32), np.ascontiguousarray(indices), normals, uv, local.colors)
