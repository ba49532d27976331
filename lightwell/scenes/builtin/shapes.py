"""Mesh generators of the built-in scenes: quads, boxes, lathes, tubes and leaves.

Notation: V vertices, T triangles, lengths in metres, +Y up, counter-clockwise front faces. Every part has unit normals
and *metric* texture coordinates (one unit is one metre, v down), so that patterns have the same scale everywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

# Triangles smaller than this (square metres) are poles of a lathe and are left out.
SMALLEST_AREA = 1e-9

# Outward axis, then the two in-plane axes u and v with u x v = outward.
FACES: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {
    name: (np.array(outward, np.float64), np.array(u, np.float64), np.array(v, np.float64))
    for name, (outward, u, v) in {
        "+x": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
        "-x": ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
        "+y": ((0, 1, 0), (1, 0, 0), (0, 0, -1)),
        "-y": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
        "+z": ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
        "-z": ((0, 0, -1), (-1, 0, 0), (0, 1, 0)),
    }.items()
}


@dataclass(frozen=True)
class MeshPart:
    """Triangles without a material."""

    positions: np.ndarray
    """[V, 3] float64, metres."""
    normals: np.ndarray
    """[V, 3] float64, unit."""
    uv: np.ndarray
    """[V, 2] float64, metres, v down."""
    indices: np.ndarray
    """[T, 3] int64."""


def merge(parts: Iterable[MeshPart]) -> MeshPart:
    """Join parts, in order.

    Args:
        parts: Parts to join.

    Returns:
        One part with all triangles.
    """
    parts = list(parts)
    starts = np.cumsum([0] + [len(p.positions) for p in parts[:-1]])
    return MeshPart(
        np.concatenate([p.positions for p in parts]),
        np.concatenate([p.normals for p in parts]),
        np.concatenate([p.uv for p in parts]),
        np.concatenate([p.indices + start for p, start in zip(parts, starts)]),
    )


def move(part: MeshPart, offset: Sequence[float]) -> MeshPart:
    """Translate a part.

    Args:
        part: Part to move; not changed.
        offset: [3] metres.

    Returns:
        The moved part.
    """
    return MeshPart(part.positions + np.asarray(offset), part.normals, part.uv, part.indices)


def rotate(part: MeshPart, degrees: float, axis: str = "y") -> MeshPart:
    """Rotate a part counter-clockwise about a coordinate axis through the origin.

    Args:
        part: Part to rotate; not changed.
        degrees: Angle, degrees.
        axis: 'x', 'y' or 'z'.

    Returns:
        The rotated part.
    """
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = {
        "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
        "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
        "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    }[axis]
    turn = np.array(matrix).T
    return MeshPart(part.positions @ turn, part.normals @ turn, part.uv, part.indices)


def _without_slivers(positions: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """Remove triangles of (almost) zero area from ``indices`` [T, 3]."""
    a, b, c = (positions[indices[:, k]] for k in range(3))
    return indices[0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1) > SMALLEST_AREA]


def quad(corner: ArrayLike, u: ArrayLike, v: ArrayLike, fit: bool = False) -> MeshPart:
    """Make the parallelogram corner, corner+u, corner+u+v, corner+v; it faces along u x v.

    Args:
        corner: [3] first corner, metres.
        u: [3] first edge, metres.
        v: [3] second edge, metres.
        fit: Texture coordinates span [0, 1]² once, upright when v points up; otherwise they follow the world position,
            so that patterns continue on neighbouring faces.

    Returns:
        Its triangles.
    """
    corner, u, v = np.asarray(corner, np.float64), np.asarray(u, np.float64), np.asarray(v, np.float64)
    positions = corner + np.array([0 * u, u, u + v, v])
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    along, up = u / np.linalg.norm(u), v / np.linalg.norm(v)
    uv = np.stack([positions @ along, -(positions @ up)], axis=1)
    if fit:
        uv = np.array([[0.0, 1], [1, 1], [1, 0], [0, 0]])
    return MeshPart(positions, np.tile(normal, (4, 1)), uv, np.array([[0, 1, 2], [0, 2, 3]]))


def box(low: ArrayLike, high: ArrayLike, skip: Sequence[str] = (), grain: bool = False) -> MeshPart:
    """Make an axis-aligned box.

    Args:
        low: [3] smallest corner, metres.
        high: [3] largest corner, metres.
        skip: Faces to leave out, such as '-y' where it stands on something.
        grain: The texture's u axis runs along the longer edge of each face, as wood is cut.

    Returns:
        Its triangles.
    """
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    parts = []
    for name, (outward, u, v) in FACES.items():
        if name in skip:
            continue
        # Start at the corner where u and v are smallest on the outward side.
        pick = outward - u - v
        corner = np.where(pick > 0, high, low)
        face = quad(corner, u * (high - low), v * (high - low))
        if grain and abs(u @ (high - low)) < abs(v @ (high - low)):
            face = MeshPart(face.positions, face.normals, face.uv[:, ::-1], face.indices)
        parts.append(face)
    return merge(parts)


def board(low: Sequence[float], high: Sequence[float], skip: Sequence[str] = ()) -> MeshPart:
    """Make a wooden box: the grain runs along it.

    Args:
        low: [3] smallest corner, metres.
        high: [3] largest corner, metres.
        skip: Faces to leave out.

    Returns:
        Its triangles.
    """
    return box(low, high, skip, grain=True)


def prism(base: np.ndarray, height: float, bottom: bool = False) -> MeshPart:
    """Extrude a convex polygon upwards.

    Args:
        base: [K, 2] polygon in (x, z), counter-clockwise seen from above, metres.
        height: Metres.
        bottom: Close it at the bottom.

    Returns:
        Its triangles.
    """
    ring = np.array([[x, 0.0, z] for x, z in base])
    sides = [quad(a, b - a, [0, height, 0]) for a, b in zip(ring, np.roll(ring, -1, axis=0))]
    fan = np.array([[0, k, k + 1] for k in range(1, len(ring) - 1)])
    flat = np.stack([ring[:, 0], ring[:, 2]], axis=1)
    up = np.array([0.0, 1, 0])
    top = MeshPart(ring + height * up, np.tile(up, (len(ring), 1)), flat, fan)
    under = MeshPart(ring, np.tile(-up, (len(ring), 1)), flat, fan[:, ::-1])
    return merge([*sides, top, *([under] if bottom else [])])


def lathe(profile: Sequence[tuple[float, float]], segments: int = 32, smooth: bool = False) -> MeshPart:
    """Rotate a profile about the Y axis.

    Args:
        profile: Points (radius, y), upwards on the outside, metres.
        segments: Segments of a full turn.
        smooth: Smooth the normals along the profile too; around the axis they always are.

    Returns:
        Its triangles.
    """
    points = np.asarray(profile, dtype=np.float64)
    steps = np.diff(points, axis=0)
    slopes = np.stack([steps[:, 1], -steps[:, 0]], axis=1) / np.linalg.norm(steps, axis=1)[:, None]
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(steps, axis=1))])
    bands = []
    for k in range(len(steps)):
        ends = [slopes[k], slopes[k]]
        if smooth:
            ends = [slopes[max(k - 1, 0)] + slopes[k], slopes[k] + slopes[min(k + 1, len(steps) - 1)]]
        bands.append(_band(points[k : k + 2], np.array(ends), arc[k : k + 2], segments))
    return merge(bands)


def _band(ends: np.ndarray, slopes: np.ndarray, arc: np.ndarray, segments: int) -> MeshPart:
    """Rotate one profile segment: ``ends`` [2, 2] (radius, y), ``slopes`` [2, 2] its normals, ``arc`` [2] lengths."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    around = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)
    # The seam must be the same point twice, to the last bit.
    around[-1] = around[0]
    up = np.array([0.0, 1, 0])
    slopes = slopes / np.linalg.norm(slopes, axis=1)[:, None]
    positions = np.concatenate([r * around + y * up for r, y in ends])
    normals = np.concatenate([r * around + y * up for r, y in slopes])
    width = angle * max(ends[:, 0].max(), 1e-3)
    uv = np.concatenate([np.stack([width, np.full_like(angle, -a)], axis=1) for a in arc])
    k, n = np.arange(segments), segments + 1
    indices = np.concatenate([np.stack([k, k + 1, k + 1 + n], 1), np.stack([k, k + 1 + n, k + n], 1)])
    return MeshPart(positions, normals, uv, _without_slivers(positions, indices))


def cylinder(radius: float, height: float, segments: int = 32, bottom: bool = True) -> MeshPart:
    """Make an upright cylinder on the origin, closed at the top.

    Args:
        radius: Metres.
        height: Metres.
        segments: Segments of a full turn.
        bottom: Close it at the bottom.

    Returns:
        Its triangles.
    """
    start = [(0.0, 0.0)] if bottom else []
    return lathe([*start, (radius, 0.0), (radius, height), (0.0, height)], segments)


def sphere(radius: float, rings: int = 12, segments: int = 24) -> MeshPart:
    """Make a sphere about the origin.

    Args:
        radius: Metres.
        rings: Segments from pole to pole.
        segments: Segments of a full turn.

    Returns:
        Its triangles.
    """
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    radii = radius * np.cos(angle)
    radii[[0, -1]] = 0.0
    return lathe(list(zip(radii, radius * np.sin(angle))), segments, smooth=True)


def _parallel_frames(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute two unit vectors [K, 3] across a path [K, 3] that is nowhere parallel to (0.31, 0.17, 0.93)."""
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    side = np.cross(tangent, [0.31, 0.17, 0.93])
    side /= np.linalg.norm(side, axis=1)[:, None]
    return side, np.cross(tangent, side)


def tube(path: np.ndarray, radii: np.ndarray, segments: int = 8) -> MeshPart:
    """Make a round tube along a path, its ends closed by flat discs.

    Args:
        path: [K, 3] points of the axis, metres.
        radii: [K] radii, metres.
        segments: Segments of a full turn.

    Returns:
        Its triangles.
    """
    path, radii = np.asarray(path, dtype=np.float64), np.asarray(radii, dtype=np.float64)
    side, other = _parallel_frames(path)
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    ring = np.cos(angle)[:, None, None] * side + np.sin(angle)[:, None, None] * other
    ring[-1] = ring[0]
    positions = (path + radii[:, None] * ring).transpose(1, 0, 2).reshape(-1, 3)
    normals = ring.transpose(1, 0, 2).reshape(-1, 3)
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(arc[:, None], angle * radii.max()), axis=-1).reshape(-1, 2)
    k, n = np.meshgrid(np.arange(len(path) - 1), np.arange(segments), indexing="ij")
    a = (k * (segments + 1) + n).ravel()
    b = a + segments + 1
    indices = np.concatenate([np.stack([a, a + 1, b + 1], 1), np.stack([a, b + 1, b], 1)])
    wall = MeshPart(positions, normals, uv, indices)
    caps = [_cap(path[i], ring[:-1, i] * radii[i], flip) for i, flip in ((0, True), (-1, False))]
    return merge([wall, *caps])


def _cap(center: np.ndarray, ring: np.ndarray, flip: bool) -> MeshPart:
    """Make a disc over ``ring`` [K, 3] (offsets from the centre), facing along the ring's rotation or against it."""
    k = np.arange(len(ring))
    indices = np.stack([np.full_like(k, len(ring)), k, (k + 1) % len(ring)], axis=1)
    normal = np.cross(ring[0], ring[1])
    normal /= np.linalg.norm(normal)
    positions = np.concatenate([center + ring, center[None]])
    uv = np.stack([positions @ ring[0], positions @ ring[len(ring) // 4]], axis=1) / np.linalg.norm(ring[0])
    if flip:
        indices, normal = indices[:, ::-1], -normal
    return MeshPart(positions, np.tile(normal, (len(positions), 1)), uv, indices)


def rod(start: ArrayLike, end: ArrayLike, radius: float, segments: int = 8) -> MeshPart:
    """Make a straight round rod.

    Args:
        start: [3] first end, metres.
        end: [3] second end, metres.
        radius: Metres.
        segments: Segments of a full turn.

    Returns:
        Its triangles.
    """
    return tube(np.array([start, end], dtype=np.float64), np.array([radius, radius]), segments)


def leaf(length: float, width: float, droop: float, steps: int = 8) -> MeshPart:
    """Make a single-sheet leaf from the origin along +x, folded along its rib.

    Args:
        length: Metres.
        width: Metres.
        droop: Angle between the directions at both ends, radians.
        steps: Segments along the leaf.

    Returns:
        Its triangles.
    """
    t = np.linspace(0, 1, steps + 1)
    bend = np.cumsum(np.concatenate([[0], np.full(steps, droop / steps)])) - 0.15
    spine = np.concatenate([[[0, 0, 0]], np.cumsum(np.stack([np.cos(bend), -np.sin(bend), 0 * t], 1)[:-1], 0)])
    spine *= length / steps
    half = 0.5 * width * np.sin(np.pi * np.clip(t, 0.02, 0.985) ** 0.8) ** 0.75
    lift = np.stack([np.sin(bend), np.cos(bend), 0 * t], 1) * (0.22 * half)[:, None]
    across = np.stack([0 * t, 0 * t, half], 1)
    rows = np.stack([spine + across + lift, spine, spine - across + lift], axis=1)
    a = (np.arange(steps)[:, None] * 3 + np.arange(2)).ravel()
    indices = np.concatenate([np.stack([a, a + 3, a + 4], 1), np.stack([a, a + 4, a + 1], 1)])
    positions = rows.reshape(-1, 3)
    uv = np.stack(np.broadcast_arrays(t[:, None] * length, np.array([-0.5, 0, 0.5]) * width), -1).reshape(-1, 2)
    return MeshPart(positions, _vertex_normals(positions, indices), uv, indices)


def _vertex_normals(positions: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """Compute [V, 3] area-weighted unit normals."""
    a, b, c = (positions[indices[:, k]] for k in range(3))
    normals = np.zeros_like(positions)
    for k in range(3):
        np.add.at(normals, indices[:, k], np.cross(b - a, c - a))
    return normals / np.linalg.norm(normals, axis=1)[:, None]
