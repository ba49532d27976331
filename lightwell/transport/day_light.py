"""Light of the bins of ``radiosity`` under sun and sky, at many times of a day.

The sun lights a bin by a shadow ray, as it does without a sky. What a bin receives of the sky is traced once: rays to
the cells of the sky, a matrix whose product with the radiance of the cells is the irradiance at any time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.sky import COLUMNS, ROWS, STEPS
from lightwell.scenes.variables import Sun
from lightwell.transport.gather_rays import cosine_directions, free_ray
from lightwell.transport.radiosity import LANES, BinLight, Radiosity
from lightwell.transport.sky_source import CELLS, cell_of

# Rays of a bin to the sky.
SKY_RAYS = 64
# Times whose light is made at once; bounds memory.
TIMES_AT_ONCE = 32


@dataclass(frozen=True)
class SkyRays:
    """Rays of bins to what surrounds a scene."""

    count: int = SKY_RAYS
    """Rays of a bin, a square number."""
    whole: bool = False
    """To the whole sphere, from -Y up; else above the horizon alone."""

    @property
    def cells(self) -> int:
        """Number of cells."""
        return CELLS * (2 if self.whole else 1)

    def cell_of(self, way: mi.Vector3f) -> tuple[mi.UInt32, mi.Bool]:
        """Find the cells of directions.

        Args:
            way: [N] unit directions.

        Returns:
            [N] numbers of cells, and where there is one.
        """
        if not self.whole:
            return cell_of(way), way.y > 0
        # Columns are those of the sky; at the horizon a direction is in the sky's first row.
        row = mi.UInt32(dr.clip((way.y + 1) * ROWS, 0, 2 * ROWS - 1))
        return row * COLUMNS + cell_of(mi.Vector3f(way.x, 0, way.z)), mi.Bool(True)


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
    from_sky = sky_rows(radiosity, seed)
    for start in range(0, len(suns), TIMES_AT_ONCE):
        part = slice(start, start + TIMES_AT_ONCE)
        for c in range(3):
            seen = from_sky[c] @ tables.cells[step[part], :, c].T
            direct[part, :count, c] = white[part, :, c] * tables.sun[step[part], c, None] + seen.T
    irradiance[:, :count] = (direct + radiosity.indirect(direct))[:, :count]
    return BinLight(irradiance, np.asarray(suns, np.float32))


def sky_rows(radiosity: Radiosity, seed: int, rays: SkyRays | None = None) -> list[Any]:
    """Trace rays from the bins to what surrounds the scene.

    Args:
        radiosity: The bins.
        seed: Seed of the rays.
        rays: The rays; None: to the sky above the horizon.

    Returns:
        [F, cells] as three sparse matrices: irradiance of bins for a radiance of 1 of the cells, by colour.
    """
    from scipy.sparse import csr_matrix

    rays = rays or SkyRays()
    bins, random = radiosity.bins, np.random.default_rng([seed, 7])
    pick = random.integers(bins.place.shape[1], size=(bins.count, rays.count))
    of_bin = np.arange(bins.count)[:, None]
    place, normal = (table[of_bin, pick].reshape(-1, 3) for table in (bins.place, bins.normal))
    direction = cosine_directions(normal, _strata(bins.count, rays.count, random))
    origin = place + 1e-4 * radiosity.scene.core_extent * normal
    parts = []
    for start in range(0, len(origin), LANES):
        at = slice(start, start + LANES)
        *_, (through, way) = free_ray(radiosity.scene.mi, origin[at], direction[at], seed, start)
        cell, there = rays.cell_of(way)
        weight = dr.select(there, through, 0)
        dr.eval(weight, cell)
        parts.append((np.array(cell), np.nan_to_num(np.array(weight).T, posinf=0, neginf=0) / rays.count))
    column, weights = (np.concatenate(x) for x in zip(*parts))
    row, shape = np.repeat(np.arange(bins.count), rays.count), (bins.count, rays.cells)
    return [csr_matrix((weights[:, c], (row, column)), shape=shape, dtype=np.float32) for c in range(3)]


def _strata(count: int, rays: int, random: np.random.Generator) -> np.ndarray:
    """[2, count * rays] numbers, one in each square of a lattice for each of ``count`` bins."""
    edge = round(rays**0.5)
    cell = np.stack(np.divmod(np.tile(np.arange(rays), count), edge))
    return (cell + random.random(cell.shape)) / edge
