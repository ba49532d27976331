"""Shards of samples where people look, gathered for all lights at once.

A sample costs a table read and has the noise of all rays of its point, and what the bins blur is wrong. The light of a
lamp that was reflected once is therefore traced for each sample: bins blur the spot beside a lamp and the edges of its
shadows, and the rays of a point rarely meet that spot. The table holds what was reflected more often.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import PointLight, Variable, has_sky
from lightwell.transport.adaptive import PairChoice, Predict, residual_density
from lightwell.transport.day_light import day_light
from lightwell.transport.gather_sums import Gather
from lightwell.transport.light_vertices import SharedLamps
from lightwell.transport.queries import frames, make_query
from lightwell.transport.radiance import begin_first_reflection
from lightwell.transport.samples import Query, Samples, columns_of
from lightwell.transport.seen_shards import (
    ADAPTIVE_STREAM,
    PATHS_OF_EACH,
    SeenShards,
    path_counts,
    place_columns,
    without_spikes,
)
from lightwell.transport.shards import LightsFn, Make, ShardSettings, default_lights, shard_seeds

# Times of a day whose sky is kept, in colours: fewer than lights, because they lie on one line.
MOST_TIMES = 512
# The residual is measured on at most this many of the known samples: the fit was trained on them, but a network of a
# few thousand weights cannot memorise them.
MOST_JUDGED = 1 << 18


# Random stream of the light rays of all lamps.
LIGHT_RAYS = 0x4C


class GatheredShards(SeenShards):
    """Makes shards of a declared light; what all of them share is traced when the first one is made."""

    most: int | None = None
    """Shards that hold all that there is; None: there are always further pairs of point and light."""

    @property
    def paths(self) -> int:
        """Paths of a sample of its own, of a lamp; else the rays that all samples of its point share."""
        return self._size.paths if self.traces_first else super().paths

    def with_paths(self, paths: int) -> GatheredShards:
        """Return a maker of the same shards whose samples have another number of paths.

        Args:
            paths: Paths that a sample is asked to have, even, ≥ 2.

        Returns:
            The maker; it shares what was traced before.
        """
        other = copy(self)
        other._settings = replace(self._settings, paths=paths)
        other._size = replace(self._size, paths=min(self._size.paths, 1) * PATHS_OF_EACH * paths)
        return other

    @cached_property
    def lights(self) -> np.ndarray:
        """Draw the lights under which the bins are lit.

        Returns:
            [K, 3] positions (directions of a sun).
        """
        count = min(self._size.lights, MOST_TIMES) if has_sky(self._variable) else self._size.lights
        return default_lights(self._scene, self._variable)(count, int(self._seeds[1]))

    @cached_property
    def _gather(self) -> Gather:
        seen, seed, variable = self.seen, int(self._seeds[3]), self._variable
        if self.traces_first:
            return Gather(seen.rows, seen.radiosity.indirect(seen.radiosity.direct(variable, self.lights, seed)))
        light = partial(day_light, seen.radiosity) if has_sky(variable) else seen.radiosity.light
        return Gather(seen.rows, light(variable, self.lights, seed).irradiance)

    @property
    def traces_first(self) -> bool:
        """Tell whether once reflected light is traced for each sample: that of a point, whose light rays find its spot.

        Returns:
            Whether samples have paths of their own.
        """
        point = isinstance(self._variable, PointLight) and self._variable.radius == 0
        return point and self._size.paths > 0

    def _prepare(self) -> None:
        """Trace what all shards share, and light it."""
        self._gather  # noqa: B018

    @cached_property
    def _query(self) -> Query:
        return make_query(self._scene, self.points, np.zeros(3, np.float32))

    @cached_property
    def _flat(self) -> np.ndarray:
        """[N, 3] geometric normals of the points."""
        return frames(self._scene, self.points)[2]

    def __call__(
        self, scene: Scene, variable: Variable, lights_fn: LightsFn | None, settings: ShardSettings, index: int
    ) -> tuple[dict[str, np.ndarray], dict]:
        """As ``make_shard``; the lights are those of all shards."""
        random = np.random.default_rng(shard_seeds(settings, index)[0])
        point = _spread(len(self.points), settings.size, random)
        light = _spread(len(self.lights), settings.lights, random).repeat(settings.points_per_light)
        # The rays of the rows serve all shards; the first one counts them.
        paths = len(self.points) * self._size.rays if index == 0 else 0
        seed = shard_seeds(settings, index)[2]
        return self._columns(point, light, np.ones(settings.size, np.float32), paths, seed)

    def adaptive(self, known: Samples, predict: Predict) -> Make:
        """Make the function for shards in which half of the samples lie where a fit has a large residual.

        Args:
            known: Samples on which the residual is measured.
            predict: The fitted field.

        Returns:
            Makes a shard, as ``make_shard`` does.
        """
        judged = known[:MOST_JUDGED]
        choices: list[PairChoice] = []

        def make(
            scene: Scene, variable: Variable, lights_fn: LightsFn | None, settings: ShardSettings, index: int
        ) -> tuple[dict[str, np.ndarray], dict]:
            if not choices:
                density = residual_density(scene, judged, predict(judged.query))
                even = np.ones(len(self.points))
                choices.append(PairChoice(density, self._query.position, self.points.shape, even))
            seeds = shard_seeds(settings, ADAPTIVE_STREAM + index)
            # Lights to choose from: as many as a shard has, so that as many rows share one.
            offered = _spread(len(self.lights), settings.lights, np.random.default_rng(seeds[1]))
            point, light, weight = choices[0](self.lights[offered], settings.size, seeds[0])
            return self._columns(point, offered[light], weight, 0, seeds[2])

        return make

    def _columns(
        self, point: np.ndarray, light: np.ndarray, weight: np.ndarray, paths: int, seed: int
    ) -> tuple[dict, dict]:
        """Columns and counts of a shard of pairs, by index."""
        run, begun = self._settings.points_per_light, None
        gathered = self._gather(point, light)
        points = self.points[point]
        if self.traces_first:
            shared = SharedLamps(self.lights, light.astype(np.uint32), int(self._seeds[3]) ^ LIGHT_RAYS)
            way = (points, self.lights[light], self._variable, self._size.paths, seed, shared)
            begun = begin_first_reflection(self._scene, *way)
            paths += self._size.paths * len(point)
        # While paths are traced:
        columns = columns_of(self._query[point]) | place_columns(points, weight, self._flat[point])
        half_a, half_b = without_spikes(*gathered, run)
        if begun is not None:
            first = without_spikes(*begun(), run)
            half_a, half_b = half_a + first[0], half_b + first[1]
        columns |= {"light": self.lights[light], "half_a": half_a, "half_b": half_b}
        return columns, path_counts(paths)


def _spread(count: int, wanted: int, random: np.random.Generator) -> np.ndarray:
    """[wanted] indices below ``count`` in random order, each as often as the others."""
    return np.concatenate([random.permutation(count) for _ in range(-(-wanted // count))])[:wanted]
