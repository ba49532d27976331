"""The light of a volume: path tracing at probes and between them, and the solve with the run-time weights.

Notation: P nodes of the lattice, F fine probes, I samples, S states of a declared light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes.bake import Geometry, rebake, with_bricks
from lightwell.probes.bricks import BUDGET, worst
from lightwell.probes.samples import SAMPLE_STREAM, ProbeSampling, joined, rows
from lightwell.probes.sheets import changed_nodes
from lightwell.probes.solve import Solution, SolveRows, solve
from lightwell.probes.state_light import light_of_states, points_at_once
from lightwell.probes.states import Lights
from lightwell.probes.support import touched
from lightwell.probes.volume import ProbeVolume, coefficients
from lightwell.probes.weights import Fit
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable

# First random stream of the fine probes.
FINE_STREAM = 1 << 28


@dataclass(frozen=True)
class SolvedVolume:
    """A volume with its light and the data of its solve, which incremental bakes need."""

    geometry: Geometry
    """Volume without light, and what its weights were computed from."""
    start: np.ndarray
    """[P + F, 9, 3] traced light at the probes; [S, P + F, 9, 3] for S states of a declared light."""
    samples: SolveRows
    """Radiance samples of the solve."""
    number: np.ndarray
    """[I] random streams of the samples, which encode cell and support point."""
    solution: Solution
    """Result of the solve."""
    sampling: ProbeSampling
    """Numbers of samples and paths."""
    seed: int
    """Seed of the paths."""
    lights: Lights = None
    """[S, 3] positions (or directions) of the declared light, or states of the scene's own; None: as it is."""

    @property
    def volume(self) -> ProbeVolume:
        """The volume under the scene's own light."""
        return self.geometry.volume.lit(self.solution.light)


def origins(geometry: Geometry) -> tuple[np.ndarray, np.ndarray]:
    """Return the points from which all probes are traced.

    Args:
        geometry: The weights.

    Returns:
        [P + F, 3] positions in metres, and [P + F] numbers of their random streams.
    """
    place = [level.support.origin[level.nodes] for level in geometry.levels]
    return np.concatenate(place), np.concatenate(
        [level.nodes + k * FINE_STREAM for k, level in enumerate(geometry.levels)]
    )


def traced(
    scene: Scene,
    geometry: Geometry,
    probes: np.ndarray,
    sampling: ProbeSampling,
    seed: int,
    variable: Variable | None = None,
    lights: Lights = None,
) -> np.ndarray:
    """Trace the light at some probes.

    Args:
        scene: The scene.
        geometry: The weights.
        probes: [B] indices of probes in the volume.
        sampling: Number of paths.
        seed: Seed of the paths.
        variable: Declared light of 1 cd (1 lx), of which only the indirect light is traced; None for the scene's own
            emitters.
        lights: [S, 3] positions (or directions) of the declared light, or states of the scene's own; None: as it is.

    Returns:
        [P + F, 9, 3] irradiance harmonics, or [S, P + F, 9, 3] of S states; 0 for other probes and for those without a
        point in air.
    """
    place, number = origins(geometry)
    alive = np.concatenate([level.support.alive[level.nodes] for level in geometry.levels])
    out = np.zeros((1 if lights is None else len(lights), len(place), 9, 3), np.float32)
    probes = probes[alive[probes]]
    for start in range(0, len(probes), size := points_at_once(lights)):
        part = probes[start : start + size]
        more = (number[part], sampling.direct, variable, lights)
        out[:, part] = light_of_states(scene, place[part], sampling.probe_paths, seed, *more).mean(axis=0)
    return out[0] if lights is None else out


def light_volume(
    scene: Scene,
    geometry: Geometry,
    sampling: ProbeSampling,
    seed: int,
    variable: Variable | None = None,
    lights: Lights = None,
    coarse: SolvedVolume | None = None,
) -> SolvedVolume:
    """Compute the light of a volume for the scene's own emitters, or for each state of a declared light.

    Args:
        scene: The scene.
        geometry: The weights.
        sampling: Numbers of samples and paths.
        seed: Seed of the paths.
        variable: Declared light; None for the scene's own emitters.
        lights: [S, 3] positions (or directions) of the declared light, or states of the scene's own; None: as it is.
        coarse: Light of the same volume without bricks; what was traced for it is reused.

    Returns:
        The volume with its light.
    """
    probes, first = np.flatnonzero(geometry.volume.alive), 0
    if coarse is not None:
        probes, first = probes[probes >= len(geometry.volume.lattice)], 1
    start = traced(scene, geometry, probes, sampling, seed, variable, lights)
    samples, number = rows(scene, geometry, sampling, _sample_seed(seed, lights), variable, lights, first=first)
    if coarse is not None:
        start[..., : len(geometry.volume.lattice), :, :] = coarse.start
        samples, number = joined(coarse.samples, samples), np.concatenate([coarse.number, number])
    solution = solve(geometry.volume, samples, start)
    return SolvedVolume(geometry, start, samples, number, solution, sampling, seed, lights)


def _sample_seed(seed: int, lights: Lights) -> int:
    """Seed of the samples, different from those of the probes."""
    return seed + (1 if lights is None else len(lights))


def refined(
    scene: Scene, lit: SolvedVolume, budget: float = BUDGET, fit: Fit | None = None, variable: Variable | None = None
) -> SolvedVolume:
    """Add bricks where the error is highest, and compute the light again.

    Args:
        scene: The scene.
        lit: Volume without bricks, with its light.
        budget: Largest number of fine probes per probe that looks from near its node.
        fit: Replaces the weight function's own fit; None for its own.
        variable: Declared light of ``lit``; None for the scene's own emitters.

    Returns:
        The volume with bricks; the same object when no cell needs one.
    """
    chosen = placed(lit.geometry, lit.samples, lit.solution, budget)
    if not len(chosen):
        return lit
    geometry = with_bricks(scene, lit.geometry, chosen, fit)
    return light_volume(scene, geometry, lit.sampling, lit.seed, variable, lit.lights, coarse=lit)


def placed(geometry: Geometry, samples: SolveRows, solution: Solution, budget: float = BUDGET) -> np.ndarray:
    """Choose the cells that get a brick.

    Args:
        geometry: The weights.
        samples: Samples of the solve.
        solution: Result of the solve.
        budget: Largest number of fine probes per probe that looks from near its node.

    Returns:
        [B] sorted indices of cells.
    """
    error = np.maximum(solution.residual - samples.noise, 0)
    mean = samples.light if samples.light.ndim == 3 else samples.light.mean(axis=0)
    return worst(error, mean[:, 0].mean(axis=1), samples.cell, int(geometry.support.stands.sum()), budget)


def relit(
    scene: Scene, before: SolvedVolume, box: np.ndarray, fit: Fit | None = None, variable: Variable | None = None
) -> tuple[SolvedVolume, np.ndarray]:
    """Compute the volume again after the scene has changed inside a box.

    Light is traced again only in touched cells and at touched probes. Probes for which nothing has changed are held
    fixed, so that an unchanged scene gives the same bytes.

    Args:
        scene: The scene after the change.
        before: The bake before the change.
        box: [2, 3] least and greatest corner, metres.
        fit: Replaces the weight function's own fit; None for its own.
        variable: Declared light of ``before``; None for the scene's own emitters.

    Returns:
        The new bake, and the indices of the probes whose light was solved again.
    """
    geometry, again = rebake(scene, before.geometry, box, fit)
    start, lights = before.start.copy(), before.lights
    traced_now = traced(scene, geometry, again, before.sampling, before.seed, variable, lights)
    start[..., again, :, :] = traced_now[..., again, :, :]
    fresh, number = rows(scene, geometry, before.sampling, _sample_seed(before.seed, lights), variable, lights, box)
    samples, numbers = _merged(before, fresh, number, box)
    old, new = before.geometry.volume, geometry.volume
    free = np.zeros(len(new.state), bool)
    free[again] = ~_same_weights(old, new, again) | _differs(start, before.start, again, again)
    free |= _cut_anew(before.geometry, geometry)
    ask = _changed_rows(before, samples, numbers)
    free[coefficients(new, samples.place[ask], samples.normal[ask])[0].ravel()] = len(ask) > 0
    free &= new.alive
    if not free.any():
        solution = before.solution
    else:
        part = _near(new, samples, free)
        found = solve(new, samples.part(part), start, free=free, held=before.solution.light)
        residual, orphans = np.zeros(len(samples.place)), np.zeros(len(samples.place), bool)
        residual[part], orphans[part] = found.residual, found.orphans
        solution = Solution(found.light, orphans, found.errors, residual)
    made = SolvedVolume(geometry, start, samples, numbers, solution, before.sampling, before.seed, lights)
    return made, np.flatnonzero(free)


def _differs(a: np.ndarray, b: np.ndarray, rows_a: np.ndarray, rows_b: np.ndarray) -> np.ndarray:
    """[N] bool: whether rows of light [(S,) P, 9, 3] differ in any state."""
    other = (a[..., rows_a, :, :] != b[..., rows_b, :, :]).any(axis=(-1, -2))
    return other if other.ndim == 1 else other.any(axis=0)


def _merged(
    before: SolvedVolume, fresh: SolveRows, number: np.ndarray, box: np.ndarray
) -> tuple[SolveRows, np.ndarray]:
    """Samples with those of touched cells replaced, in the order of a whole bake (by stream)."""
    inside = np.zeros(len(before.number), bool)
    for k, level in enumerate(before.geometry.levels):
        size = level.support.valid.shape[1]
        mine = before.number // SAMPLE_STREAM == k + 1
        inside |= mine & np.isin(
            (before.number - SAMPLE_STREAM * (k + 1)) // size, touched(level.support.lattice, box)[0]
        )
    kept = before.samples.part(~inside)
    numbers = np.concatenate([before.number[~inside], number])
    order = np.argsort(numbers, kind="stable")
    return joined(kept, fresh).part(order), numbers[order]


def _changed_rows(before: SolvedVolume, samples: SolveRows, numbers: np.ndarray) -> np.ndarray:
    """Indices of samples that are new or whose light has changed."""
    at = np.minimum(np.searchsorted(before.number, numbers), len(before.number) - 1)
    moved = _differs(before.samples.light, samples.light, at, np.arange(len(numbers)))
    return np.flatnonzero((before.number[at] != numbers) | moved)


def _same_weights(old: ProbeVolume, new: ProbeVolume, probes: np.ndarray) -> np.ndarray:
    """[len(probes)] bool: neither the state of a probe nor its record has changed."""
    same = old.state[probes] == new.state[probes]
    a, b = old.row[probes], new.row[probes]
    both = np.flatnonzero((a >= 0) & (b >= 0))
    same[both] &= (old.params[a[both]] == new.params[b[both]]).all(axis=1) & (
        old.octant[a[both]] == new.octant[b[both]]
    )
    return same


def _cut_anew(old: Geometry, new: Geometry) -> np.ndarray:
    """[P + F] bool: probes in cells whose sheets have changed."""
    pairs = [(a, b.sheets) for a, b in zip(old.levels, new.levels)]
    return np.concatenate([np.isin(a.nodes, changed_nodes(a.support.lattice, a.sheets, b)) for a, b in pairs])


def _near(volume: ProbeVolume, samples: SolveRows, free: np.ndarray) -> np.ndarray:
    """Indices of samples in cells that use a free probe."""
    lattice, count = volume.lattice, len(volume.lattice)
    nodes = np.flatnonzero(free[:count])
    cells = set(lattice.node_cells(nodes).ravel().tolist())
    if volume.bricks is not None:
        asked = free[volume.bricks.table].any(axis=1)
        cells |= set(np.flatnonzero((volume.bricks.cell >= 0) & asked[np.maximum(volume.bricks.cell, 0)]).tolist())
    return np.flatnonzero(np.isin(samples.cell, list(cells)))
