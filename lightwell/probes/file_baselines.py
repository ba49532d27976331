"""Baselines in a file of probes: distance moments, so that a page compares weights with weights on the same probes.

A row for each node of the lattice: where it looks from (three floats, and whether it does), then 16² texels of an
octahedral map, each two half floats: mean distance and mean square, in spacings.
"""

from __future__ import annotations

import numpy as np

from lightwell.probes.ddgi import SIDE, Moments
from lightwell.probes.lattice import Lattice

# Words of a row.
MOMENTS = 4 + SIDE * SIDE


def moment_rows(moments: Moments) -> np.ndarray:
    """[P, 260] words."""
    h, count = moments.lattice.spacing, len(moments.lattice)
    rows = np.zeros((count, MOMENTS), "<u4")
    rows[:, :3] = moments.origin.astype("<f4").view("<u4")
    rows[:, 3] = moments.alive
    pairs = (moments.maps / np.array([h, h * h])).astype("<f2")
    rows[:, 4:] = np.ascontiguousarray(pairs).view("<u4").reshape(count, -1)
    return rows


def read_moments(rows: np.ndarray, light: np.ndarray, lattice: Lattice, bias: float, name: str) -> Moments:
    """The baseline of some rows; ``light`` [P, 9, 3] as it was traced."""
    if not len(rows) == len(light) == len(lattice):
        raise ValueError(f"{name}: damaged, expected moments of {len(lattice)} nodes; bake it again")
    h = lattice.spacing
    origin = np.ascontiguousarray(rows[:, :3]).view("<f4").astype(np.float32)
    maps = np.ascontiguousarray(rows[:, 4:]).view("<f2").astype(np.float32).reshape(-1, SIDE, SIDE, 2)
    if not (np.isfinite(origin).all() and np.isfinite(maps).all()):
        raise ValueError(f"{name}: damaged, expected finite moments; bake it again")
    return Moments(lattice, origin, rows[:, 3] > 0, maps * np.float32([h, h * h]), light, bias)
