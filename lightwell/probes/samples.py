"""Radiance samples between the probes: where they lie, and how many paths each is worth.

All get the same number of paths first. Cells where the two halves of them differ much get up to ``MOST`` times more: a
room that is lit through a doorway is dark and noisy, and what is noisy is dark to a solve that counts ratios. Cells
decide by themselves, by the mean over their samples: by its own noise alone a sample that is too dark by chance would
pass for a quiet one; and an edit traces a cell as a whole bake does. Notation: I samples, S light states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes.bake import Geometry
from lightwell.probes.solve import Rows, relative_error
from lightwell.probes.support import touched
from lightwell.probes.trace import air_light
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable

# Radiance samples of a cell.
SAMPLES = 32
# Paths of a sample, and of a probe.
PATHS, PROBE_PATHS = 256, 1024
# A cell whose samples are noisier than this (relative error of their mean, in [0, 1]) gets more paths, at most this
# many times as many.
QUIET, MOST = 0.04, 16
# Random streams: samples of each level from a multiple of this on; more paths of a sample have other seeds.
SAMPLE_STREAM, MORE_SEED = 1 << 30, 1 << 20


@dataclass(frozen=True)
class Effort:
    """How much is traced."""

    samples: int = SAMPLES
    """Radiance samples per cell."""
    paths: int = PATHS
    """Paths per sample, even."""
    probe_paths: int = PROBE_PATHS
    """Paths per probe, even."""
    direct: bool = True
    """Whether light straight from the scene's own emitters counts; False leaves it to the renderer and its shadows."""
    most: int = MOST
    """Times ``paths`` that samples of a noisy cell may get; a power of two."""


def places(
    geometry: Geometry, effort: Effort, box: np.ndarray | None = None, first: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Valid support points [I, 3], numbers of their streams [I], cells of the lattice [I] and cells of their own level
    [I]; at most ``effort.samples`` for each cell, evenly spread, as any run of the low-discrepancy pattern is.

    box     [2, 3]: only of cells that it overlaps.
    first   Level to begin with.
    """
    found, lattice = [], geometry.volume.lattice
    for k, level in list(enumerate(geometry.levels))[first:]:
        support = level.support
        cells = support.covered if box is None else touched(support.lattice, box)[0]
        cells = cells[support.slot[cells] >= 0]
        valid = support.valid[support.slot[cells]]
        count = effort.samples if k == 0 else max(2, effort.samples // 8)
        row, point = np.nonzero(valid & (np.cumsum(valid, axis=1) <= count))
        place = support.points(cells)[row, point]
        number = SAMPLE_STREAM * (k + 1) + cells[row] * valid.shape[1] + point
        found.append((place, number, lattice.cell_number(lattice.locate(place)[0]), cells[row] + (k << 40)))
    return tuple(np.concatenate(part) for part in zip(*found))


def rows(
    scene: Scene,
    geometry: Geometry,
    effort: Effort,
    seed: int,
    variable: Variable | None = None,
    lights: np.ndarray | None = None,
    box: np.ndarray | None = None,
    first: int = 0,
) -> tuple[Rows, np.ndarray]:
    """Radiance samples, for the scene's own light or for each of ``lights`` [S, 3], and their numbers [I]."""
    at, number, cell, own = places(geometry, effort, box, first)
    halves = _halves(scene, at, number, effort.paths, seed, effort.direct, variable, lights)
    times = _times(_noise(halves), own, effort.most)
    for k in np.unique(times[times > 1]):
        asked = np.flatnonzero(times == k)
        paths = effort.paths * int(k - 1)
        more = _halves(scene, at[asked], number[asked], paths, seed + MORE_SEED, effort.direct, variable, lights)
        halves[..., asked, :, :] = (halves[..., asked, :, :] + (k - 1) * more) / k
    light = halves.mean(axis=0).astype(np.float32)
    return Rows(at, np.zeros_like(at), light[0] if variable is None else light, cell, _noise(halves)), number


def joined(a: Rows, b: Rows) -> Rows:
    """Samples of one set, then of another."""
    join = lambda name: np.concatenate([getattr(a, name), getattr(b, name)])  # noqa: E731
    light = np.concatenate([a.light, b.light], axis=-3)
    return Rows(join("place"), join("normal"), light, join("cell"), join("noise"))


def _halves(scene, at, number, paths, seed, direct, variable, lights) -> np.ndarray:
    """[2, S, I, 9, 3] float64 harmonics by each half of the paths."""
    if variable is None:
        found = [air_light(scene, at, paths, seed, numbers=number, direct=direct)]
    else:
        found = [
            air_light(scene, at, paths, seed + k, variable=variable, light=light, numbers=number)
            for k, light in enumerate(lights)
        ]
    return np.stack([[f.half_a for f in found], [f.half_b for f in found]]).astype(np.float64)


def _noise(halves: np.ndarray) -> np.ndarray:
    """[I] relative error that the noise of the samples' mean over all states makes."""
    return 0.5 * relative_error(*halves.mean(axis=1))


def _times(noise: np.ndarray, cell: np.ndarray, most: int) -> np.ndarray:
    """[I] powers of two: how many times the paths each sample needs for its cell to be quiet."""
    _, index = np.unique(cell, return_inverse=True)
    mean = np.bincount(index, noise) / np.maximum(np.bincount(index), 1)
    asked = np.ceil(2 * np.log2(np.maximum(mean / QUIET, 1e-9)))
    return (2 ** np.clip(asked, 0, np.log2(most))).astype(np.int64)[index]
