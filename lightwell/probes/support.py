"""Geometry of a probe volume: support points that lie in air, which of them see each other, and the probes' positions.

Everything is kept, so that an edit of the scene recomputes only the cells and cubes that it touches. Notation: P
nodes and C cells of the lattice; S covered cells (all of them, or those inside bricks); K points, E edges and X
places at surfaces of a cell; Q = 8 K points and M edges of a cube; B chosen nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lightwell.backend import dr, mi, upload_integers
from lightwell.probes import rays, sh
from lightwell.probes.diffusion import REACH, diffuse
from lightwell.probes.lattice import CORNERS, ProbeLattice, _grid
from lightwell.probes.pattern import Pattern, pattern
from lightwell.scenes.scene import Scene
from lightwell.transport.interactions import upload

# A probe inside geometry looks from the nearest valid support point, at most this far from its node, units of h.
MOVE = 0.45
# Nodes further behind a surface are probes too if their hat reaches this at a valid point. The solve determines their
# light, so that light is extrapolated to the surface; without them it would be constant beyond the last inner probe
# (S5, one offset, no bricks: bright leak 0.0043 -> 0.0031, dark leak 0.0043 -> 0.0028, + 1.1 dB).
LEAST_HAT = 0.1
# Cubes whose weights are computed together; their edges take a few hundred megabytes at most.
CUBES = 256
# Places at surfaces per cell (X), their distance from the surface, and the length of the rays that find them, in
# units of h.
CLOSE, OFF, REACHED = 48, 0.004, 0.5


@dataclass
class Support:
    """Results of the rays; they do not depend on light."""

    lattice: ProbeLattice
    pattern: Pattern
    slot: np.ndarray
    """[C] int32 row of a covered cell, -1 for others."""
    valid: np.ndarray
    """[S, K] bool: support points that lie in air."""
    free: np.ndarray
    """[S, E] bool: edges whose ends lie in air and see each other."""
    near: np.ndarray
    """[S, X, 3] float32 places at surfaces, in the cell [0, 1]³; with them, trust ends at the face of a wall."""
    source: np.ndarray
    """[S, X] int32 support point of the cell that sees each of them; -1: no place."""
    origin: np.ndarray
    """[P, 3] float32 positions of the probes, metres: the node itself unless it lies inside geometry."""
    alive: np.ndarray
    """[P] bool: probes with a position in air."""

    @property
    def stands(self) -> np.ndarray:
        """[P] bool: probes within MOVE of their node; baselines, which have no solve, use only these."""
        way = np.linalg.norm(self.origin - self.lattice.nodes(), axis=1)
        return self.alive & (way <= 1.001 * MOVE * self.lattice.spacing)

    @property
    def covered(self) -> np.ndarray:
        """[S] indices of the covered cells in the order of their rows."""
        return np.flatnonzero(self.slot >= 0)

    def copy(self) -> Support:
        """Return a copy whose arrays may be changed.

        Returns:
            The copy.
        """
        kept = {name: getattr(self, name).copy() for name in ("valid", "free", "near", "source", "origin", "alive")}
        return replace(self, **kept)

    def points(self, cells: np.ndarray) -> np.ndarray:
        """Return the support points of some cells.

        Args:
            cells: [C'] indices of cells.

        Returns:
            [C', K, 3] float32, metres.
        """
        corner = self.lattice.cell_corner(cells)[:, None]
        return (self.lattice.origin + self.lattice.spacing * (corner + self.pattern.points)).astype(np.float32)


def bake_support(
    scene: Scene,
    lattice: ProbeLattice,
    layout: Pattern | None = None,
    cells: np.ndarray | None = None,
    nodes: np.ndarray | None = None,
) -> Support:
    """Cast all rays of a volume, or of some of its cells and nodes.

    Args:
        scene: The scene.
        lattice: The lattice.
        layout: Pattern of the support points; None for the default one.
        cells: [S] sorted indices of the cells to cover; None for all.
        nodes: [B] indices of the nodes that are probes; None for all.

    Returns:
        The geometry.
    """
    layout = layout or pattern()
    cells = np.arange(lattice.cell_count) if cells is None else cells
    slot = np.full(lattice.cell_count, -1, np.int32)
    slot[cells] = np.arange(len(cells))
    support = Support(
        lattice,
        layout,
        slot,
        np.zeros((len(cells), len(layout.points)), bool),
        np.zeros((len(cells), len(layout.start)), bool),
        np.zeros((len(cells), CLOSE, 3), np.float32),
        np.full((len(cells), CLOSE), -1, np.int32),
        lattice.nodes().astype(np.float32),
        np.zeros(len(lattice), bool),
    )
    update(scene, support, cells, cells, np.arange(len(lattice)) if nodes is None else nodes)
    return support


def update(scene: Scene, support: Support, cells: np.ndarray, edge_cells: np.ndarray, nodes: np.ndarray) -> None:
    """Cast the rays of some cells and nodes again, in place.

    Args:
        scene: The scene.
        support: Geometry to change.
        cells: [C'] indices of covered cells whose points are tested.
        edge_cells: [C''] indices of covered cells whose edges are tested.
        nodes: [B] indices of nodes.
    """
    batch = max(1, (1 << 20) // support.valid.shape[1])
    for start in range(0, len(cells), batch):
        part = cells[start : start + batch]
        found = rays.valid(scene, support.points(part).reshape(-1, 3))
        support.valid[support.slot[part]] = found.reshape(len(part), -1)
        _approach(scene, support, part)
    _join(scene, support, edge_cells)
    _place(scene, support, nodes)


def _approach(scene: Scene, support: Support, cells: np.ndarray) -> None:
    """Find the places at surfaces: ends of short rays from the support points, if in the same cell."""
    layout, h = support.pattern, support.lattice.spacing
    rows, count = support.slot[cells], len(support.pattern.points)
    start = support.points(cells)
    compass = sh.directions(count)[np.random.default_rng(3).permutation(count)]
    hit, t = rays.ends(scene, start.reshape(-1, 3), np.tile(compass, (len(cells), 1)), REACHED * h)
    way = np.maximum(t / h - OFF, 0).reshape(len(cells), count, 1) * compass
    place = layout.points + way
    inside = hit.reshape(len(cells), count) & support.valid[rows] & np.all((place >= 0) & (place <= 1), axis=2)
    order = np.argsort(~inside, axis=1, kind="stable")[:, :CLOSE]
    width = order.shape[1]
    support.near[rows, :width] = np.take_along_axis(place, order[..., None], axis=1)
    support.source[rows, :width] = np.where(np.take_along_axis(inside, order, axis=1), order, -1)


def _join(scene: Scene, support: Support, cells: np.ndarray) -> None:
    """Test which edges of some covered cells are free."""
    layout, lattice = support.pattern, support.lattice
    batch = max(1, (1 << 21) // len(layout.start))
    for start in range(0, len(cells), batch):
        part = cells[start : start + batch]
        other = lattice.cell_number(lattice.cell_corner(part)[:, None] + layout.step)
        other = np.where(other >= 0, support.slot[np.maximum(other, 0)], -1)
        both = support.valid[support.slot[part]][:, layout.start] & (other >= 0)
        both &= support.valid[np.maximum(other, 0), layout.end]
        row, edge = np.nonzero(both)
        origin = support.lattice.origin + lattice.spacing * lattice.cell_corner(part[row])
        a = origin + lattice.spacing * layout.points[layout.start[edge]]
        b = origin + lattice.spacing * (layout.points[layout.end[edge]] + layout.step[edge])
        both[row, edge] = rays.free(scene, a, b)
        support.free[support.slot[part]] = both


def _place(scene: Scene, support: Support, nodes: np.ndarray) -> None:
    """Place the probes: at their node if it is in air, else at the nearest valid support point of their cube."""
    lattice, layout = support.lattice, support.pattern
    place = lattice.nodes()[nodes].astype(np.float32)
    good = rays.valid(scene, place)
    near = np.argsort(np.linalg.norm(layout.u, axis=1), kind="stable")
    near = near[(np.linalg.norm(layout.u[near], axis=1) <= MOVE) | (layout.hat[near] >= LEAST_HAT)]
    inside = cube_valid(support, nodes)[:, near]
    first = inside.argmax(axis=1)
    moved = ~good & inside.any(axis=1)
    place[moved] += (lattice.spacing * layout.u[near[first[moved]]]).astype(np.float32)
    support.origin[nodes] = place
    support.alive[nodes] = good | moved


def cube_rows(support: Support, nodes: np.ndarray) -> np.ndarray:
    """Return the rows of the eight cells around some nodes.

    Args:
        support: The geometry.
        nodes: [B] indices of nodes.

    Returns:
        [B, 8] rows of the geometry's arrays; -1: outside of the lattice, or not covered.
    """
    cells = support.lattice.node_cells(nodes)
    return np.where(cells >= 0, support.slot[np.maximum(cells, 0)], -1)


def cube_valid(support: Support, nodes: np.ndarray) -> np.ndarray:
    """Return which points of some cubes lie in air.

    Args:
        support: The geometry.
        nodes: [B] indices of nodes.

    Returns:
        [B, Q] bool; False outside of the lattice.
    """
    rows = cube_rows(support, nodes)
    return (support.valid[np.maximum(rows, 0)] & (rows >= 0)[..., None]).reshape(len(nodes), len(support.pattern.u))


def cube_edges(support: Support, nodes: np.ndarray) -> np.ndarray:
    """Return which edges inside some cubes are free.

    Args:
        support: The geometry.
        nodes: [B] indices of nodes.

    Returns:
        [B, M] bool.
    """
    rows = cube_rows(support, nodes)
    _, _, corner, edge = support.pattern.cube_edges.T
    at = rows[:, corner]
    return support.free[np.maximum(at, 0), edge] & (at >= 0)


def cube_near(support: Support, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places at surfaces in some cubes.

    Args:
        support: The geometry.
        nodes: [B] indices of nodes.

    Returns:
        [B, 8 X, 3] float32 probe-local positions, and [B, 8 X] the point of the cube that sees each; -1: no place.
    """
    rows = cube_rows(support, nodes)
    at, k = np.maximum(rows, 0), len(support.pattern.points)
    u = support.near[at] + (CORNERS - 1).astype(np.float32)[:, None]
    source = support.source[at]
    source = np.where((source >= 0) & (rows >= 0)[..., None], source + k * np.arange(8)[:, None], -1)
    return u.reshape(len(nodes), 8 * CLOSE, 3), source.reshape(len(nodes), 8 * CLOSE)


def sees(scene: Scene, support: Support, nodes: np.ndarray) -> np.ndarray:
    """Find the valid points of each cube that its probe sees, by a visibility ray from the probe's origin.

    Args:
        scene: The scene.
        support: The geometry.
        nodes: [B] indices of nodes.

    Returns:
        [B, Q] bool.
    """
    valid = cube_valid(support, nodes) & support.alive[nodes][:, None]
    row, point = np.nonzero(valid)
    h, layout = support.lattice.spacing, support.pattern
    offsets = upload(mi.Point3f, h * layout.u)
    places = upload(mi.Point3f, support.lattice.nodes()[nodes])
    origins = upload(mi.Point3f, support.origin[nodes])
    for start in range(0, len(row), rays.LAUNCH):
        part = slice(start, start + rays.LAUNCH)
        r, q = upload_integers(row[part]), upload_integers(point[part])
        target = dr.gather(mi.Point3f, places, r) + dr.gather(mi.Point3f, offsets, q)
        valid[row[part], point[part]] = rays.free_rows(scene, dr.gather(mi.Point3f, origins, r), target)
    return valid


def trust(scene: Scene, support: Support, nodes: np.ndarray, reach: float = REACH) -> np.ndarray:
    """Compute the trust of some probes, to which their weight functions are fitted.

    Args:
        scene: The scene.
        support: The geometry.
        nodes: [B] indices of nodes.
        reach: Distance over which trust falls by a factor of e around corners, units of the spacing.

    Returns:
        [B, Q + 8 X] float16 in [0, 1]: at the points of the cube, then at its places at surfaces.
    """
    seen = sees(scene, support, nodes)
    out = np.zeros(seen.shape, np.float32)
    # A probe that sees its whole cube needs no diffusion.
    valid = cube_valid(support, nodes)
    rows = np.flatnonzero(seen.any(axis=1) & (valid & ~seen).any(axis=1))
    out[:] = seen
    for start in range(0, len(rows), CUBES):
        part = rows[start : start + CUBES]
        out[part] = diffuse(support.pattern, seen[part], cube_edges(support, nodes[part]), reach)
    return np.concatenate([out, _trust_near(scene, support, nodes, out)], axis=1).astype(np.float16)


def _trust_near(scene: Scene, support: Support, nodes: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """[B, 8 X] trust: 1 where the probe sees a place at a surface, else the trust of the point that sees it."""
    u, source = cube_near(support, nodes)
    used = (source >= 0) & rho.any(axis=1)[:, None]
    row, k = np.nonzero(used)
    place = support.lattice.nodes()[nodes[row]] + support.lattice.spacing * u[row, k]
    out = np.zeros(source.shape, np.float32)
    seen = rays.free(scene, support.origin[nodes[row]], place) & support.alive[nodes[row]]
    out[row, k] = np.where(seen, 1, rho[row, source[row, k]])
    return out


def touched(lattice: ProbeLattice, box: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the cells and nodes that an edit inside a box can change.

    Args:
        lattice: The lattice.
        box: [2, 3] least and greatest corner, metres.

    Returns:
        Indices of the cells that the box overlaps, of the cells with an edge into them, and of the nodes whose cube it
        overlaps.
    """
    low = np.floor((box[0] - lattice.origin) / lattice.spacing).astype(np.int64)
    high = np.floor((box[1] - lattice.origin) / lattice.spacing).astype(np.int64)
    at, nodes = _grid(lattice.cells), _grid(lattice.shape)
    cells = np.flatnonzero(np.all((at >= low) & (at <= high), axis=1))
    wide = np.flatnonzero(np.all((at >= low - 1) & (at <= high + 1), axis=1))
    near = np.flatnonzero(np.all((nodes >= low) & (nodes <= high + 1), axis=1))
    return cells, wide, near
