"""Radiance samples of a feature volume: support points of its own cells, traced as the samples of probes are."""

from __future__ import annotations

import numpy as np

from lightwell.probes.samples import ProbeSampling, sample_light
from lightwell.probes.solve import SolveRows
from lightwell.probes.states import Lights
from lightwell.probes.support import Support
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable

# Cells of the grid along an edge of a block, for which the number of samples and of paths is chosen.
BLOCK = 2


def volume_rows(
    scene: Scene,
    support: Support,
    sampling: ProbeSampling,
    seed: int,
    variable: Variable | None = None,
    lights: Lights = None,
) -> SolveRows:
    """Path trace samples in air: as many in a block of eight cells as probes have in a cell.

    Args:
        scene: The scene.
        support: Points in air of the grid's lattice; all cells are covered.
        sampling: Numbers of samples and paths.
        seed: Seed of the paths.
        variable: Declared light; None for the scene's own emitters.
        lights: [S, 3] positions (or directions) of the declared light, or states of the scene's own; None: as it is.

    Returns:
        The samples.
    """
    lattice = support.lattice
    count = max(1, round(sampling.samples / BLOCK**3))
    cell, point = np.nonzero(support.valid & (np.cumsum(support.valid, axis=1) <= count))
    place = support.points(np.arange(lattice.cell_count))[cell, point]
    number = cell * support.valid.shape[1] + point
    block = lattice.cell_corner(cell) // BLOCK @ np.array([1, 1 << 20, 1 << 40])
    light, noise = sample_light(scene, place, number, block, sampling, seed, variable, lights)
    return SolveRows(place, np.zeros_like(place), light, cell, noise)
