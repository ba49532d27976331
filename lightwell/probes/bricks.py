"""Bricks: cells where the error is high get a lattice three times finer. Notation: C cells, B bricks, F fine probes."""

from __future__ import annotations

import numpy as np

from lightwell.probes.lattice import Lattice, _grid
from lightwell.probes.volume import FINE, Bricks

# Support points of a fine cell: three times finer cells need fewer points a cell.
FINE_POINTS = 128
# A cell may keep this error (90th percentile of the relative error of its samples, noise taken off).
GOOD_ENOUGH = 0.04
# Power of the brightness in the choice between cells.
BRIGHTNESS = 0.25
# Fine probes per probe that stands at its node, at most.
BUDGET = 1.0


def fine_lattice(lattice: Lattice) -> Lattice:
    """The lattice of all fine nodes; only those of bricks are ever used."""
    return Lattice(lattice.origin, lattice.spacing / FINE, tuple(FINE * (n - 1) + 1 for n in lattice.shape))


def fine_cells(lattice: Lattice, chosen: np.ndarray) -> np.ndarray:
    """Sorted numbers of the fine cells inside chosen cells."""
    at = FINE * lattice.cell_corner(chosen)[:, None] + _grid((FINE,) * 3)
    return np.sort(fine_lattice(lattice).cell_number(at).ravel())


def layout(lattice: Lattice, chosen: np.ndarray) -> tuple[np.ndarray, Bricks]:
    """Fine nodes [F] (sorted numbers in the fine lattice) and the tables of bricks in ``chosen`` cells (sorted)."""
    fine = fine_lattice(lattice)
    node = fine.node_number(FINE * lattice.cell_corner(chosen)[:, None] + _grid((FINE + 1,) * 3))
    nodes, table = np.unique(node, return_inverse=True)
    cell = np.full(lattice.cell_count, -1, np.int32)
    cell[chosen] = np.arange(len(chosen))
    covered = np.zeros(fine.cell_count, bool)
    covered[fine_cells(lattice, chosen)] = True
    near = fine.node_cells(nodes)
    inner = (covered[np.maximum(near, 0)] & (near >= 0)).all(axis=1)
    return nodes, Bricks(cell, (len(lattice) + table.reshape(node.shape)).astype(np.int32), inner)


def worst(error: np.ndarray, bright: np.ndarray, cell: np.ndarray, live: int, budget: float = BUDGET) -> np.ndarray:
    """Sorted cells that deserve a brick: the highest 90th percentile of ``error`` [I] of the samples in ``cell`` [I].

    bright   [I] how bright a sample is. The relative error counts by its fourth root: the eye sees ratios, but what is
             lost beside a lamp is most of the light (S1, equal bytes: + 1.3 dB).
    All cells have one volume and all bricks about one size, so that error by volume and byte is the error itself.
    """
    order = np.argsort(cell, kind="stable")
    cells, first = np.unique(cell[order], return_index=True)
    high = lambda values: np.array([np.quantile(part, 0.9) for part in np.split(values[order], first[1:])])  # noqa: E731
    relative = np.maximum(bright, 0) / max(float(np.mean(bright)), 1e-30)
    plain, score = high(error), high(error * relative**BRIGHTNESS)
    # A brick beside another one adds 27 probes, one alone 64.
    most = int(budget * live / (FINE + 0.5) ** 3)
    ranked = np.argsort(-score, kind="stable")[: max(most, 0)]
    return np.sort(cells[ranked[plain[ranked] > GOOD_ENOUGH]])
