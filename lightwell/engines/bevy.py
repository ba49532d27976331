"""Files for Bevy: an irradiance volume and a light map as KTX 2.0, and a module that spawns them."""

from __future__ import annotations

import numpy as np

from lightwell.engines.bake import Bake, expect_light
from lightwell.engines.ktx2 import encode_rgba16f
from lightwell.engines.probe_grid import ProbeGrid
from lightwell.engines.text import quoted, render
from lightwell.engines.web import grid_values
from lightwell.limits import Limits


def files(bake: Bake, limits: Limits | None) -> dict[str, bytes]:
    """Make the files of Bevy; a bake without light map and probes is a ``ValueError``.

    Args:
        bake: The bake.
        limits: Not needed: nothing is read here.

    Returns:
        Content by name: to be put into ``assets/lightwell/``, the module into ``src/``.
    """
    expect_light(bake)
    made = {}
    if bake.light_map is not None:
        made["light_map.ktx2"] = encode_rgba16f(np.pad(bake.light_map, ((0, 0), (0, 0), (0, 1)), constant_values=1))
    if bake.probes is not None:
        made["irradiance.ktx2"] = encode_rgba16f(ambient_cubes(bake.probes))
    values = None if bake.probes is None else grid_values(bake.probes)
    lit = ", ".join(map(quoted, bake.lit))
    text = render("bevy.rs", lit=lit, count=len(bake.lit), grid=values, map=bake.light_map is not None)
    return made | {"lightwell.rs": text.encode()}


def ambient_cubes(grid: ProbeGrid) -> np.ndarray:
    """Evaluate the light of every probe from the six sides.

    Args:
        grid: The probes.

    Returns:
        [3 nz, 2 ny, nx, 4] irradiance / π: the sides x, y, z one behind the other; of each, light of normals along the
        axis in the first ny rows and of normals against it in the others, as ``irradiance_volume_light`` of bevy_pbr
        reads them (``neg_offset``; the table in the documentation of its module has them the other way round).
    """
    nx, ny, nz = grid.lattice.shape
    out = np.ones((3 * nz, 2 * ny, nx, 4))
    for axis in range(3):
        for positive in (0, 1):
            side = np.zeros(3)
            side[axis] = 1 if positive else -1
            light = grid.along(side.tolist()).reshape(nz, ny, nx, 3) / np.pi
            row = 0 if positive else ny
            out[axis * nz : (axis + 1) * nz, row : row + ny, :, :3] = light
    return out
