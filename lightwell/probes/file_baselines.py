"""Distance moments in a file of probes, so that a page can compare weights on the same probes.

One row per node of the lattice: its position (three floats) and whether it is alive, then 16² texels of an
octahedral map, each two float16: mean distance and mean squared distance, in spacings.
"""

from __future__ import annotations

import numpy as np

from lightwell.probes.ddgi import SIDE, Moments
from lightwell.probes.lattice import ProbeLattice

# Words of a row: position, whether it is alive, texels.
MOMENTS = 4 + SIDE * SIDE


def moment_rows(moments: Moments) -> np.ndarray:
    """Encode the moments of all nodes.

    Args:
        moments: The baseline with P nodes.

    Returns:
        [P, 260] uint32 words.
    """
    h, count = moments.lattice.spacing, len(moments.lattice)
    rows = np.zeros((count, MOMENTS), "<u4")
    rows[:, :3] = moments.origin.astype("<f4").view("<u4")
    rows[:, 3] = moments.alive
    pairs = (moments.maps / np.array([h, h * h])).astype("<f2")
    rows[:, 4:] = np.ascontiguousarray(pairs).view("<u4").reshape(count, -1)
    return rows


def read_moments(rows: np.ndarray, light: np.ndarray, lattice: ProbeLattice, bias: float, name: str) -> Moments:
    """Decode the moments of all nodes.

    Args:
        rows: [P, 260] uint32 words.
        light: [P, 9, 3] traced irradiance harmonics.
        lattice: Lattice with P nodes.
        bias: Offset of queries along the normal, units of the spacing.
        name: Name of the file, for messages.

    Returns:
        The baseline.

    Raises:
        ValueError: The number of rows is wrong, or a number is not finite.
    """
    if not len(rows) == len(light) == len(lattice):
        raise ValueError(f"{name}: damaged, expected moments of {len(lattice)} nodes; bake it again")
    h = lattice.spacing
    origin = np.ascontiguousarray(rows[:, :3]).view("<f4").astype(np.float32)
    maps = np.ascontiguousarray(rows[:, 4:]).view("<f2").astype(np.float32).reshape(-1, SIDE, SIDE, 2)
    if not (np.isfinite(origin).all() and np.isfinite(maps).all()):
        raise ValueError(f"{name}: damaged, expected finite moments; bake it again")
    return Moments(lattice, origin, rows[:, 3] > 0, maps * np.float32([h, h * h]), light, bias)
