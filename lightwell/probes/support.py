"""The geometry of a probe volume: which support points lie in air, which see one another, and where probes look from.

Everything is kept, so that an edit of the scene recomputes only the cells and cubes that it touches. Notation: P nodes,
C cells, K points and E edges of a cell, Q = 8 K points of a cube.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.backend import dr, mi
from lightwell.probes import rays
from lightwell.probes.diffusion import REACH, diffuse
from lightwell.probes.lattice import Lattice, _grid
from lightwell.probes.pattern import Pattern, pattern
from lightwell.scenes.scene import Scene
from lightwell.transport.interactions import upload

# A probe inside geometry looks from the nearest valid support point, at most this far from its node, units of h.
MOVE = 0.45
# Cubes whose weights are computed together: a few hundred megabytes of edges at most.
CUBES = 256


@dataclass
class Support:
    """What rays found, with no light in it."""

    lattice: Lattice
    pattern: Pattern
    valid: np.ndarray
    """[C, K] bool: support points that lie in air."""
    free: np.ndarray
    """[C, E] bool: edges whose ends lie in air and see each other."""
    origin: np.ndarray
    """[P, 3] float32: where probes look from; the node itself unless it lies inside geometry."""
    alive: np.ndarray
    """[P] bool: probes that have such a place."""

    def points(self, cells: np.ndarray) -> np.ndarray:
        """[len(cells), K, 3] float32 support points."""
        corner = self.lattice.cell_corner(cells)[:, None]
        return (self.lattice.origin + self.lattice.spacing * (corner + self.pattern.points)).astype(np.float32)


def bake_support(scene: Scene, lattice: Lattice, layout: Pattern | None = None) -> Support:
    """Cast all rays of a volume."""
    layout = layout or pattern()
    k, e = len(layout.points), len(layout.start)
    support = Support(
        lattice,
        layout,
        np.zeros((lattice.cell_count, k), bool),
        np.zeros((lattice.cell_count, e), bool),
        lattice.nodes().astype(np.float32),
        np.zeros(len(lattice), bool),
    )
    cells = np.arange(lattice.cell_count)
    update(scene, support, cells, cells, np.arange(len(lattice)))
    return support


def update(scene: Scene, support: Support, cells: np.ndarray, edge_cells: np.ndarray, nodes: np.ndarray) -> None:
    """Cast the rays of some cells (points), cells (edges) and nodes again."""
    batch = max(1, (1 << 20) // support.valid.shape[1])
    for start in range(0, len(cells), batch):
        part = cells[start : start + batch]
        found = rays.valid(scene, support.points(part).reshape(-1, 3))
        support.valid[part] = found.reshape(len(part), -1)
    _join(scene, support, edge_cells)
    _place(scene, support, nodes)


def _join(scene: Scene, support: Support, cells: np.ndarray) -> None:
    """Which edges of some cells are free."""
    layout, lattice = support.pattern, support.lattice
    batch = max(1, (1 << 21) // len(layout.start))
    for start in range(0, len(cells), batch):
        part = cells[start : start + batch]
        other = lattice.cell_number(lattice.cell_corner(part)[:, None] + layout.step)
        both = support.valid[part][:, layout.start] & (other >= 0)
        both &= support.valid[np.maximum(other, 0), layout.end]
        row, edge = np.nonzero(both)
        origin = support.lattice.origin + lattice.spacing * lattice.cell_corner(part[row])
        a = origin + lattice.spacing * layout.points[layout.start[edge]]
        b = origin + lattice.spacing * (layout.points[layout.end[edge]] + layout.step[edge])
        both[row, edge] = rays.free(scene, a, b)
        support.free[part] = both


def _place(scene: Scene, support: Support, nodes: np.ndarray) -> None:
    """Where probes look from: their node, else the nearest valid support point of their cube."""
    lattice, layout = support.lattice, support.pattern
    place = lattice.nodes()[nodes].astype(np.float32)
    good = rays.valid(scene, place)
    near = np.argsort(np.linalg.norm(layout.u, axis=1), kind="stable")
    near = near[np.linalg.norm(layout.u[near], axis=1) <= MOVE]
    inside = cube_valid(support, nodes)[:, near]
    first = inside.argmax(axis=1)
    moved = ~good & inside.any(axis=1)
    place[moved] += (lattice.spacing * layout.u[near[first[moved]]]).astype(np.float32)
    support.origin[nodes] = place
    support.alive[nodes] = good | moved


def cube_valid(support: Support, nodes: np.ndarray) -> np.ndarray:
    """[B, Q] bool: points of the cubes of some nodes that lie in air and in the lattice."""
    cells = support.lattice.node_cells(nodes)
    return (support.valid[np.maximum(cells, 0)] & (cells >= 0)[..., None]).reshape(len(nodes), -1)


def cube_edges(support: Support, nodes: np.ndarray) -> np.ndarray:
    """[B, M] bool: free edges inside the cubes of some nodes."""
    cells = support.lattice.node_cells(nodes)
    _, _, corner, edge = support.pattern.cube_edges.T
    at = cells[:, corner]
    return support.free[np.maximum(at, 0), edge] & (at >= 0)


def sees(scene: Scene, support: Support, nodes: np.ndarray) -> np.ndarray:
    """[B, Q] bool: valid points of each cube that its probe sees, by a segment from its origin."""
    valid = cube_valid(support, nodes) & support.alive[nodes][:, None]
    row, point = np.nonzero(valid)
    h, layout = support.lattice.spacing, support.pattern
    offsets = upload(mi.Point3f, h * layout.u)
    places = upload(mi.Point3f, support.lattice.nodes()[nodes])
    origins = upload(mi.Point3f, support.origin[nodes])
    for start in range(0, len(row), rays.LAUNCH):
        part = slice(start, start + rays.LAUNCH)
        r, q = mi.UInt32(row[part].astype(np.uint32)), mi.UInt32(point[part].astype(np.uint32))
        target = dr.gather(mi.Point3f, places, r) + dr.gather(mi.Point3f, offsets, q)
        valid[row[part], point[part]] = rays.free_rows(scene, dr.gather(mi.Point3f, origins, r), target)
    return valid


def trust(scene: Scene, support: Support, nodes: np.ndarray, reach: float = REACH) -> np.ndarray:
    """[B, Q] float32 target ρ of the probes of some nodes: what their weight functions are fitted to."""
    seen = sees(scene, support, nodes)
    out = np.zeros(seen.shape, np.float32)
    # A probe that sees its whole cube has nothing to diffuse.
    valid = cube_valid(support, nodes)
    rows = np.flatnonzero(seen.any(axis=1) & (valid & ~seen).any(axis=1))
    out[:] = seen
    for start in range(0, len(rows), CUBES):
        part = rows[start : start + CUBES]
        out[part] = diffuse(support.pattern, seen[part], cube_edges(support, nodes[part]), reach)
    return out


def touched(lattice: Lattice, box: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cells that a box [2, 3] overlaps, cells with an edge into them, and nodes whose cube it overlaps."""
    low = np.floor((box[0] - lattice.origin) / lattice.spacing).astype(np.int64)
    high = np.floor((box[1] - lattice.origin) / lattice.spacing).astype(np.int64)
    at, nodes = _grid(lattice.cells), _grid(lattice.shape)
    cells = np.flatnonzero(np.all((at >= low) & (at <= high), axis=1))
    wide = np.flatnonzero(np.all((at >= low - 1) & (at <= high + 1), axis=1))
    near = np.flatnonzero(np.all((nodes >= low) & (nodes <= high + 1), axis=1))
    return cells, wide, near
