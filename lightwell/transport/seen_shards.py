"""What shards whose points lie where people look share: points, their rays, and the columns that say where they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import ceil
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.variables import Variable, from_json, has_sky, to_json
from lightwell.transport.gather_sums import DeviceRows
from lightwell.transport.point_rejection import Rejection
from lightwell.transport.radiance import PathReport
from lightwell.transport.radiosity import Radiosity
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.seen import draw_seen
from lightwell.transport.shards import ShardSettings

# Added to the index of an adaptive shard, so that it shares no random number with the others.
ADAPTIVE_STREAM = 1 << 20
# Random streams of what all shards of a scene share.
SHARED_STREAM, STREAMS = 0x6A, 4
# Rays of a point, and the lights whose bins are lit.
RAYS, MOST_LIGHTS = 128, 2048
# Paths of a sample that look for the once reflected light of a lamp: noise against shards in the same time. As many for
# each path that a sample is asked to have, of which there are 16 by default.
PATHS, PATHS_OF_EACH = 32, 2
# A half of a sample is at most so many times the other, to which this multiple of the mean under the same light is
# added; the mean is without this share of the largest halves, which would raise their own limit. With a multiple of
# 0.25, a third of all light was lost where few paths find any; with 2, spikes keep as little of their noise.
SPIKE, SPIKE_LEVEL, TRIMMED = 8.0, 2.0, 0.01
# Most points with rows and bins; small bakes have fewer of each in proportion.
MOST_POINTS, MOST_BINS = 1 << 18, 16384
FEWEST_POINTS, FEWEST_BINS, FEWEST_LIGHTS = 1 << 12, 512, 64
# Rows with points of their own for each shard that is expected; beyond, points meet further lights.
POINTS_PER_SHARD = 1 << 14


@dataclass(frozen=True)
class GatherSize:
    """How much is traced before the first shard."""

    points: int
    bins: int
    lights: int
    rays: int = RAYS
    """Rays of a point, even."""
    paths: int = PATHS
    """Paths of a sample that look for the once reflected light of a lamp, even; 0: it is gathered too."""

    @staticmethod
    def of(shards: int, settings: ShardSettings, rays: int = RAYS) -> GatherSize:
        """Choose sizes that suit a number of shards.

        Args:
            shards: Expected shards.
            settings: Sizes of a shard, and the paths of its samples.
            rays: Rays of a point, even.

        Returns:
            The sizes.
        """
        rows = shards * min(settings.size, POINTS_PER_SHARD)
        points = int(np.clip(1 << max(rows - 1, 1).bit_length(), FEWEST_POINTS, MOST_POINTS))
        share = points / MOST_POINTS
        scaled = lambda most, fewest: int(max(most * share**0.5, fewest))  # noqa: E731
        return GatherSize(
            points,
            scaled(MOST_BINS, FEWEST_BINS),
            int(np.clip(1 << (int(MOST_LIGHTS * share**0.5) - 1).bit_length(), FEWEST_LIGHTS, MOST_LIGHTS)),
            rays,
            PATHS_OF_EACH * settings.paths,
        )


@dataclass(frozen=True)
class SeenTransport:
    """N points where people look, and what they see of the bins of the scene. It does not depend on the light."""

    points: SurfacePoints
    radiosity: Radiosity
    rows: DeviceRows


@dataclass(frozen=True)
class SeenBins:
    """How points where people look are drawn, and the bins that they see are found."""

    variable: Variable | None
    """People look where it may be; None: anywhere."""
    points: int
    bins: int
    floor: int
    """Points per visible object at least."""
    seeds: tuple[int, int]
    """Of the points and of the bins."""

    def make(self, scene: Scene) -> tuple[SurfacePoints, Radiosity]:
        """Draw the points and find the bins; the scene keeps the last ones.

        Args:
            scene: The scene.

        Returns:
            Points and bins.
        """

        def made() -> tuple[SurfacePoints, Radiosity]:
            drawn = draw_seen(scene, self.variable, self.points, self.seeds[0], floor=self.floor).points
            return drawn, Radiosity(scene, drawn, self.seeds[1], self.bins)

        return scene.cache.get(SEEN_BINS, made, self)

    def recipe(self, rows: tuple[int, int] | None = None, other: tuple[int, int, int] | None = None) -> Recipe:
        """Describe rows that look at the bins to workers.

        Args:
            rows: Number of the first point, and how many follow, from the first one again after the last; None: all.
            other: Count, seed and floor of other points where people look, which see these bins; None: the same points.

        Returns:
            The recipe.
        """
        variable = None if self.variable is None else to_json(self.variable)
        settings = asdict(self) | {"variable": variable, "seeds": list(self.seeds)}
        return Recipe("seen-bins", settings | {"rows": rows and list(rows), "other": other and list(other)})


SEEN_BINS = Derived[tuple[SurfacePoints, Radiosity]]("transport.seen_bins", most=2)
SEEN = Derived[SeenTransport]("transport.seen")


class SeenShards:
    """Base of shards that choose from one set of points, whose rays are traced when the first shard is made.

    Shards of a moving light and of the scene's own emitters have the same points and rays: paths need no light.
    """

    before_adaptive = 0.0
    """Seconds before the first adaptive shard."""

    @property
    def paths(self) -> int:
        """Paths of a sample: those of its own, or the rays that all samples of its point share."""
        return self._size.rays

    def __init__(
        self,
        scene: Scene,
        variable: Variable,
        settings: ShardSettings,
        size: GatherSize,
        looked: Variable | None = None,
    ) -> None:
        """Prepare to make shards; nothing is traced yet.

        Args:
            scene: The scene.
            variable: The declared light.
            settings: Sizes and seed.
            size: How much is traced before the first shard.
            looked: People look where this light may be; lights with the same one share points and rays. None: where the
                declared light may be.
        """
        self._scene, self._variable, self._settings, self._size = scene, variable, settings, size
        self._looked = looked or variable

    @property
    def _seeds(self) -> np.ndarray:
        return np.random.SeedSequence([self._settings.seed, SHARED_STREAM]).generate_state(STREAMS)

    @property
    def seen(self) -> SeenTransport:
        """Trace what all shards of the scene share, at the first use.

        Returns:
            Points and their rays.
        """
        # Paths of single samples are traced later.
        size = replace(self._size, paths=0)
        arguments = (self._looked, self._sky, self._settings.seed, self._floor, size)
        return self._scene.cache.get(SEEN, self._traced, arguments)

    @property
    def _sky(self) -> bool:
        """Whether rays that leave the scene note where; to a light without a sky these cells are dark."""
        return has_sky(self._variable) or has_sky(self._looked)

    def prepare(self) -> float:
        """Trace what all shards share, unless it is known.

        Returns:
            Seconds that it took.
        """
        start = perf_counter()
        self._prepare()
        return perf_counter() - start

    def _prepare(self) -> None:
        """Trace what all shards share, and light it."""
        raise NotImplementedError

    @property
    def points(self) -> SurfacePoints:
        """Draw the points that all shards share.

        Returns:
            The points.
        """
        return self.seen.points

    @property
    def _floor(self) -> int:
        """Points per visible object at least."""
        return max(self._size.points * self._settings.floor // self._settings.size, 1)

    def _traced(self) -> SeenTransport:
        size, seeds = self._size, [int(s) for s in self._seeds]
        made_of = SeenBins(self._looked, size.points, size.bins, self._floor, (seeds[0], seeds[2]))
        points, radiosity = made_of.make(self._scene)
        rows = DeviceRows.traced(radiosity, points, size.rays, seeds[3], self._sky, made_of.recipe())
        return SeenTransport(points, radiosity, rows)


def seen_inputs(scene: Scene, settings: Mapping[str, Any], arrays: Arrays) -> Inputs:
    """Draw points and find the bins that they see; see ``row_recipes.RecipeFunction``.

    Args:
        scene: The scene.
        settings: As ``SeenBins.recipe`` writes them.
        arrays: Not used.

    Returns:
        Columns of ``SurfacePoints``, and ``Bins.arrays``.
    """
    of = {name: settings[name] for name in ("points", "bins", "floor")}
    variable = None if settings["variable"] is None else from_json(settings["variable"])
    made_of = SeenBins(variable, seeds=tuple(settings["seeds"]), **of)
    points, radiosity = made_of.make(scene)
    if settings["other"]:
        count, seed, floor = settings["other"]
        points = draw_seen(scene, made_of.variable, count, seed, floor=floor, shown=True).points
    if settings["rows"]:
        first, count = settings["rows"]
        points = points[(first + np.arange(count)) % len(points)]
    return Inputs(columns_of(points), radiosity.bins.arrays())


def place_columns(points: SurfacePoints, weight: np.ndarray, flat: np.ndarray) -> dict[str, np.ndarray]:
    """Collect the columns of a shard that say where its rows are.

    Args:
        points: N points.
        weight: [N] weights of the points.
        flat: [N, 3] geometric normals.

    Returns:
        Columns by name, [N, ...] each.
    """
    columns = {"weight": weight, "shape": points.shape, "triangle": points.triangle}
    return columns | {"barycentric": points.barycentric, "flat": flat}


def path_counts(paths: int) -> dict[str, dict]:
    """Write the counts of a shard whose points were all valid.

    Args:
        paths: Light paths that were traced, ≥ 0.

    Returns:
        Counts of paths and of dropped points, as those of ``make_shard``.
    """
    return {"paths": asdict(PathReport(paths=paths)), "rejection": asdict(Rejection())}


def without_spikes(a: np.ndarray, b: np.ndarray, run: int) -> tuple[np.ndarray, np.ndarray]:
    """Limit halves of samples that single paths decide: fields learn them as spots of light.

    Such a path found a lamp by way of a glossy surface. A half is at most ``SPIKE`` times the other one, to which a
    multiple of the mean under the same light is added: where light is rare, one half often finds none. A little light
    is lost.

    Args:
        a: [N, 3] first half of samples, in runs that share a light.
        b: [N, 3] the other half.
        run: Samples of a run.

    Returns:
        Both halves; colours are kept.
    """
    level = [half.mean(axis=1, keepdims=True) for half in (a, b)]
    sorted_halves = np.sort(np.concatenate([half.reshape(-1, run) for half in level], axis=1), axis=1)
    largest = ceil(TRIMMED * 2 * run)
    # Sorted: NaN stands last, among those left out.
    mean = np.nanmean(sorted_halves[:, :-largest], axis=1).repeat(run)[:, None]
    caps = [SPIKE * (other + SPIKE_LEVEL * mean) for other in reversed(level)]
    return tuple(half * np.minimum(cap / np.maximum(l, 1e-30), 1) for half, l, cap in zip((a, b), level, caps))
