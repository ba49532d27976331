"""Builds a volume from trust targets: states of nodes, parameters and octant masks.

Every node (or cell, with its neighbours within a few cells) is computed independently of the others, so that an
incremental bake gives the same bits as a whole one. Notation: n nodes of a level, B of them chosen; P nodes of
the lattice, C cells; Q points of a cube and X places at surfaces of a cell, see ``support``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from lightwell.probes.bricks import brick_cells, fine_lattice
from lightwell.probes.lattice import CORNERS, hat
from lightwell.probes.pattern import octants
from lightwell.probes.sheets import Sheets, cut_off
from lightwell.probes.support import Support, cube_near, cube_valid
from lightwell.probes.volume import ALL_OCTANTS, DROPPED, OPEN, WEIGHTED, Bricks, ProbeVolume
from lightwell.probes.weights import FUNCTIONS, Close, Fit, point_weight

# A probe whose target differs from 1 by at most this everywhere in air needs no record.
OPEN_TOLERANCE = 0.02
# A point counts for the octants within this distance: a wall may leave a thin part of an octant without points.
SLIVER = 0.04
# Nodes that are processed together.
BATCH = 1024


@dataclass(frozen=True)
class BrickLevel:
    """Nodes of a lattice with the targets of their trust."""

    support: Support
    nodes: np.ndarray
    """[n] indices in the lattice, in the order of the probes."""
    target: np.ndarray
    """[n, Q + 8 X] float16 trust in [0, 1]: at the points of the cube, then at its places at surfaces."""
    sheets: Sheets
    """Planes of thin walls in the cells."""

    @property
    def points(self) -> int:
        """Q, the number of points of a cube."""
        return len(self.support.pattern.u)


@dataclass(frozen=True)
class ProbeRecords:
    """Stored data of the weights of a level."""

    state: np.ndarray
    """[n] uint8: ``DROPPED``, ``OPEN`` or ``WEIGHTED``."""
    params: np.ndarray
    """[R, C] float32 parameters of the weighted nodes, in order."""
    octant: np.ndarray
    """[R] uint64 masks of octants with trust, see ``masks``."""


def states(level: BrickLevel, rows: np.ndarray) -> np.ndarray:
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
        asked &= ~cut_off(level.sheets, level.support, nodes)
        useful = level.support.alive[nodes] & (target > 0).any(axis=1)
        # Points inside geometry are never queried, and sheets cut off others: any ρ is right there.
        open_ = useful & ((target >= 1 - OPEN_TOLERANCE) | ~asked).all(axis=1)
        out[start : start + BATCH] = np.where(open_, OPEN, np.where(useful, WEIGHTED, DROPPED))
    return out


def masks(level: BrickLevel, rows: np.ndarray) -> np.ndarray:
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


def close_points(level: BrickLevel, rows: np.ndarray) -> Close:
    """Collect the places at surfaces in the cubes of some nodes, with targets and weights for a fit.

    Args:
        level: Nodes with their targets.
        rows: [B] indices of nodes in the level.

    Returns:
        [B, 8 X] places with their targets and weights; places that do not exist have weight 0.
    """
    u, source = cube_near(level.support, level.nodes[rows])
    target = level.target[rows, level.points :].astype(np.float32)
    off = cut_off(level.sheets, level.support, level.nodes[rows])[:, level.points :]
    return Close(u, target, point_weight(target, hat(u), target >= 0, off) * (source >= 0))


def fitted(level: BrickLevel, rows: np.ndarray, function: str, fit: Fit | None = None) -> np.ndarray:
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
        off = cut_off(level.sheets, level.support, level.nodes[part])[:, : level.points]
        weight = point_weight(target, level.support.pattern.hat, cube_valid(level.support, level.nodes[part]), off)
        # Many small products: BLAS threads would be slower.
        with threadpool_limits(1, "blas"):
            found = (fit or f.fit)(target, weight, level.support.pattern, close_points(level, part))
        params[start : start + BATCH] = f.quantised(found)
    return params


def records(
    level: BrickLevel,
    function: str,
    fit: Fit | None = None,
    changed: np.ndarray | None = None,
    kept: ProbeRecords | None = None,
) -> ProbeRecords:
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
        return ProbeRecords(found, params, octant)
    state = kept.state.copy()
    state[rows] = found
    weighted = np.flatnonzero(state == WEIGHTED)
    old = np.cumsum(kept.state == WEIGHTED) - 1
    all_params = np.empty((len(weighted), params.shape[1]), np.float32)
    all_octant = np.empty(len(weighted), np.uint64)
    new = np.isin(weighted, fresh)
    all_params[new], all_octant[new] = params, octant
    all_params[~new], all_octant[~new] = kept.params[old[weighted[~new]]], kept.octant[old[weighted[~new]]]
    return ProbeRecords(state, all_params, all_octant)


def assemble(
    coarse: BrickLevel,
    function: str,
    found: ProbeRecords,
    fallback: np.ndarray,
    fine: tuple[BrickLevel, ProbeRecords, Bricks] | None = None,
) -> ProbeVolume:
    """Build a volume without light from the records of its nodes.

    Args:
        coarse: The lattice's level.
        function: Name of the weight function.
        found: Records of the lattice's nodes.
        fallback: [C, 8] int32 fallback probes of all cells.
        fine: Level and records of the fine probes, and the tables of the bricks; None without bricks.

    Returns:
        The volume; its light is 0.
    """
    parts = [found] if fine is None else [found, fine[1]]
    sheets, bricks = coarse.sheets, None
    if fine is not None:
        sheets, bricks = _with_fine(coarse, fine[0], fine[2])
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
        bricks=bricks,
        sheets=sheets,
    )


def _with_fine(coarse: BrickLevel, fine: BrickLevel, bricks: Bricks) -> tuple[Sheets, Bricks]:
    """The planes of the lattice followed by those of the fine cells, and the bricks with the rows of theirs."""
    lattice, count = coarse.support.lattice, len(coarse.sheets.plane)
    chosen = np.flatnonzero(bricks.cell >= 0)
    row = fine.sheets.row[fine_lattice(lattice).cell_number(brick_cells(lattice, chosen))]
    used = row >= 0
    # In the order of the bricks, as files have them.
    number = np.where(used, count + np.cumsum(used).reshape(row.shape) - 1, -1).astype(np.int32)
    plane = np.concatenate([coarse.sheets.plane, fine.sheets.plane[row[used]]])
    corners = np.concatenate([coarse.sheets.corners, fine.sheets.corners[row[used]]])
    return Sheets(coarse.sheets.row, plane, corners), replace(bricks, sheet=number)


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
        sheets=Sheets.none(support.lattice.cell_count),
    )
