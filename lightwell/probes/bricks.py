"""Bricks: cells with high errors get a lattice three times finer. Notation: C cells, B bricks, F fine probes."""

from __future__ import annotations

import numpy as np

from lightwell.probes.lattice import ProbeLattice, _grid
from lightwell.probes.volume import FINE, Bricks

# Support points of a fine cell; smaller cells need fewer points.
FINE_POINTS = 128
# Error up to which a cell gets no brick (90th percentile of the relative error of its samples, noise subtracted).
GOOD_ENOUGH = 0.04
# Exponent of the brightness in the ranking of cells.
BRIGHTNESS = 0.25
# Largest number of fine probes per probe that looks from near its node.
BUDGET = 1.0


def fine_lattice(lattice: ProbeLattice) -> ProbeLattice:
    """Return the lattice of all fine nodes; only those of bricks are used.

    Args:
        lattice: The coarse lattice.

    Returns:
        Lattice over the same box with ``FINE`` times smaller spacing.
    """
    return ProbeLattice(lattice.origin, lattice.spacing / FINE, tuple(FINE * (n - 1) + 1 for n in lattice.shape))


def brick_cells(lattice: ProbeLattice, chosen: np.ndarray) -> np.ndarray:
    """Return the coordinates of the fine cells of some bricks.

    Args:
        lattice: The coarse lattice.
        chosen: [B] indices of its cells.

    Returns:
        [B, 27, 3] int64 coordinates in the fine lattice, x fastest.
    """
    return FINE * lattice.cell_corner(chosen)[:, None] + _grid((FINE,) * 3)


def fine_cells(lattice: ProbeLattice, chosen: np.ndarray) -> np.ndarray:
    """Return the fine cells inside some cells.

    Args:
        lattice: The coarse lattice.
        chosen: [B] indices of its cells.

    Returns:
        [27 B] sorted indices in the fine lattice.
    """
    return np.sort(fine_lattice(lattice).cell_number(brick_cells(lattice, chosen)).ravel())


def layout(lattice: ProbeLattice, chosen: np.ndarray) -> tuple[np.ndarray, Bricks]:
    """Number the fine nodes of some bricks.

    Args:
        lattice: The coarse lattice.
        chosen: [B] sorted indices of the cells with a brick.

    Returns:
        [F] sorted indices of the fine nodes in the fine lattice, and the tables of the bricks, without sheets.
    """
    fine = fine_lattice(lattice)
    node = fine.node_number(FINE * lattice.cell_corner(chosen)[:, None] + _grid((FINE + 1,) * 3))
    nodes, table = np.unique(node, return_inverse=True)
    cell = np.full(lattice.cell_count, -1, np.int32)
    cell[chosen] = np.arange(len(chosen))
    covered = np.zeros(fine.cell_count, bool)
    covered[fine_cells(lattice, chosen)] = True
    near = fine.node_cells(nodes)
    inner = (covered[np.maximum(near, 0)] & (near >= 0)).all(axis=1)
    none = np.full((len(chosen), FINE**3), -1, np.int32)
    return nodes, Bricks(cell, (len(lattice) + table.reshape(node.shape)).astype(np.int32), inner, none)


def worst(error: np.ndarray, bright: np.ndarray, cell: np.ndarray, live: int, budget: float = BUDGET) -> np.ndarray:
    """Choose the cells that get a brick: those with the highest 90th percentile of the error of their samples.

    The relative error is multiplied by the fourth root of the brightness: perception follows ratios, but most of
    the light is lost next to lamps (S1, equal bytes: + 1.3 dB). All cells have one volume and all bricks about one
    size, so the error needs no division by either.

    Args:
        error: [I] relative error of the samples, noise subtracted.
        bright: [I] brightness of the samples, any unit.
        cell: [I] cell of the coarse lattice in which each sample lies.
        live: Number of probes that look from near their node.
        budget: Largest number of fine probes per such probe.

    Returns:
        [B] sorted indices of cells; only cells with an error above ``GOOD_ENOUGH``.
    """
    order = np.argsort(cell, kind="stable")
    cells, first = np.unique(cell[order], return_index=True)
    high = lambda values: np.array([np.quantile(part, 0.9) for part in np.split(values[order], first[1:])])  # noqa: E731
    relative = np.maximum(bright, 0) / max(float(np.mean(bright)), 1e-30)
    plain, score = high(error), high(error * relative**BRIGHTNESS)
    # A brick next to others adds 27 probes, an isolated one 64.
    most = int(budget * live / (FINE + 0.5) ** 3)
    ranked = np.argsort(-score, kind="stable")[: max(most, 0)]
    return np.sort(cells[ranked[plain[ranked] > GOOD_ENOUGH]])
