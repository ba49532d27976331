"""Kinds of probes, fallbacks and bricks in files: a byte a node, a byte a cell, rows where there is something to say.

A cell needs fallbacks only where one of its nodes is not trusted everywhere; each is a node at most ``BELOW`` nodes
below the cell's first one and ``SIDE - BELOW - 1`` above it, in one byte. Notation: see ``volume``.
"""

from __future__ import annotations

import numpy as np

from lightwell.probes.lattice import Lattice
from lightwell.probes.volume import WEIGHTED, Bricks, ProbeVolume

# Nodes along an edge of the block that a byte can name, and how many of them lie below the cell's first node.
SIDE, BELOW, NONE = 6, 2, 255
# Bits of a node: its kind, and whether it is an inner fine probe.
KIND, INNER = 3, 4
# Words of a brick: its cell, its fine probes.
BRICK = 65


def encode_kinds(volume: ProbeVolume) -> np.ndarray:
    """[P + F, 1] uint8."""
    kinds = volume.state.astype(np.uint8).copy()
    if volume.bricks is not None:
        kinds[len(volume.lattice) :] |= np.where(volume.bricks.inner, INNER, 0).astype(np.uint8)
    return kinds[:, None]


def decode_kinds(kinds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State [P + F], record [P + F] and inner [P + F] of stored kinds [P + F]."""
    state = kinds & KIND
    weighted = state == WEIGHTED
    return state, np.where(weighted, np.cumsum(weighted) - 1, -1).astype(np.int32), (kinds & INNER) > 0


def encode_fallbacks(volume: ProbeVolume) -> tuple[np.ndarray, np.ndarray]:
    """[C, 1] uint8: 1 where a cell has a row, and the rows [K, 8] uint8."""
    doubt = volume.in_doubt
    cells = np.flatnonzero(doubt)
    node = volume.fallback[cells].astype(np.int64)
    nx, ny, _ = volume.lattice.shape
    at = np.stack([node % nx, node // nx % ny, node // (nx * ny)], axis=-1)
    step = at - volume.lattice.cell_corner(cells)[:, None] + BELOW
    known = node >= 0
    if not ((step >= 0) & (step < SIDE)).all(axis=-1)[known].all():
        raise ValueError("probes: a fallback is further away than a file can tell")
    code = np.where(known, step @ np.array([1, SIDE, SIDE**2]), NONE)
    return doubt.astype(np.uint8)[:, None], code.astype(np.uint8)


def decode_fallbacks(lattice: Lattice, doubt: np.ndarray, code: np.ndarray) -> np.ndarray | None:
    """[C, 8] int32 of stored cells [C] and rows [K, 8]; None where a node does not exist."""
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
    """[B, 65] uint32, by cell."""
    if volume.bricks is None:
        return np.zeros((0, BRICK), "<u4")
    cells = np.flatnonzero(volume.bricks.cell >= 0)
    table = volume.bricks.table[volume.bricks.cell[cells]]
    return np.concatenate([cells[:, None], table], axis=1).astype("<u4")


def decode_bricks(lattice: Lattice, rows: np.ndarray, inner: np.ndarray) -> Bricks | None:
    """Bricks of stored rows [B, 65]; None where a cell or a probe does not exist. ``inner`` [P + F]."""
    cells, table = rows[:, 0].astype(np.int64), rows[:, 1:].astype(np.int64)
    count = len(lattice)
    good = (np.diff(cells) > 0).all() and cells.max() < lattice.cell_count
    if not good or table.min() < count or table.max() >= len(inner):
        return None
    cell = np.full(lattice.cell_count, -1, np.int32)
    cell[cells] = np.arange(len(cells))
    return Bricks(cell, table.astype(np.int32), inner[count:])
