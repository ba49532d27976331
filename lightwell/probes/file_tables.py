"""Tables of a probe file: one byte per node and per cell, rows for cells with fallbacks, for bricks and for sheets.

A cell needs fallbacks only where one of its nodes is not trusted everywhere. Each is stored in one byte: a node at
most ``BELOW`` nodes below the cell's first node and at most ``SIDE - BELOW - 1`` above it. Notation: see
``volume``.
"""

from __future__ import annotations

import numpy as np

from lightwell.probes.lattice import ProbeLattice
from lightwell.probes.sheets import Sheets
from lightwell.probes.volume import FINE, WEIGHTED, Bricks, ProbeVolume

# Edge in nodes of the block that a byte can address, how many of them lie below the cell's first node, and "none".
SIDE, BELOW, NONE = 6, 2, 255
# Bits of a node: its state, and whether it is an inner fine probe.
KIND, INNER = 3, 4
# Words of a brick: its cell, its 64 fine probes, and a bit for each of its 27 fine cells that has a sheet.
BRICK = 66
# Bits of a cell: whether it has a row of fallbacks, and a sheet. Half words of a sheet: its plane, its corners.
DOUBT, CUT, SHEET = 1, 2, 5


def encode_kinds(volume: ProbeVolume) -> np.ndarray:
    """Encode the states of all nodes.

    Args:
        volume: The volume.

    Returns:
        [P + F, 1] uint8.
    """
    kinds = volume.state.astype(np.uint8).copy()
    if volume.bricks is not None:
        kinds[len(volume.lattice) :] |= np.where(volume.bricks.inner, INNER, 0).astype(np.uint8)
    return kinds[:, None]


def decode_kinds(kinds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Decode the states of all nodes.

    Args:
        kinds: [P + F] uint8 as stored.

    Returns:
        [P + F] uint8 states, [P + F] int32 index of the record (-1: none), and [P + F] bool: inner fine probes.
    """
    state = kinds & KIND
    weighted = state == WEIGHTED
    return state, np.where(weighted, np.cumsum(weighted) - 1, -1).astype(np.int32), (kinds & INNER) > 0


def encode_fallbacks(volume: ProbeVolume) -> tuple[np.ndarray, np.ndarray]:
    """Encode the fallback probes of the cells that need them.

    Args:
        volume: The volume.

    Returns:
        [C, 1] uint8, ``DOUBT`` where a cell has a row and ``CUT`` where it has a sheet, and the rows [K, 8] uint8.

    Raises:
        ValueError: A fallback probe is too far from its cell for a byte.
    """
    doubt = volume.in_doubt
    cells = np.flatnonzero(doubt)
    node = volume.fallback[cells].astype(np.int64)
    nx, ny, _ = volume.lattice.shape
    at = np.stack([node % nx, node // nx % ny, node // (nx * ny)], axis=-1)
    step = at - volume.lattice.cell_corner(cells)[:, None] + BELOW
    known = node >= 0
    if not ((step >= 0) & (step < SIDE)).all(axis=-1)[known].all():
        raise ValueError("probes: a fallback probe is too far from its cell for a probe file; bake again")
    code = np.where(known, step @ np.array([1, SIDE, SIDE**2]), NONE)
    kinds = np.where(doubt, DOUBT, 0) | np.where(volume.sheets.row >= 0, CUT, 0)
    return kinds.astype(np.uint8)[:, None], code.astype(np.uint8)


def decode_fallbacks(lattice: ProbeLattice, doubt: np.ndarray, code: np.ndarray) -> np.ndarray | None:
    """Decode the fallback probes.

    Args:
        lattice: Lattice with C cells.
        doubt: [C] bool: cells with a row.
        code: [K, 8] uint8 rows.

    Returns:
        [C, 8] int32 index of the node, -1: none; or None when a node does not exist.
    """
    out = np.full((lattice.cell_count, 8), -1, np.int32)
    cells, known = np.flatnonzero(doubt), code != NONE
    value = code.astype(np.int64)
    step = np.stack([value % SIDE, value // SIDE % SIDE, value // SIDE**2], axis=-1)
    at = lattice.cell_corner(cells)[:, None] + step - BELOW
    if not (((at >= 0) & (at < lattice.shape)).all(axis=-1) | ~known).all():
        return None
    out[cells] = np.where(known, lattice.node_number(at), -1)
    return out


def encode_bricks(volume: ProbeVolume) -> np.ndarray:
    """Encode the bricks, sorted by cell.

    Args:
        volume: The volume.

    Returns:
        [B, 66] uint32: the cell, its 64 fine probes, and bits of its fine cells with a sheet.
    """
    if volume.bricks is None:
        return np.zeros((0, BRICK), "<u4")
    cells = np.flatnonzero(volume.bricks.cell >= 0)
    order = volume.bricks.cell[cells]
    bits = (volume.bricks.sheet[order] >= 0) @ (1 << np.arange(volume.bricks.sheet.shape[1]))
    return np.concatenate([cells[:, None], volume.bricks.table[order], bits[:, None]], axis=1).astype("<u4")


def decode_bricks(lattice: ProbeLattice, rows: np.ndarray, inner: np.ndarray, cut: int) -> Bricks | None:
    """Decode the bricks.

    Args:
        lattice: Lattice with P nodes and C cells.
        rows: [B, 66] uint32 rows.
        inner: [P + F] bool: inner fine probes.
        cut: Number of coarse cells with a sheet: those of fine cells follow.

    Returns:
        The bricks, or None when a cell or a probe does not exist.
    """
    cells, table = rows[:, 0].astype(np.int64), rows[:, 1:-1].astype(np.int64)
    has = (rows[:, -1:] >> np.arange(FINE**3, dtype=np.uint32) & 1).astype(bool)
    sheet = np.where(has, cut + np.cumsum(has).reshape(has.shape) - 1, -1).astype(np.int32)
    count = len(lattice)
    good = (np.diff(cells) > 0).all() and cells.max() < lattice.cell_count
    if not good or table.min() < count or table.max() >= len(inner):
        return None
    cell = np.full(lattice.cell_count, -1, np.int32)
    cell[cells] = np.arange(len(cells))
    return Bricks(cell, table.astype(np.int32), inner[count:], sheet)


def encode_sheets(volume: ProbeVolume) -> np.ndarray:
    """Encode the sheets: those of the lattice's cells, then those of the bricks' fine cells.

    Args:
        volume: The volume.

    Returns:
        [T, 5] uint16: four half floats of the plane, and the corners that count.
    """
    plane = np.ascontiguousarray(volume.sheets.plane.astype("<f2")).view("<u2")
    return np.concatenate([plane, volume.sheets.corners[:, None]], axis=1).astype("<u2")


def decode_sheets(cells: np.ndarray, rows: np.ndarray, fine: int) -> Sheets | None:
    """Decode the sheets.

    Args:
        cells: [C] uint8 bits of the cells.
        rows: [T, 5] uint16 rows.
        fine: Number of fine cells with a sheet.

    Returns:
        The sheets, or None when a row is missing or a number is not finite.
    """
    has = (cells & CUT) > 0
    plane = np.ascontiguousarray(rows[:, :4]).view("<f2").astype(np.float32)
    if int(has.sum()) + fine != len(rows) or not np.isfinite(plane).all():
        return None
    row = np.where(has, np.cumsum(has) - 1, -1).astype(np.int32)
    return Sheets(row, plane, rows[:, 4].astype(np.uint16))
