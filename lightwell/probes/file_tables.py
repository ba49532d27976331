"""Tables of a probe file: one byte per node and per cell, rows for cells with fallbacks and for bricks.

A cell needs fallbacks only where one of its nodes is not trusted everywhere. Each is stored in one byte: a node at
most ``BELOW`` nodes below the cell's first node and at most ``SIDE - BELOW - 1`` above it. Notation: see
``volume``.
"""

from __future__ import annotations

import numpy as np

from lightwell.probes.lattice import ProbeLattice
from lightwell.probes.volume import WEIGHTED, Bricks, ProbeVolume

# Edge in nodes of the block that a byte can address, how many of them lie below the cell's first node, and "none".
SIDE, BELOW, NONE = 6, 2, 255
# Bits of a node: its state, and whether it is an inner fine probe.
KIND, INNER = 3, 4
# Words of a brick: its cell and its 64 fine probes.
BRICK = 65


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
        [C, 1] uint8, 1 where a cell has a row, and the rows [K, 8] uint8.

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
    return doubt.astype(np.uint8)[:, None], code.astype(np.uint8)


def decode_fallbacks(lattice: ProbeLattice, doubt: np.ndarray, code: np.ndarray) -> np.ndarray | None:
    """Decode the fallback probes.

    Args:
        lattice: Lattice with C cells.
        doubt: [C] 1 where a cell has a row.
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
        [B, 65] uint32: the cell, then its 64 fine probes.
    """
    if volume.bricks is None:
        return np.zeros((0, BRICK), "<u4")
    cells = np.flatnonzero(volume.bricks.cell >= 0)
    table = volume.bricks.table[volume.bricks.cell[cells]]
    return np.concatenate([cells[:, None], table], axis=1).astype("<u4")


def decode_bricks(lattice: ProbeLattice, rows: np.ndarray, inner: np.ndarray) -> Bricks | None:
    """Decode the bricks.

    Args:
        lattice: Lattice with P nodes and C cells.
        rows: [B, 65] uint32 rows.
        inner: [P + F] bool: inner fine probes.

    Returns:
        The bricks, or None when a cell or a probe does not exist.
    """
    cells, table = rows[:, 0].astype(np.int64), rows[:, 1:].astype(np.int64)
    count = len(lattice)
    good = (np.diff(cells) > 0).all() and cells.max() < lattice.cell_count
    if not good or table.min() < count or table.max() >= len(inner):
        return None
    cell = np.full(lattice.cell_count, -1, np.int32)
    cell[cells] = np.arange(len(cells))
    return Bricks(cell, table.astype(np.int32), inner[count:])
