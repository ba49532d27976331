"""Light of the bins of ``radiosity`` under an environment map, at many angles, and shards of that light.

What a bin receives from the cells of a sphere is traced once: a matrix whose product with the radiance of the cells at
an angle is its irradiance. Maps hold suns, which few rays meet: points, where errors show, sample the map itself.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lightwell.scenes.sky import COLUMNS, ROWS
from lightwell.scenes.turning import Turning
from lightwell.transport.day_light import SkyRays, sky_rows
from lightwell.transport.environment import environment_picture
from lightwell.transport.gather_sums import Gather
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.radiance import DIRECT_DEPTH, indirect
from lightwell.transport.radiosity import BinLight, Radiosity
from lightwell.transport.sky_source import CELLS

# Rays of a bin to the map: its suns are small.
MAP_RAYS = 256
# Rows of the picture of which a cell is the mean.
PICTURE_ROWS = 512
# Random stream of the light that points receive in a straight line.
DIRECT_STREAM = 0x7E


def turned_cells(picture: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Compute the mean radiance of the cells of a sphere under a turned map.

    Args:
        picture: [H, 2 H, 3] radiance as ``environment_picture`` makes it, H a multiple of ``COLUMNS / 2``.
        angles: [K] degrees, clockwise seen from above.

    Returns:
        [K, 2 ROWS * COLUMNS, 3] float32; cells row by row from -Y, columns by atan2(z, x) from 0.
    """
    height, width = picture.shape[:2]
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    # Share of each row of cells that each row of the picture fills, by the sine of the elevation.
    low = np.arange(2 * ROWS)[:, None] / ROWS - 1
    overlap = np.minimum(edges[:-1], low + 1 / ROWS) - np.maximum(edges[1:], low)
    rows = np.einsum("rh,hwc->rwc", np.maximum(overlap, 0) * ROWS, picture.astype(np.float64))
    # The integral along a row, so that a cell between two columns has its share of both.
    whole = np.concatenate([np.zeros((2 * ROWS, 1, 3)), np.cumsum(rows, axis=1)], axis=1)
    # The first column of the picture is at -π; the map's column at a direction is that of the direction turned back.
    starts = (np.arange(COLUMNS) / COLUMNS + 0.5 - np.asarray(angles)[:, None] / 360) % 1.0 * width
    first, last = _until(whole, starts), _until(whole, starts + width / COLUMNS)
    cells = (last - first) * (COLUMNS / width)
    return np.moveaxis(cells, 0, 1).reshape(len(angles), -1, 3).astype(np.float32)


def _until(whole: np.ndarray, place: np.ndarray) -> np.ndarray:
    """[R, K, C, 3] integrals of periodic rows [R, W + 1, 3] up to places [K, C] in columns."""
    width = whole.shape[1] - 1
    turns, rest = np.divmod(place, width)
    k = np.minimum(rest.astype(int), width - 1)
    share = (rest - k)[..., None]
    return whole[:, k] * (1 - share) + whole[:, k + 1] * share + whole[:, -1][:, None, None] * turns[..., None]


def turned_light(radiosity: Radiosity, variable: Turning, norths: np.ndarray, seed: int) -> BinLight:
    """Compute the irradiance of the bins under a turned map.

    Args:
        radiosity: The bins, of a scene that has the map as its ``surrounding``.
        variable: The map.
        norths: [K, 3] where its north has turned to.
        seed: Seed of the rays.

    Returns:
        Light of each angle.
    """
    picture, count = environment_picture(radiosity.scene, PICTURE_ROWS), radiosity.bins.count
    assert picture is not None
    cells = turned_cells(picture, variable.angle(norths))
    direct = np.zeros((len(norths), count + 1, 3), np.float32)
    for c, rows in enumerate(sky_rows(radiosity, seed, SkyRays(MAP_RAYS, whole=True))):
        direct[:, :count, c] = (rows @ np.ascontiguousarray(cells[..., c].T)).T
    return BinLight(direct + radiosity.indirect(direct), np.asarray(norths, np.float32))


class TurnedShards(GatheredShards):
    """Makes shards of an environment map that turns: paths to the map at the points, and a gather over lit bins."""

    _variable: Turning

    @property
    def paths(self) -> int:
        """Paths of a sample of its own, to the map."""
        return self._settings.paths

    @cached_property
    def _gather(self) -> Gather:
        lit = turned_light(self.seen.radiosity, self._variable, self.lights, int(self._seeds[3])).irradiance
        # Where people look as they do under a sky, rays note its cells, which are dark here.
        behind = np.zeros((len(lit), CELLS if self._sky else 0, 3), np.float32)
        return Gather(self.seen.rows, np.concatenate([lit, behind], axis=1))

    def _columns(
        self, point: np.ndarray, light: np.ndarray, weight: np.ndarray, paths: int, seed: int
    ) -> tuple[dict, dict]:
        columns, counts = super()._columns(point, light, weight, paths, seed)
        seed = int(np.random.SeedSequence([seed, DIRECT_STREAM]).generate_state(1)[0])
        each = self._settings.paths
        straight = indirect(
            self._scene, self.points[point], self.lights[light], self._variable, each, seed, max_depth=DIRECT_DEPTH
        )
        for name, found in zip(("half_a", "half_b"), straight):
            columns[name] = columns[name] + np.nan_to_num(found)
        counts["paths"]["paths"] += len(point) * each
        return columns, counts
