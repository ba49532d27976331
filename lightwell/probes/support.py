"""The geometry of a probe volume: which support points lie in air, which see one another, and where probes look from.

Everything is kept, so that an edit of the scene recomputes only the cells and cubes that it touches. Notation: P nodes,
C cells, S of which are covered (all of them, or those inside bricks), K points, E edges and X places at surfaces of a
cell, Q = 8 K points of a cube.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lightwell.backend import dr, mi
from lightwell.probes import rays, sh
from lightwell.probes.diffusion import REACH, diffuse
from lightwell.probes.lattice import CORNERS, Lattice, _grid
from lightwell.probes.pattern import Pattern, pattern
from lightwell.scenes.scene import Scene
from lightwell.transport.interactions import upload

# A probe inside geometry looks from the nearest valid support point, at most this far from its node, units of h.
MOVE = 0.45
# Nodes further behind a surface are probes too where their hat reaches this at a valid point: their light is what the
# solve finds, so that light goes on to the surface as it came. Without them it stays what the last inner probe has.
# (S5, one offset, no bricks: bright leak 0.0043 -> 0.0031, dark leak 0.0043 -> 0.0028, + 1.1 dB.)
LEAST_HAT = 0.1
# Cubes whose weights are computed together: a few hundred megabytes of edges at most.
CUBES = 256
# Places at surfaces that a cell keeps (X); they stand off this far, and rays look for them this far, units of h.
CLOSE, OFF, REACHED = 48, 0.004, 0.5


@dataclass
class Support:
    """What rays found, with no light in it."""

    lattice: Lattice
    pattern: Pattern
    slot: np.ndarray
    """[C] int32 row of a covered cell, -1 for others."""
    valid: np.ndarray
    """[S, K] bool: support points that lie in air."""
    free: np.ndarray
    """[S, E] bool: edges whose ends lie in air and see each other."""
    near: np.ndarray
    """[S, X, 3] float32 places at surfaces, in the cell, [0, 1]: walls stop light at their face, not at some point."""
    source: np.ndarray
    """[S, X] int32 support point of the cell that sees each of them; -1: none."""
    origin: np.ndarray
    """[P, 3] float32: where probes look from; the node itself unless it lies inside geometry."""
    alive: np.ndarray
    """[P] bool: probes that have such a place."""

    @property
    def stands(self) -> np.ndarray:
        """[P] bool: probes that look from within MOVE of their node; baselines, which solve for no light, have only
        these."""
        way = np.linalg.norm(self.origin - self.lattice.nodes(), axis=1)
        return self.alive & (way <= 1.001 * MOVE * self.lattice.spacing)

    @property
    def covered(self) -> np.ndarray:
        """[S] cells in the order of their rows."""
        return np.flatnonzero(self.slot >= 0)

    def copy(self) -> Support:
        """One that may be changed while this one stays."""
        kept = {name: getattr(self, name).copy() for name in ("valid", "free", "near", "source", "origin", "alive")}
        return replace(self, **kept)

    def points(self, cells: np.ndarray) -> np.ndarray:
        """[len(cells), K, 3] float32 support points."""
        corner = self.lattice.cell_corner(cells)[:, None]
        return (self.lattice.origin + self.lattice.spacing * (corner + self.pattern.points)).astype(np.float32)


def bake_support(
    scene: Scene, lattice: Lattice, layout: Pattern | None = None, cells: np.ndarray | None = None, nodes=None
) -> Support:
    """Cast all rays of a volume, or of some of its cells (sorted) and nodes."""
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
    """Cast the rays of some covered cells (points), cells (edges) and nodes again."""
    batch = max(1, (1 << 20) // support.valid.shape[1])
    for start in range(0, len(cells), batch):
        part = cells[start : start + batch]
        found = rays.valid(scene, support.points(part).reshape(-1, 3))
        support.valid[support.slot[part]] = found.reshape(len(part), -1)
        _approach(scene, support, part)
    _join(scene, support, edge_cells)
    _place(scene, support, nodes)


def _approach(scene: Scene, support: Support, cells: np.ndarray) -> None:
    """Places at surfaces: where a short ray from each support point ends, if that is in the same cell."""
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
    """Which edges of some covered cells are free."""
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
    """Where probes look from: their node, else the nearest valid support point of their cube that counts for them."""
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
    """[B, 8] rows of the cells round some nodes; -1: beyond the border, or not covered."""
    cells = support.lattice.node_cells(nodes)
    return np.where(cells >= 0, support.slot[np.maximum(cells, 0)], -1)


def cube_valid(support: Support, nodes: np.ndarray) -> np.ndarray:
    """[B, Q] bool: points of the cubes of some nodes that lie in air and in the lattice."""
    rows = cube_rows(support, nodes)
    return (support.valid[np.maximum(rows, 0)] & (rows >= 0)[..., None]).reshape(len(nodes), len(support.pattern.u))


def cube_edges(support: Support, nodes: np.ndarray) -> np.ndarray:
    """[B, M] bool: free edges inside the cubes of some nodes."""
    rows = cube_rows(support, nodes)
    _, _, corner, edge = support.pattern.cube_edges.T
    at = rows[:, corner]
    return support.free[np.maximum(at, 0), edge] & (at >= 0)


def cube_near(support: Support, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[B, 8 X, 3] float32 probe-local places at surfaces, and [B, 8 X] the point of the cube that sees each, or -1."""
    rows = cube_rows(support, nodes)
    at, k = np.maximum(rows, 0), len(support.pattern.points)
    u = support.near[at] + (CORNERS - 1).astype(np.float32)[:, None]
    source = support.source[at]
    source = np.where((source >= 0) & (rows >= 0)[..., None], source + k * np.arange(8)[:, None], -1)
    return u.reshape(len(nodes), 8 * CLOSE, 3), source.reshape(len(nodes), 8 * CLOSE)


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
    """[B, Q + 8 X] float16 target ρ of the probes of some nodes: what their weight functions are fitted to, at the
    points of the cube and at its places at surfaces."""
    seen = sees(scene, support, nodes)
    out = np.zeros(seen.shape, np.float32)
    # A probe that sees its whole cube has nothing to diffuse.
    valid = cube_valid(support, nodes)
    rows = np.flatnonzero(seen.any(axis=1) & (valid & ~seen).any(axis=1))
    out[:] = seen
    for start in range(0, len(rows), CUBES):
        part = rows[start : start + CUBES]
        out[part] = diffuse(support.pattern, seen[part], cube_edges(support, nodes[part]), reach)
    return np.concatenate([out, _trust_near(scene, support, nodes, out)], axis=1).astype(np.float16)


def _trust_near(scene: Scene, support: Support, nodes: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """[B, 8 X]: 1 where the probe sees a place at a surface, else the trust of the point that does."""
    u, source = cube_near(support, nodes)
    used = (source >= 0) & rho.any(axis=1)[:, None]
    row, k = np.nonzero(used)
    place = support.lattice.nodes()[nodes[row]] + support.lattice.spacing * u[row, k]
    out = np.zeros(source.shape, np.float32)
    seen = rays.free(scene, support.origin[nodes[row]], place) & support.alive[nodes[row]]
    out[row, k] = np.where(seen, 1, rho[row, source[row, k]])
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
