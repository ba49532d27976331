"""Charts of groups of small triangles: each group is projected along an axis into a rectangle of the atlas.

Surfaces that lie behind one another in the same cell share texels: the light map holds the light of one of them.

Notation: see ``atlas_charts``; K triangles of a panel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.scenes.triangle_groups import TriangleGroups, nearest_axis, planar

# A rectangle takes at most so many times the area of its triangles, and each edge this many texels at least.
ROOMY, LEAST_EDGE = 2.0, 2.0
# Corners of a rectangle, as shares of its edges, and its two triangles.
CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


@dataclass(frozen=True)
class Panel:
    """The triangles of one group on one side."""

    triangle: np.ndarray
    """[K] number in the concatenation."""
    side: int
    place: np.ndarray
    """[K, 3, 2] float32 corners, as shares of the edges of the rectangle."""
    edges: np.ndarray
    """[2] edges of the rectangle, metres times the density of the mesh."""


def panels(scene: Scene, lit: np.ndarray, density: np.ndarray | None, groups: TriangleGroups) -> list[Panel]:
    """Project the lit sides of groups.

    Args:
        scene: Scene with T triangles in M meshes.
        lit: [2, T] bool: sides to store.
        density: [M] texels per metre of each mesh relative to the others; None: the same for all.
        groups: The groups of the scene.

    Returns:
        One panel for each group and lit side.
    """
    if not groups.count:
        return []
    corners = np.concatenate([mesh.positions[mesh.indices] for mesh in scene.meshes])
    scale = np.ones(len(scene.meshes)) if density is None else density
    of = np.repeat(np.arange(len(scene.meshes)), [len(mesh.indices) for mesh in scene.meshes])
    made = []
    for side in (0, 1):
        rows = np.flatnonzero(lit[side] & (groups.label >= 0))
        rows = rows[np.argsort(groups.label[rows], kind="stable")]
        for triangle in np.split(rows, np.flatnonzero(np.diff(groups.label[rows])) + 1) if len(rows) else ():
            made.append(_panel(corners[triangle], triangle, side, float(scale[of[triangle]].mean())))
    return made


def _panel(corners: np.ndarray, triangle: np.ndarray, side: int, scale: float) -> Panel:
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Triangles of no area have no direction of their own.
    flat = planar(corners, np.full(len(corners), nearest_axis(normal.sum(axis=0)[None])[0]))
    low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    edges = np.maximum((high - low).astype(np.float64), 1e-12)
    area = np.linalg.norm(normal.astype(np.float64), axis=1).sum() / 2
    shrunk = np.sqrt(min(1.0, ROOMY * area / edges.prod()))
    return Panel(triangle, side, ((flat - low) / edges).astype(np.float32), edges * shrunk * scale)


def laid_out(panel: Panel, texels: float, scale: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Lay the rectangle of a panel out for the packer.

    Args:
        panel: The panel.
        texels: Texels per metre of the other charts.
        scale: Factor by which all charts are enlarged at first.

    Returns:
        Points [4, 2] in texels before that factor, triangles [2, 3], and 1, the number of charts.
    """
    edges = np.maximum(panel.edges * texels, LEAST_EDGE / scale)
    return (CORNERS * edges).astype(np.float32), TRIANGLES, 1


def collect(
    laid: Sequence[Panel],
    packed: Sequence[np.ndarray],
    uv: np.ndarray,
    chart: np.ndarray,
    first: int,
) -> None:
    """Write the coordinates and charts of panels.

    Args:
        laid: Panels.
        packed: Corners [2, 3, 2] of the triangles of each rectangle, uv.
        uv: [2, T, 3, 2] coordinates to write to.
        chart: [2, T] charts to write to.
        first: Number of the first panel's chart.
    """
    for number, (panel, place) in enumerate(zip(laid, packed), first):
        origin, along, up = place[0, 0], place[0, 1], place[1, 2]
        share = panel.place
        uv[panel.side, panel.triangle] = origin + share[..., :1] * (along - origin) + share[..., 1:] * (up - origin)
        chart[panel.side, panel.triangle] = number
