"""Builds a volume from trust targets: states of nodes, parameters, octant masks and the table of fallback probes.

Every node (or cell, with its neighbours within a few cells) is computed independently of the others, so that an
incremental bake gives the same bits as a whole one. Notation: n nodes of a level, B of them chosen; P nodes of
the lattice, C cells; Q points of a cube and X places at surfaces of a cell, see ``support``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from threadpoolctl import threadpool_limits

from lightwell.probes.lattice import CORNERS, Lattice, hat
from lightwell.probes.pattern import octants
from lightwell.probes.support import CLOSE, Support, cube_near, cube_valid
from lightwell.probes.volume import ALL_OCTANTS, DROPPED, OPEN, WEIGHTED, Bricks, ProbeVolume
from lightwell.probes.weights import FUNCTIONS, Close, Fit, point_weight

# A probe whose target differs from 1 by at most this everywhere in air needs no record.
OPEN_TOLERANCE = 0.02
# A point counts for the octants within this distance: a wall may leave a thin part of an octant without points.
SLIVER = 0.04
# Rounds in which octants without a fallback probe take one from their neighbours.
ROUNDS = 2
# Points with little trusted weight Z decide which probe an octant falls back to: their weight is 1 / (Z + this).
LITTLE = 0.02
# Least number of points without a trusted probe that is evidence of an enclosed space.
SHUT_IN = 2
# Cells or nodes that are processed together.
BATCH = 1024


@dataclass(frozen=True)
class Level:
    """Nodes of a lattice with the targets of their trust."""

    support: Support
    nodes: np.ndarray
    """[n] indices in the lattice, in the order of the probes."""
    target: np.ndarray
    """[n, Q + 8 X] float16 trust in [0, 1]: at the points of the cube, then at its places at surfaces."""

    @property
    def points(self) -> int:
        """Q, the number of points of a cube."""
        return len(self.support.pattern.u)


@dataclass(frozen=True)
class Records:
    """Stored data of the weights of a level."""

    state: np.ndarray
    """[n] uint8: ``DROPPED``, ``OPEN`` or ``WEIGHTED``."""
    params: np.ndarray
    """[R, C] float32 parameters of the weighted nodes, in order."""
    octant: np.ndarray
    """[R] uint64 masks of octants with trust, see ``masks``."""


def states(level: Level, rows: np.ndarray) -> np.ndarray:
    """Classify nodes as open (trusted wherever the cube is air), weighted or dropped.

    Args:
        level: Nodes with their targets.
        rows: [B] indices of nodes in the level.

    Returns:
        [B] uint8: ``DROPPED``, ``OPEN`` or ``WEIGHTED``.
    """
    out = np.empty(len(rows), np.uint8)
    for start in range(0, len(rows), BATCH):
        part = rows[start : start + BATCH]
        nodes, target = level.nodes[part], level.target[part]
        asked = np.concatenate([cube_valid(level.support, nodes), cube_near(level.support, nodes)[1] >= 0], axis=1)
        useful = level.support.alive[nodes] & (target > 0).any(axis=1)
        # Points inside geometry are never queried; any ρ is right there.
        open_ = useful & ((target >= 1 - OPEN_TOLERANCE) | ~asked).all(axis=1)
        out[start : start + BATCH] = np.where(open_, OPEN, np.where(useful, WEIGHTED, DROPPED))
    return out


def masks(level: Level, rows: np.ndarray) -> np.ndarray:
    """Find the octants of each cube that contain, or lie within ``SLIVER`` of, a point with trust above 0.

    Args:
        level: Nodes with their targets.
        rows: [B] indices of nodes in the level.

    Returns:
        [B] uint64; bit o stands for octant o of the 4³.
    """
    shifts = [np.zeros(3), *(SLIVER * (2 * CORNERS - 1))]
    shared = np.zeros((level.points, 64), bool)
    for shift in shifts:
        shared[np.arange(level.points), octants(level.support.pattern.u + shift)] = True
    out = np.zeros(len(rows), np.uint64)
    for start in range(0, len(rows), BATCH):
        part = rows[start : start + BATCH]
        trusted = level.target[part] > 0
        inside = trusted[:, : level.points].astype(np.float32) @ shared.astype(np.float32) > 0
        u, _ = cube_near(level.support, level.nodes[part])
        probe, k = np.nonzero(trusted[:, level.points :])
        for shift in shifts:
            inside[probe, octants(u[probe, k] + shift)] = True
        bits = inside.astype(np.uint64) << np.arange(64, dtype=np.uint64)
        out[start : start + BATCH] = bits.sum(axis=1, dtype=np.uint64)
    return out


def close_points(level: Level, rows: np.ndarray) -> Close:
    """Collect the places at surfaces in the cubes of some nodes, with targets and weights for a fit.

    Args:
        level: Nodes with their targets.
        rows: [B] indices of nodes in the level.

    Returns:
        [B, 8 X] places with their targets and weights; places that do not exist have weight 0.
    """
    u, source = cube_near(level.support, level.nodes[rows])
    target = level.target[rows, level.points :].astype(np.float32)
    return Close(u, target, point_weight(target, hat(u), target >= 0) * (source >= 0))


def fitted(level: Level, rows: np.ndarray, function: str, fit: Fit | None = None) -> np.ndarray:
    """Fit the weight function of some nodes to their targets.

    Args:
        level: Nodes with their targets.
        rows: [B] indices of nodes in the level.
        function: Name of the weight function, one of ``FUNCTIONS``.
        fit: Replaces the function's own fit, such as one that starts from the generator; None for its own.

    Returns:
        [B, C] float32 parameters, quantised as they are stored.
    """
    f = FUNCTIONS[function]
    params = np.zeros((len(rows), f.parameters), np.float32)
    for start in range(0, len(rows), BATCH):
        part = rows[start : start + BATCH]
        target = level.target[part, : level.points].astype(np.float32)
        weight = point_weight(target, level.support.pattern.hat, cube_valid(level.support, level.nodes[part]))
        # Many small products: BLAS threads would be slower.
        with threadpool_limits(1, "blas"):
            found = (fit or f.fit)(target, weight, level.support.pattern, close_points(level, part))
        params[start : start + BATCH] = f.quantised(found)
    return params


def records(
    level: Level,
    function: str,
    fit: Fit | None = None,
    changed: np.ndarray | None = None,
    kept: Records | None = None,
) -> Records:
    """Compute the stored weights of a level, or only those of the nodes that have changed.

    Args:
        level: Nodes with their targets.
        function: Name of the weight function.
        fit: Replaces the function's own fit; None for its own.
        changed: [B] indices of the nodes to compute again; None for all of them.
        kept: Records of the level before the change; required with ``changed``.

    Returns:
        Records of all nodes of the level.
    """
    rows = np.arange(len(level.nodes)) if changed is None else changed
    found = states(level, rows)
    fresh = rows[found == WEIGHTED]
    params, octant = fitted(level, fresh, function, fit), masks(level, fresh)
    if kept is None:
        return Records(found, params, octant)
    state = kept.state.copy()
    state[rows] = found
    weighted = np.flatnonzero(state == WEIGHTED)
    old = np.cumsum(kept.state == WEIGHTED) - 1
    all_params = np.empty((len(weighted), params.shape[1]), np.float32)
    all_octant = np.empty(len(weighted), np.uint64)
    new = np.isin(weighted, fresh)
    all_params[new], all_octant[new] = params, octant
    all_params[~new], all_octant[~new] = kept.params[old[weighted[~new]]], kept.octant[old[weighted[~new]]]
    return Records(state, all_params, all_octant)


def nearest_probes(level: Level, state: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Choose a fallback probe for each octant of some cells: the one most trusted where the total trust is low.

    Args:
        level: All nodes of its lattice, with their targets.
        state: [n] uint8 states of the nodes.
        cells: [C'] indices of cells.

    Returns:
        [C', 8] int32 index of the node; -1: none is trusted there.
    """
    out = np.full((len(cells), 8), -1, np.int32)
    for start in range(0, len(cells), BATCH):
        node, place, air, trust, z = _trust_in(level, state, cells[start : start + BATCH])
        weight, octant = air / (z + LITTLE), (place >= 0.5) @ np.array([1, 2, 4])
        for o in range(8):
            score = (trust * (weight * (octant == o))).sum(axis=2)
            best = score.argmax(axis=0)
            chosen = np.take_along_axis(node, best[:, None], axis=1)[:, 0]
            out[start : start + BATCH, o] = np.where(score.max(axis=0) > 0, chosen, -1)
    return out


def _trust_in(level: Level, state: np.ndarray, part: np.ndarray) -> tuple[np.ndarray, ...]:
    """For some cells: nodes [B, 8], positions [B, K + X, 3] of points and of places at surfaces, whether they lie in
    air [B, K + X], trust [8, B, K + X] of the nodes there, and its hat-weighted sum [B, K + X]."""
    support, lattice, layout = level.support, level.support.lattice, level.support.pattern
    k, rows = len(layout.points), support.slot[part]
    node = lattice.node_number(lattice.cell_corner(part)[:, None] + CORNERS)
    place = np.concatenate([np.broadcast_to(layout.points, (len(part), k, 3)), support.near[rows]], axis=1)
    air = np.concatenate([support.valid[rows], support.source[rows] >= 0], axis=1)
    trust = np.empty((8, *air.shape), np.float32)
    z = np.zeros(air.shape, np.float32)
    for corner in range(8):
        mine, j = level.target[node[:, corner]], 7 - corner
        near = mine[:, level.points + j * CLOSE : level.points + (j + 1) * CLOSE]
        trust[corner] = np.concatenate([mine[:, j * k : (j + 1) * k], near], axis=1)
        trust[corner][state[node[:, corner]] == DROPPED] = 0
        z += hat(place - CORNERS[corner]).astype(np.float32) * trust[corner]
    return node, place, air, trust, z


def sealed(level: Level, state: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Find octants of cells that must not fall back to a probe, because their points without trust are enclosed.

    The inside of a wall modelled as two-sided sheets counts as air, and a fallback would light it (veach-ajar, one
    offset: nine tenths of the bright leak). Points without trust are enclosed unless free edges of the cell connect
    them to a point with trust.

    Args:
        level: All nodes of its lattice, with their targets.
        state: [n] uint8 states of the nodes.
        cells: [C'] indices of cells.

    Returns:
        [C', 8] bool: octants without a fallback.
    """
    support, layout = level.support, level.support.pattern
    k, out = len(layout.points), np.zeros((len(cells), 8), bool)
    here = np.flatnonzero(~layout.step.any(axis=1))
    octant = (layout.points >= 0.5) @ np.array([1, 2, 4])
    for start in range(0, len(cells), BATCH):
        part = cells[start : start + BATCH]
        _, _, air, _, z = _trust_in(level, state, part)
        lonely = air[:, :k] & (z[:, :k] == 0)
        asked = np.flatnonzero(lonely.sum(axis=1) >= SHUT_IN)
        if not len(asked):
            continue
        rows = support.slot[part[asked]]
        cell, edge = np.nonzero(support.free[rows][:, here])
        ends = [cell * k + side[here[edge]] for side in (layout.start, layout.end)]
        shape = (len(asked) * k,) * 2
        count, group = connected_components(csr_matrix((np.ones(len(cell), bool), ends), shape=shape), directed=False)
        known = z[asked] > 0
        # A trusted place at a surface makes the point that sees it trusted.
        row, near = np.nonzero(known[:, k:] & (support.source[rows] >= 0))
        trusted = known[:, :k].copy()
        trusted[row, support.source[rows[row], near]] = True
        reached = (np.bincount(group, trusted.ravel(), count) > 0)[group].reshape(len(asked), k)
        for o in range(8):
            mine = lonely[asked] & (octant == o)
            shut = (mine & ~reached).sum(axis=1)
            out[start + asked, o] = (shut >= SHUT_IN) & (shut > (mine & reached).sum(axis=1))
    return out


def fallbacks(level: Level, state: np.ndarray, first: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Compute the fallback probes of some cells.

    Args:
        level: All nodes of its lattice, with their targets.
        state: [n] uint8 states of the nodes.
        first: [C, 8] int32 result of ``nearest_probes`` for all cells.
        cells: [C'] indices of cells.

    Returns:
        [C', 8] int32 index of the node; -1: none.
    """
    return np.where(sealed(level, state, cells), -1, spread(level.support, first, cells))


def spread(support: Support, first: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Give octants without a fallback probe that of a neighbouring octant to which a free edge leads.

    Args:
        support: Edges of the lattice's cells.
        first: [C, 8] int32 fallback probes of all cells; -1: none.
        cells: [C'] indices of cells.

    Returns:
        [C', 8] int32 index of the node; -1: still none after ``ROUNDS`` rounds.
    """
    lattice, layout = support.lattice, support.pattern
    octant = (layout.points >= 0.5) @ np.array([1, 2, 4])
    # Edges between the same two octants are grouped: one free edge of a group connects them.
    kind = np.stack([octant[layout.start], octant[layout.end], *(layout.step.T + 1)], axis=1) @ (1, 8, 64, 192, 576)
    order = np.argsort(kind, kind="stable")
    kinds, begin = np.unique(kind[order], return_index=True)
    wide = around(lattice, cells, ROUNDS // 2 + 1)
    linked = np.logical_or.reduceat(support.free[support.slot[wide]][:, order], begin, axis=1)
    row, which = np.nonzero(linked)
    here, sort = wide[row], kinds[which]
    step = np.stack([sort // 64 % 3, sort // 192 % 3, sort // 576], axis=1) - 1
    a, b = here * 8 + sort % 8, lattice.cell_number(lattice.cell_corner(here) + step) * 8 + sort // 8 % 8
    a, b = np.concatenate([a, b]), np.concatenate([b, a])
    found, none = first.ravel().copy(), np.iinfo(np.int32).max
    for _ in range(ROUNDS):
        best = np.full(len(found), none, np.int32)
        known = found[b] >= 0
        np.minimum.at(best, a[known], found[b[known]])
        found = np.where((found < 0) & (best < none), best, found)
    return found.reshape(first.shape)[cells]


def around(lattice: Lattice, cells: np.ndarray, rings: int) -> np.ndarray:
    """Return the cells within some rings of given cells.

    Args:
        lattice: The lattice.
        cells: [C'] indices of cells.
        rings: Number of cells in each direction, ≥ 0.

    Returns:
        [C''] sorted indices of cells, the given ones included.
    """
    inside = np.zeros(lattice.cells[::-1], bool)
    x, y, z = lattice.cell_corner(cells).T
    inside[z, y, x] = True
    for _ in range(rings):
        for axis in range(3):
            grown = np.moveaxis(inside.copy(), axis, 0)
            old = np.moveaxis(inside, axis, 0)
            grown[1:] |= old[:-1]
            grown[:-1] |= old[1:]
            inside = np.moveaxis(grown, 0, axis)
    return np.flatnonzero(inside.ravel())


def assemble(
    coarse: Level,
    function: str,
    found: Records,
    fallback: np.ndarray,
    fine: tuple[Records, Bricks] | None = None,
) -> ProbeVolume:
    """Build a volume without light from the records of its nodes.

    Args:
        coarse: The lattice's level.
        function: Name of the weight function.
        found: Records of the lattice's nodes.
        fallback: [C, 8] int32 fallback probes of all cells.
        fine: Records of the fine probes and the tables of the bricks; None without bricks.

    Returns:
        The volume; its light is 0.
    """
    parts = [found] if fine is None else [found, fine[0]]
    state = np.concatenate([part.state for part in parts])
    row = np.where(state == WEIGHTED, np.cumsum(state == WEIGHTED) - 1, -1).astype(np.int32)
    return ProbeVolume(
        lattice=coarse.support.lattice,
        function=function,
        state=state,
        row=row,
        params=np.concatenate([part.params for part in parts]),
        octant=np.concatenate([part.octant for part in parts]),
        fallback=fallback,
        light=np.zeros((len(state), 9, 3), np.float32),
        bricks=None if fine is None else fine[1],
    )


def plain(support: Support, valid_only: bool) -> ProbeVolume:
    """Build trilinear interpolation, the baseline, as a volume without light.

    Args:
        support: Geometry of the lattice.
        valid_only: Use only probes that lie in air (within ``MOVE`` of their node); else all nodes.

    Returns:
        The volume; every node is open or dropped, and its light is 0.
    """
    count = len(support.lattice)
    state = np.where(support.stands, OPEN, DROPPED) if valid_only else np.full(count, OPEN)
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
