"""From targets of trust to a volume: open flags, parameters, octant masks and the table of fallbacks."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from threadpoolctl import threadpool_limits

from lightwell.probes.pattern import Pattern
from lightwell.probes.support import Support, cube_valid
from lightwell.probes.volume import ALL_OCTANTS, DROPPED, OPEN, WEIGHTED, ProbeVolume
from lightwell.probes.weights import FUNCTIONS, point_weight

# A probe whose target is nowhere (in the air) further from 1 than this needs no record.
OPEN_TOLERANCE = 0.02


def states(target: np.ndarray, valid: np.ndarray, alive: np.ndarray) -> np.ndarray:
    """[B] uint8 of nodes with targets [B, Q]: open where all air of the cube is trusted."""
    useful = alive & (target > 0).any(axis=1)
    # What lies inside of geometry is never asked; ρ may be anything there.
    open_ = useful & ((target >= 1 - OPEN_TOLERANCE) | ~valid).all(axis=1)
    return np.where(open_, OPEN, np.where(useful, WEIGHTED, DROPPED)).astype(np.uint8)


def masks(target: np.ndarray, layout: Pattern) -> np.ndarray:
    """[B] uint64: octants of a cube with a point that may be trusted."""
    inside = np.zeros((len(target), 64), bool)
    octant = layout.octant
    for o in range(64):
        inside[:, o] = (target[:, octant == o] > 0).any(axis=1)
    return (inside.astype(np.uint64) << np.arange(64, dtype=np.uint64)).sum(axis=1, dtype=np.uint64)


def fallbacks(support: Support, state: np.ndarray, target: np.ndarray) -> np.ndarray:
    """[C, 8] int32 node for each octant of each cell: the most trusted corner, else that of the nearest octant along
    free edges; -1 where no path leads to a probe.

    target   [P, Q] trust of all nodes.
    """
    lattice, layout = support.lattice, support.pattern
    octant_of_point = (layout.points >= 0.5) @ np.array([1, 2, 4])
    best = np.zeros((lattice.cell_count, 8))
    node = np.full((lattice.cell_count, 8), -1, np.int64)
    live = np.flatnonzero(state != DROPPED)
    k = len(layout.points)
    cells = lattice.node_cells(live)
    for corner in range(8):
        mine = target[live, corner * k : (corner + 1) * k]
        mean = np.stack([mine[:, octant_of_point == o].mean(axis=1) for o in range(8)], axis=1)
        rows = cells[:, corner] >= 0
        at, mean, who = cells[rows, corner], mean[rows], live[rows]
        better = mean > best[at]
        best[at] = np.where(better, mean, best[at])
        node[at] = np.where(better, who[:, None], node[at])
    return _spread(support, node, octant_of_point).astype(np.int32)


def _spread(support: Support, node: np.ndarray, octant_of_point: np.ndarray) -> np.ndarray:
    """Octants without a probe take that of the nearest octant by free edges."""
    lattice, layout = support.lattice, support.pattern
    cell, edge = np.nonzero(support.free)
    if not len(cell) or not (node >= 0).any():
        return node
    there = lattice.cell_number(lattice.cell_corner(cell) + layout.step[edge])
    a = cell * 8 + octant_of_point[layout.start[edge]]
    b = there * 8 + octant_of_point[layout.end[edge]]
    between = a != b
    pairs = np.unique(np.stack([a[between], b[between]], axis=1), axis=0)
    size = node.size
    graph = csr_matrix((np.ones(len(pairs)), pairs.T), shape=(size, size))
    known = np.flatnonzero(node.ravel() >= 0)
    _, _, source = dijkstra(graph, directed=False, indices=known, min_only=True, return_predecessors=True)
    found = node.ravel().copy()
    reached = source >= 0
    found[reached] = node.ravel()[source[reached]]
    return found.reshape(node.shape)


def assemble(
    support: Support,
    target: np.ndarray,
    function: str,
    fit=None,
    kept: tuple[np.ndarray, np.ndarray] | None = None,
    changed: np.ndarray | None = None,
) -> ProbeVolume:
    """A volume without light.

    target    [P, Q] trust of all nodes.
    fit       (targets, weights, pattern) → parameters; None: the function's own.
    kept      Records of an earlier volume (``row``, ``params``), of which only the nodes ``changed`` are fitted again.
    """
    f = FUNCTIONS[function]
    state = states(target, cube_valid(support, np.arange(len(support.lattice))), support.alive)
    weighted = np.flatnonzero(state == WEIGHTED)
    row = np.full(len(state), -1, np.int32)
    row[weighted] = np.arange(len(weighted))
    params = np.zeros((len(weighted), f.parameters), np.float32)
    fresh = weighted
    if kept is not None:
        old_row, old_params = kept
        fresh = weighted[np.isin(weighted, changed) | (old_row[weighted] < 0)]
        same = np.setdiff1d(weighted, fresh)
        params[row[same]] = old_params[old_row[same]]
    if len(fresh):
        weight = point_weight(target[fresh], support.pattern.hat, cube_valid(support, fresh))
        # Small products in a row: threads of BLAS would cost more than they give.
        with threadpool_limits(1, "blas"):
            params[row[fresh]] = f.quantised((fit or f.fit)(target[fresh], weight, support.pattern))
    return ProbeVolume(
        lattice=support.lattice,
        function=function,
        state=state,
        row=row,
        params=params,
        octant=masks(target[weighted], support.pattern),
        fallback=fallbacks(support, state, target),
        light=np.zeros((len(state), 9, 3), np.float32),
    )


def plain(support: Support, valid_only: bool) -> ProbeVolume:
    """Trilinear interpolation as a volume: every node open, or only those that lie in air."""
    count = len(support.lattice)
    state = np.where(support.alive, OPEN, DROPPED) if valid_only else np.full(count, OPEN)
    return ProbeVolume(
        lattice=support.lattice,
        function="relu-field",
        state=state.astype(np.uint8),
        row=np.full(count, -1, np.int32),
        params=np.zeros((0, FUNCTIONS["relu-field"].parameters), np.float32),
        octant=np.full(0, ALL_OCTANTS, np.uint64),
        fallback=np.full((support.lattice.cell_count, 8), -1, np.int32),
        light=np.zeros((count, 9, 3), np.float32),
    )
