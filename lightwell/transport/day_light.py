"""Light of the bins of ``radiosity`` under sun and sky, at many times of a day.

The sun lights a bin by a shadow ray, as it does without a sky. What a bin receives of the sky is traced once: rays to
the cells of the sky, a matrix whose product with the radiance of the cells is the irradiance at any time.
"""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr
from lightwell.scenes.sky import STEPS
from lightwell.scenes.variables import Sun
from lightwell.transport.gather_rays import cosine_directions, free_ray
from lightwell.transport.radiosity import LANES, BinLight, Radiosity
from lightwell.transport.sky_source import CELLS, cell_of

# Rays of a bin to the sky.
SKY_RAYS = 64
# Times whose light is made at once; bounds memory.
TIMES_AT_ONCE = 32


def day_light(radiosity: Radiosity, variable: Sun, suns: np.ndarray, seed: int) -> BinLight:
    """Compute the irradiance of the bins and the radiance of the sky.

    Args:
        radiosity: The bins.
        variable: A sun with a sky.
        suns: [K, 3] directions to it.
        seed: Seed of the rays.

    Returns:
        Light of each time, divided by its level.
    """
    tables, count = variable.tables, radiosity.bins.count
    step = np.rint(variable.time(suns) * (STEPS - 1)).astype(int)
    white = radiosity.direct(variable, suns, seed)[:, :count]
    irradiance = np.zeros((len(suns), count + CELLS + 1, 3), np.float32)
    irradiance[:, count:-1] = tables.cells[step]
    direct = np.zeros((len(suns), count + 1, 3), np.float32)
    from_sky = _sky_rows(radiosity, seed)
    for start in range(0, len(suns), TIMES_AT_ONCE):
        part = slice(start, start + TIMES_AT_ONCE)
        for c in range(3):
            seen = from_sky[c] @ tables.cells[step[part], :, c].T
            direct[part, :count, c] = white[part] * tables.sun[step[part], c, None] + seen.T
    irradiance[:, :count] = (direct + radiosity.indirect(direct))[:, :count]
    return BinLight(irradiance, np.asarray(suns, np.float32))


def _sky_rows(radiosity: Radiosity, seed: int):
    """[F, CELLS] as three sparse matrices: irradiance of bins for a radiance of 1 of the cells."""
    from scipy.sparse import csr_matrix

    bins, random = radiosity.bins, np.random.default_rng([seed, 7])
    pick = random.integers(bins.place.shape[1], size=(bins.count, SKY_RAYS))
    of_bin = np.arange(bins.count)[:, None]
    place, normal = (table[of_bin, pick].reshape(-1, 3) for table in (bins.place, bins.normal))
    direction = cosine_directions(normal, _strata(bins.count, random))
    origin = place + 1e-4 * radiosity.scene.core_extent * normal
    parts = []
    for start in range(0, len(origin), LANES):
        at = slice(start, start + LANES)
        *_, (through, way) = free_ray(radiosity.scene.mi, origin[at], direction[at], seed, start)
        cell = cell_of(way)
        dr.eval(through, cell, way)
        weight = np.where(np.array(way.y)[:, None] > 0, np.array(through).T, 0)
        parts.append((np.array(cell), np.nan_to_num(weight, posinf=0, neginf=0) / SKY_RAYS))
    column, weight = (np.concatenate(x) for x in zip(*parts))
    row, shape = np.repeat(np.arange(bins.count), SKY_RAYS), (bins.count, CELLS)
    return [csr_matrix((weight[:, c], (row, column)), shape=shape, dtype=np.float32) for c in range(3)]


def _strata(count: int, random: np.random.Generator) -> np.ndarray:
    """[2, count * SKY_RAYS] numbers, one in each square of a lattice for each of ``count`` bins."""
    edge = round(SKY_RAYS**0.5)
    cell = np.stack(np.divmod(np.tile(np.arange(SKY_RAYS), count), edge))
    return (cell + random.random(cell.shape)) / edge
