"""The fallback probes of a volume: for each octant of a cell, the probe whose light is used where no probe is trusted.

Notation: n nodes of a level; C cells of its lattice, C' of them chosen; K points and X places at surfaces of a cell.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from lightwell.probes.assemble import BrickLevel
from lightwell.probes.lattice import CORNERS, ProbeLattice, hat
from lightwell.probes.support import CLOSE, Support
from lightwell.probes.volume import DROPPED

# Rounds in which octants without a fallback probe take one from their neighbours.
ROUNDS = 2
# Points with little trusted weight Z decide which probe an octant falls back to: their weight is 1 / (Z + this).
LITTLE = 0.02
# Least number of points without a trusted probe that is evidence of an enclosed space.
SHUT_IN = 2
# Cells that are processed together.
BATCH = 1024


def nearest_probes(level: BrickLevel, state: np.ndarray, cells: np.ndarray) -> np.ndarray:
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


def _trust_in(level: BrickLevel, state: np.ndarray, part: np.ndarray) -> tuple[np.ndarray, ...]:
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


def sealed(level: BrickLevel, state: np.ndarray, cells: np.ndarray) -> np.ndarray:
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


def fallbacks(level: BrickLevel, state: np.ndarray, first: np.ndarray, cells: np.ndarray) -> np.ndarray:
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


def around(lattice: ProbeLattice, cells: np.ndarray, rings: int) -> np.ndarray:
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
