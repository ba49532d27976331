"""Radiance samples between the probes: their points, and the number of paths of each.

All samples get the same number of paths first. Samples of cells where the two halves of the paths differ much get
up to ``MOST`` times as many: a room lit through a doorway is dark and noisy, and a solve of relative errors answers
noise with darkness. The decision is made per cell, from the mean over its samples: judged by itself, a sample that
is too dark by chance would look like one without noise. An edit therefore traces a cell in the same way as a whole
bake. Notation: I samples, S light states.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.probes.bake import Geometry
from lightwell.probes.solve import SolveRows, relative_error
from lightwell.probes.state_light import AT_ONCE, light_of_states, points_at_once
from lightwell.probes.states import Lights
from lightwell.probes.support import touched
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable

# Radiance samples of a cell.
SAMPLES = 32
# Paths of a sample, and of a probe.
PATHS, PROBE_PATHS = 256, 1024
# A cell whose samples are noisier than QUIET (relative error of their mean, in [0, 1]) gets more paths, at most MOST
# times as many.
QUIET, MOST = 0.04, 16
# Random streams of each level start at a multiple of the first; further paths of a sample use a seed plus the second.
SAMPLE_STREAM, MORE_SEED = 1 << 30, 1 << 20


@dataclass(frozen=True)
class ProbeSampling:
    """Numbers of samples and paths."""

    samples: int = SAMPLES
    """Radiance samples per cell."""
    paths: int = PATHS
    """Paths per sample, even."""
    probe_paths: int = PROBE_PATHS
    """Paths per probe, even."""
    direct: bool = True
    """Include direct light of the scene's own emitters; False leaves it to the renderer's lights and shadows."""
    most: int = MOST
    """Largest multiple of ``paths`` for samples of noisy cells; a power of two."""


def places(
    geometry: Geometry, sampling: ProbeSampling, box: np.ndarray | None = None, first: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Choose the points of the radiance samples: valid support points, at most ``sampling.samples`` per cell.

    They are evenly distributed, as every run of the low-discrepancy pattern is.

    Args:
        geometry: The weights.
        sampling: Number of samples per cell.
        box: [2, 3] box; only cells that overlap it get samples. None for all cells.
        first: First level that gets samples; 1 leaves out the coarse lattice.

    Returns:
        [I, 3] points in metres, [I] numbers of their random streams, [I] cells of the coarse lattice, and [I] cells of
        their own level.
    """
    found, lattice = [], geometry.volume.lattice
    for k, level in list(enumerate(geometry.levels))[first:]:
        support = level.support
        cells = support.covered if box is None else touched(support.lattice, box)[0]
        cells = cells[support.slot[cells] >= 0]
        valid = support.valid[support.slot[cells]]
        count = sampling.samples if k == 0 else max(2, sampling.samples // 8)
        row, point = np.nonzero(valid & (np.cumsum(valid, axis=1) <= count))
        place = support.points(cells)[row, point]
        number = SAMPLE_STREAM * (k + 1) + cells[row] * valid.shape[1] + point
        found.append((place, number, lattice.cell_number(lattice.locate(place)[0]), cells[row] + (k << 40)))
    a, b, c, d = (np.concatenate(part) for part in zip(*found))
    return a, b, c, d


def rows(
    scene: Scene,
    geometry: Geometry,
    sampling: ProbeSampling,
    seed: int,
    variable: Variable | None = None,
    lights: Lights = None,
    box: np.ndarray | None = None,
    first: int = 0,
) -> tuple[SolveRows, np.ndarray]:
    """Path trace radiance samples.

    Args:
        scene: The scene.
        geometry: The weights.
        sampling: Numbers of samples and paths.
        seed: Seed of the paths.
        variable: Declared light; None for the scene's own emitters.
        lights: [S, 3] positions (or directions) of the declared light, or states of the scene's own; None: as it is.
        box: [2, 3] box; only cells that overlap it get samples. None for all cells.
        first: First level that gets samples.

    Returns:
        The samples, and [I] numbers of their random streams.
    """
    at, number, cell, own = places(geometry, sampling, box, first)
    light, noise = sample_light(scene, at, number, own, sampling, seed, variable, lights)
    return SolveRows(at, np.zeros_like(at), light, cell, noise), number


def sample_light(
    scene: Scene,
    at: np.ndarray,
    number: np.ndarray,
    own: np.ndarray,
    sampling: ProbeSampling,
    seed: int,
    variable: Variable | None = None,
    lights: Lights = None,
    *,
    at_once: int = AT_ONCE,
) -> tuple[np.ndarray, np.ndarray]:
    """Path trace the light at points in air, with more paths in noisy cells.

    Args:
        scene: The scene.
        at: [I, 3] points, metres.
        number: [I] numbers of their random streams.
        own: [I] cell of each point, for which the number of paths is chosen.
        sampling: Numbers of paths.
        seed: Seed of the paths.
        variable: Declared light; None for the scene's own emitters.
        lights: [S, 3] positions (or directions) of the declared light, or states of the scene's own; None: as it is.
        at_once: Bytes of light that are traced at a time, about; bounds memory, and changes nothing else.

    Returns:
        [I, 9, 3] float32 irradiance harmonics, or [S, I, 9, 3] of S states, and [I] relative error that noise causes.
    """
    light = np.empty((1 if lights is None else len(lights), len(at), 9, 3), np.float32)
    noise = np.empty(len(at))
    more: dict[str, Any] = {"direct": sampling.direct, "variable": variable, "lights": lights}

    def traced(rows: np.ndarray, paths: int, seed: int) -> np.ndarray:
        return light_of_states(scene, at[rows], paths, seed, number[rows], **more)

    for rows in _whole_cells(own, points_at_once(lights, at_once)):
        light[:, rows], noise[rows] = _some(traced, rows, own[rows], sampling, seed)
    return light[0] if lights is None else light, noise


def _whole_cells(own: np.ndarray, most: int) -> list[np.ndarray]:
    """Indices of the points of some cells each, at most so many unless a cell has more.

    All points of a cell decide how many paths they get.
    """
    if len(own) <= most:
        return [np.arange(len(own))]
    order = np.argsort(own, kind="stable")
    last = np.append(np.flatnonzero(np.diff(own[order])), len(own) - 1)
    parts, first = [], 0
    while first < len(own):
        fits = last[(last >= first) & (last < first + most)]
        end = int(fits[-1] if len(fits) else last[np.searchsorted(last, first)]) + 1
        parts.append(np.sort(order[first:end]))
        first = end
    return parts


def _some(
    traced: Callable[[np.ndarray, int, int], np.ndarray],
    rows: np.ndarray,
    own: np.ndarray,
    sampling: ProbeSampling,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """[S, I, 9, 3] light at the points of whole cells, and [I] noise.

    ``traced``: (points, paths, seed) -> [2, S, I, 9, 3] harmonics from each half of the paths.
    """
    halves = traced(rows, sampling.paths, seed)
    times = path_factors(_noise(halves), own, sampling.most)
    for k in np.unique(times[times > 1]):
        asked = np.flatnonzero(times == k)
        more = traced(rows[asked], sampling.paths * int(k - 1), seed + MORE_SEED)
        halves[..., asked, :, :] = (halves[..., asked, :, :] + (k - 1) * more) / k
    return halves.mean(axis=0).astype(np.float32), _noise(halves)


def joined(a: SolveRows, b: SolveRows) -> SolveRows:
    """Concatenate two sets of samples.

    Args:
        a: First samples.
        b: Samples that follow.

    Returns:
        All samples.
    """
    join = lambda name: np.concatenate([getattr(a, name), getattr(b, name)])  # noqa: E731
    light = np.concatenate([a.light, b.light], axis=-3)
    return SolveRows(join("place"), join("normal"), light, join("cell"), join("noise"))


def _noise(halves: np.ndarray) -> np.ndarray:
    """[I] relative error that noise causes in the samples' mean over all states."""
    return 0.5 * relative_error(*halves.mean(axis=1))


def path_factors(noise: np.ndarray, cell: np.ndarray, most: int) -> np.ndarray:
    """Choose how many times more paths bring the noise of each sample's cell below ``QUIET``.

    Args:
        noise: [I] relative noise of each sample.
        cell: [I] cell of each sample.
        most: Largest factor, a power of two.

    Returns:
        [I] factors, powers of two.
    """
    _, index = np.unique(cell, return_inverse=True)
    mean = np.bincount(index, noise) / np.maximum(np.bincount(index), 1)
    asked = np.ceil(2 * np.log2(np.maximum(mean / QUIET, 1e-9)))
    return (2 ** np.clip(asked, 0, np.log2(most))).astype(np.int64)[index]
