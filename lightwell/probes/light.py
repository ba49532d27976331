"""The light of a volume: what is path traced, at probes and between them, and the solve through the weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes.solve import Rows, Solution, solve
from lightwell.probes.support import Support
from lightwell.probes.trace import air_light
from lightwell.probes.volume import ProbeVolume
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable

# Radiance samples of a cell.
SAMPLES = 32
# Paths of a sample, and of a probe.
PATHS, PROBE_PATHS = 256, 1024


@dataclass(frozen=True)
class Effort:
    """How much is traced."""

    samples: int = SAMPLES
    """Radiance samples per cell."""
    paths: int = PATHS
    """Paths per sample, even."""
    probe_paths: int = PROBE_PATHS
    """Paths per probe, even."""


def traced(
    scene: Scene, support: Support, nodes: np.ndarray, effort: Effort, seed: int, variable=None, light=None
) -> np.ndarray:
    """[P, 9, 3] light where the probes of ``nodes`` look from; 0 elsewhere."""
    out = np.zeros((len(support.lattice), 9, 3), np.float32)
    nodes = nodes[support.alive[nodes]]
    if len(nodes):
        found = air_light(scene, support.origin[nodes], effort.probe_paths, seed, variable=variable, light=light)
        out[nodes] = found.sh
    return out


def places(support: Support, cells: np.ndarray, effort: Effort) -> np.ndarray:
    """[I, 3] valid support points of some cells, at most ``effort.samples`` each, evenly spread: any run of the
    low-discrepancy pattern is even."""
    count = min(effort.samples, support.valid.shape[1])
    order = np.cumsum(support.valid[cells], axis=1)
    chosen = support.valid[cells] & (order <= count)
    return support.points(cells)[chosen]


def rows(
    scene: Scene,
    volume: ProbeVolume,
    support: Support,
    cells: np.ndarray,
    effort: Effort,
    seed: int,
    variable: Variable | None = None,
    lights: np.ndarray | None = None,
) -> Rows:
    """Radiance samples of some cells, for the scene's own light or for each of ``lights`` [S, 3]."""
    at = places(support, cells, effort)
    zero = np.zeros_like(at)
    if variable is None:
        return Rows(at, zero, air_light(scene, at, effort.paths, seed).sh)
    states = [
        air_light(scene, at, effort.paths, seed + k, variable=variable, light=light).sh
        for k, light in enumerate(lights)
    ]
    return Rows(at, zero, np.stack(states))


def light_volume(
    scene: Scene, volume: ProbeVolume, support: Support, effort: Effort, seed: int
) -> tuple[ProbeVolume, Solution, np.ndarray]:
    """The volume under the scene's own light, the solution, and the light traced at the probes [P, 9, 3]."""
    cells = np.flatnonzero(support.valid.any(axis=1))
    start = traced(scene, support, np.flatnonzero(volume.alive), effort, seed)
    samples = rows(scene, volume, support, cells, effort, seed + 1)
    solution = solve(volume, samples, start)
    return volume.lit(solution.light), solution, start
