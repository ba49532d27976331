"""Adaptive sampling: new samples where the residual of a fit is large (specification 2.4).

A field is fitted, its squared relative residual is measured on fresh samples, and the next round takes half of its
samples area-uniformly and half with the density

    p(x, l) ∝ sqrt(r(cell of x, cell of l)),   r = mean of (f - a)(f - b) / (f² + ε²)

f the prediction, a and b the two half means of a sample: (f - a)(f - b) is the squared residual minus the variance of
the Monte Carlo mean, so noise alone draws no samples. Cells are (object, cube of space) and cubes of light positions;
the mean of a cell is averaged with that of its object, so that a cell with few samples is close to its object.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.point_rejection import room
from lightwell.transport.queries import frames
from lightwell.transport.samples import Query, Samples, SurfacePoints
from lightwell.transport.surface import SurfaceDraw, draw_surface

Predict = Callable[[Query], np.ndarray]
"""Outgoing indirect radiance [N, 3] of a fitted field, reflectance included: what ``Samples.radiance`` holds."""

# Cubes along the scene's longest edge, and along each axis of the light's box.
SPACE_CELLS, LIGHT_CELLS = 24, 4
# A cell's residual is averaged with that of its object (or of the scene), counted as this many samples.
PRIOR_SAMPLES = 4.0
# ε of the relative residual, as a share of the mean radiance (ε₂ = 0.05 in units of four means; specification 3.1).
EPSILON = 0.2
# Share of new samples that stay area-uniform.
UNIFORM_SHARE = 0.5
TINY = 1e-12
# Surface points offered per new sample, and lights offered in all.
POOL, LIGHT_POOL = 2, 4096


@dataclass(frozen=True)
class ResidualDensity:
    """Root mean square relative residual by cell; call it to look values up."""

    origin: np.ndarray
    """[3] corner of the first cube of space."""
    size: float
    """Edge of a cube of space, metres."""
    light_low: np.ndarray
    """[3] corner of the first light cell."""
    light_size: np.ndarray
    """[3] edges of a light cell."""
    space_keys: np.ndarray
    """Sorted keys of the S (object, cube) cells that have samples."""
    roots: np.ndarray
    """[S + M, LIGHT_CELLS³] √r by light cell: of these cells, then of the M objects as wholes."""

    def __call__(self, position: np.ndarray, shape: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Look up the density at surface points with their lights.

        Args:
            position: [N, 3] points, metres.
            shape: [N] indices of their meshes.
            light: [N, 3] positions of the light, metres (directions of a sun).

        Returns:
            [N] √r.
        """
        return self.roots[self.rows(position, shape), self.light_cell(light)]

    def rows(self, position: np.ndarray, shape: np.ndarray) -> np.ndarray:
        """Find the rows of ``roots`` at surface points.

        Args:
            position: [N, 3] points, metres.
            shape: [N] indices of their meshes.

        Returns:
            [N] rows: of an object as a whole where a cell has no samples.
        """
        key, cells = space_key(position, shape, self.origin, self.size), len(self.space_keys)
        row = np.searchsorted(self.space_keys, key)
        known = self.space_keys[np.minimum(row, cells - 1)] == key
        return np.where(known, row, cells + shape.astype(np.int64))

    def light_cell(self, light: np.ndarray) -> np.ndarray:
        """Find the light cell of each light.

        Args:
            light: [N, 3] positions of the light, metres (directions of a sun).

        Returns:
            [N] indices in [0, LIGHT_CELLS³).
        """
        cell = np.clip(((light - self.light_low) / self.light_size).astype(int), 0, LIGHT_CELLS - 1)
        return (cell[:, 0] * LIGHT_CELLS + cell[:, 1]) * LIGHT_CELLS + cell[:, 2]


def space_key(position: np.ndarray, shape: np.ndarray, origin: np.ndarray, size: float) -> np.ndarray:
    """Compute a number that names the (object, cube of space) cell of each point.

    Args:
        position: [N, 3] points, metres.
        shape: [N] indices of their meshes.
        origin: [3] corner of the first cube, metres.
        size: Edge of a cube, metres, > 0.

    Returns:
        [N] int64 keys.
    """
    side = SPACE_CELLS + 1
    cell = np.clip(((position - origin) / size).astype(np.int64), 0, SPACE_CELLS)
    return ((shape.astype(np.int64) * side + cell[:, 0]) * side + cell[:, 1]) * side + cell[:, 2]


def relative_residual(prediction: np.ndarray, samples: Samples) -> np.ndarray:
    """Compute the squared relative residual of a prediction, minus its Monte Carlo variance.

    Args:
        prediction: [N, 3] predicted radiance.
        samples: N samples with two independent half means.

    Returns:
        [N] mean over the channels; single values may be negative.
    """
    epsilon = EPSILON * float(np.average(samples.radiance.mean(axis=1), weights=samples.weight))
    f = np.asarray(prediction, np.float64)
    return ((f - samples.half_a) * (f - samples.half_b) / (f * f + epsilon * epsilon)).mean(axis=1)


def residual_density(scene: Scene, samples: Samples, prediction: np.ndarray) -> ResidualDensity:
    """Measure the density of new samples from the residual of a prediction.

    Args:
        scene: Scene of the samples.
        samples: N fresh samples.
        prediction: [N, 3] predicted radiance at them.

    Returns:
        The density, averaged by cell.
    """
    r = relative_residual(prediction, samples)
    position, light = (np.asarray(a, np.float64) for a in (samples.query.position, samples.query.light))
    origin, size = scene.bounds[0], scene.extent / SPACE_CELLS
    light_low = light.min(axis=0)
    light_size = np.maximum((light.max(axis=0) - light_low) / LIGHT_CELLS, 1e-9)
    meshes = len(scene.meshes)
    everywhere = max(float(np.average(r, weights=samples.weight)), 0.0)
    objects = _shrunk(r, samples.shape.astype(np.int64), meshes, np.full(meshes, everywhere))
    keys, space = np.unique(space_key(position, samples.shape, origin, size), return_inverse=True)
    owner = keys // (SPACE_CELLS + 1) ** 3
    spaces = _shrunk(r, space, len(keys), objects[owner])
    empty = ResidualDensity(origin, size, light_low, light_size, keys, np.zeros((0, LIGHT_CELLS**3)))
    cell = space * LIGHT_CELLS**3 + empty.light_cell(light)
    cells = _shrunk(r, cell, len(keys) * LIGHT_CELLS**3, np.repeat(spaces, LIGHT_CELLS**3))
    roots = np.concatenate([cells, np.repeat(objects, LIGHT_CELLS**3)]).reshape(-1, LIGHT_CELLS**3)
    return replace(empty, roots=np.sqrt(roots))


def _shrunk(r: np.ndarray, cell: np.ndarray, cells: int, prior: np.ndarray) -> np.ndarray:
    """Compute the mean of r per cell [cells], averaged with the prior, never negative."""
    total, count = np.bincount(cell, r, cells), np.bincount(cell, minlength=cells)
    return np.maximum((total + PRIOR_SAMPLES * prior) / (count + PRIOR_SAMPLES), 0.0)


def refine(
    scene: Scene,
    variable: Variable,
    samples: Samples,
    predict: Predict,
    count: int,
    seed: int,
    *,
    lights_fn: Callable[[int, int], np.ndarray] | None = None,
    is_open: bool | None = None,
) -> tuple[SurfacePoints, np.ndarray, np.ndarray]:
    """Choose where new samples are taken: half of them uniformly, half where a fit has a large residual.

    Pass the three results on to ``collect``; a loss with these weights estimates the same mean as uniform samples do.

    Args:
        scene: Scene to sample.
        variable: The declared light.
        samples: Fresh samples (not those of the fit), on which ``predict`` is measured.
        predict: The fitted field.
        count: Number of new samples, ≥ 1.
        seed: Seed of points, lights and choices.
        lights_fn: Takes (count, seed) and returns lights [count, 3]; None: ``sample_lights`` of the variable.
        is_open: Outdoor scene; None: measured.

    Returns:
        Points, lights [count, 3], and weights [count] (1 / relative density).
    """
    density = residual_density(scene, samples, predict(samples.query))
    point_seed, light_seed, mix_seed = (int(s) for s in np.random.SeedSequence([seed, 3]).generate_state(3))
    pool = draw_surface(scene, POOL * count, point_seed, is_open=is_open, core=not room(scene), shown=True)
    lights = np.asarray((lights_fn or _default_lights(scene, variable))(LIGHT_POOL, light_seed), np.float32)
    return mixture(scene, density, pool, lights, count, mix_seed)


def mixture(
    scene: Scene, density: ResidualDensity, pool: SurfaceDraw, lights: np.ndarray, count: int, seed: int
) -> tuple[SurfacePoints, np.ndarray, np.ndarray]:
    """Draw samples in light-major order: runs of count / len(lights) rows share a light.

    Half of the lights are taken as offered and half where the mean residual of their cell is large; for each light half
    of the points are taken as the pool offers them and half by the density.

    Args:
        scene: Scene to sample.
        density: Residual by cell.
        pool: P points to choose from.
        lights: [L, 3] lights to choose from.
        count: Number of samples, ≥ 1.
        seed: Seed of the choices.

    Returns:
        Points, lights [count, 3] float32, and weights [count] float32 (1 / density of the whole mixture).
    """
    pairs = PairChoice(density, frames(scene, pool.points)[0], pool.points.shape, pool.weight)
    point, light, weight = pairs(lights, count, seed)
    return pool.points[point], lights[light], weight


class PairChoice:
    """Chooses pairs of a point and a light as ``mixture`` does, by index; P points."""

    def __init__(self, density: ResidualDensity, position: np.ndarray, shape: np.ndarray, weight: np.ndarray) -> None:
        """Tabulate the odds of the points.

        Args:
            density: Residual by cell.
            position: [P, 3] points to choose from, metres.
            shape: [P] indices of their meshes.
            weight: [P] weights of the points.
        """
        self._density, self._weight = density, np.asarray(weight, np.float64)
        self._row = density.rows(position, shape)
        # Probability of a point: its weight compensates for the floors of the pool, so that 1 means area-uniform.
        share = self._weight / self._weight.sum()
        self._sums = np.stack([np.cumsum(np.take(root, self._row) * share) for root in density.roots.T.copy()])

    def __call__(self, lights: np.ndarray, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Choose pairs in light-major order.

        Args:
            lights: [L, 3] lights to choose from.
            count: Number of pairs, ≥ 1.
            seed: Seed of the choices.

        Returns:
            Indices of points and of lights [count], and weights [count] float32 (1 / density of the whole mixture).
        """
        rng, weight, of_cell = np.random.default_rng(seed), self._weight, self._sums[:, -1]
        cell = self._density.light_cell(lights)
        mean = of_cell[cell].mean()
        adaptive = 1 - UNIFORM_SHARE if mean > 0 else 0.0
        run = max(count // len(lights), 1)
        light = np.repeat(_choose(rng, -(-count // run), of_cell[cell], adaptive), run)[:count]
        point = _points(rng, self._sums, cell[light], adaptive)
        wanted = cell[light]
        of_light = 1 - adaptive + adaptive * of_cell[wanted] / max(mean, TINY)
        # A cell without residual has no adaptive points: they are uniform there.
        local = np.where(of_cell[wanted] > 0, adaptive, 0.0)
        by_density = local * self._density.roots[self._row[point], wanted] / np.maximum(of_cell[wanted], TINY)
        of_point = (1 - local) / weight[point] + by_density
        return point, light, (1 / (of_light * of_point)).astype(np.float32)


def _choose(rng: np.random.Generator, count: int, odds: np.ndarray, adaptive: float) -> np.ndarray:
    """Choose indices [count]: a share ``adaptive`` of them by the odds, the others evenly."""
    by_odds = rng.random(count) < adaptive
    total = np.cumsum(odds)
    index = np.resize(rng.permutation(len(odds)), count)
    index[by_odds] = np.searchsorted(total, rng.random(by_odds.sum()) * total[-1], side="right")
    return np.minimum(index, len(odds) - 1)


def _points(rng: np.random.Generator, sums: np.ndarray, cell: np.ndarray, adaptive: float) -> np.ndarray:
    """Choose points of the pool [N] for rows with light cells ``cell`` [N]; running sums [cells, P] of the odds."""
    point = np.resize(rng.permutation(sums.shape[1]), len(cell))
    by_odds = rng.random(len(cell)) < adaptive
    for c in np.unique(cell[by_odds]):
        rows = np.flatnonzero(by_odds & (cell == c))
        total = sums[c]
        if total[-1] > 0:
            point[rows] = np.searchsorted(total, rng.random(len(rows)) * total[-1], side="right")
    return np.minimum(point, sums.shape[1] - 1)


def _default_lights(scene: Scene, variable: Variable) -> Callable[[int, int], np.ndarray]:
    from lightwell.scenes.placing import sample_lights

    return lambda count, seed: sample_lights(scene, variable, count, seed)
