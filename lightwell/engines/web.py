"""Files for engines of the browser: three.js, Babylon.js and PlayCanvas."""

from __future__ import annotations

import numpy as np

from lightwell.engines.bake import Bake, expect_light
from lightwell.engines.probe_grid import ProbeGrid
from lightwell.engines.text import numbers, quoted, render
from lightwell.limits import Limits

# Volumes of four numbers that hold nine harmonics of three colours, in three.js' LightProbeGrid.
VOLUMES = 7
# Largest half float.
LARGEST = 65504.0


def halves(values: np.ndarray) -> bytes:
    """Write numbers as half floats.

    Args:
        values: [...] numbers; those beyond ±65504 are clamped.

    Returns:
        Little-endian half floats.
    """
    return np.clip(values, -LARGEST, LARGEST).astype("<f2").tobytes()


def three_files(bake: Bake, limits: Limits | None) -> dict[str, bytes]:
    """Make the files of three.js; a bake without light map and probes is a ``ValueError``.

    Args:
        bake: The bake.
        limits: Not needed: nothing is read here.

    Returns:
        Content by name.
    """
    grid = bake.probes
    made = _light_map(bake, "three.js", grid=None if grid is None else grid_values(grid))
    if grid is not None:
        made["probes.bin"] = halves(probe_atlas(grid))
    return made


def babylon_files(bake: Bake, limits: Limits | None) -> dict[str, bytes]:
    """Make the files of Babylon.js; a bake without light map is a ``ValueError``.

    Args:
        bake: The bake.
        limits: Not needed: nothing is read here.

    Returns:
        Content by name.
    """
    expect_light(bake, needs_map=True)
    return _light_map(bake, "babylon.js")


def playcanvas_files(bake: Bake, limits: Limits | None) -> dict[str, bytes]:
    """Make the files of PlayCanvas; a bake without light map is a ``ValueError``.

    Args:
        bake: The bake.
        limits: Not needed: nothing is read here.

    Returns:
        Content by name.
    """
    expect_light(bake, needs_map=True)
    return _light_map(bake, "playcanvas.js")


def _light_map(bake: Bake, template: str, **values: object) -> dict[str, bytes]:
    """The module of an engine, and the light map as half floats, four a texel."""
    expect_light(bake)
    image = np.zeros((1, 1, 3)) if bake.light_map is None else bake.light_map
    height, width = image.shape[:2]
    lit = ", ".join(map(quoted, bake.lit))
    text = render(template, lit=lit, width=width, height=height, **values)
    alpha = np.ones((height, width, 1))
    return {"lightwell.js": text.encode(), "light_map.bin": halves(np.concatenate([image, alpha], axis=2))}


def grid_values(grid: ProbeGrid) -> dict[str, str]:
    """Describe the box of a grid that has a probe in the middle of each of its cells.

    Args:
        grid: The probes.

    Returns:
        ``shape``, ``size`` and ``center`` as texts of three numbers.
    """
    shape = np.array(grid.lattice.shape)
    size = shape * grid.lattice.spacing
    center = grid.lattice.origin + 0.5 * (shape - 1) * grid.lattice.spacing
    return {"shape": numbers(shape), "size": numbers(size), "center": numbers(center)}


def probe_atlas(grid: ProbeGrid) -> np.ndarray:
    """Pack probes as three.js' LightProbeGrid does.

    Args:
        grid: The probes.

    Returns:
        [7 (nz + 2), ny, nx, 4] numbers: the 27 coefficients four by four, each volume between copies of its outer
            slices.
    """
    nx, ny, nz = grid.lattice.shape
    flat = np.zeros((nx * ny * nz, 4 * VOLUMES))
    flat[:, :27] = grid.radiance.reshape(-1, 27)
    volumes = flat.reshape(nz, ny, nx, VOLUMES, 4).transpose(3, 0, 1, 2, 4)
    padded = np.concatenate([volumes[:, :1], volumes, volumes[:, -1:]], axis=1)
    return padded.reshape(-1, ny, nx, 4)
