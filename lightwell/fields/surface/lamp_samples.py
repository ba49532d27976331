"""Training samples of the scene's own lamps: the share of every group at surface points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Protocol

import numpy as np

from lightwell.core.formats import JSON, RecordFormat
from lightwell.core.work import WorkPart
from lightwell.fields.base import UNIT_FACTOR
from lightwell.fields.budget import learning_seconds
from lightwell.fields.protocol import State, Traced
from lightwell.fields.surface.plan import RAYS
from lightwell.scenes.executor import Recipe
from lightwell.transport.lamp_light import LampLight, LampShares
from lightwell.transport.queries import make_query
from lightwell.transport.samples import Query, Samples, SurfacePoints, columns_of
from lightwell.transport.seen import draw_seen
from lightwell.transport.seen_shards import GatherSize, SeenBins
from lightwell.transport.shards import ShardSettings

# Points of a batch, which is stored when it is traced; batches of a bake, and of one with fixed counts, per shard.
BATCH, MOST_BATCHES = 1 << 13, 64
# Points that a second of the budget is worth, for the size of what is drawn before the first batch.
POINTS_PER_SECOND = 1000
# A gathered point of a moving light has so many times the rays of a point of the lamps: many points are worth more
# than exact ones.
RAYS_SHARE = 4
# Share of the time of the role that tracing takes.
TRACE_SHARE = 0.5
# Held-out points of early stopping, and how many rays they have of those of a training point.
VALIDATION_POINTS, VALIDATION_RAYS = 2048, 8
# Points that find the bins, and objects' least share of points.
FLOOR = 8


@dataclass(frozen=True)
class LampSamples:
    """N surface points with the radiance that each of K groups makes them reflect."""

    query: Query
    half_a: np.ndarray
    """[N, K, 3] mean over the first half of the rays."""
    half_b: np.ndarray
    """[N, K, 3] mean over the second, independent half."""
    shape: np.ndarray
    """[N] uint32 index of the mesh."""

    @property
    def radiance(self) -> np.ndarray:
        """[N, K, 3] mean of both halves."""
        return 0.5 * (self.half_a + self.half_b)

    @property
    def groups(self) -> int:
        """K."""
        return self.half_a.shape[1]

    def whole(self) -> Samples:
        """Return the samples of all groups together.

        Returns:
            N samples of weight 1.
        """
        weight = np.ones(len(self.shape), np.float32)
        return Samples(self.query, self.half_a.sum(axis=1), self.half_b.sum(axis=1), weight, self.shape)


@dataclass(frozen=True)
class LampTraining:
    """Training and held-out samples of the lamps."""

    training: LampSamples
    validation: LampSamples
    unit: float
    """Radiance unit S of all lamps together."""
    end: float
    """Wall seconds of the bake at which the role should be learned."""
    traced: Traced


class Tracer(Protocol):
    """Makes samples of the lamps."""

    rays: int
    """Rays of a point."""

    def batch(self, index: int) -> LampSamples:
        """Trace one batch, of about ``BATCH`` points.

        Args:
            index: Number of the batch.

        Returns:
            The samples.
        """

    def held_out(self) -> LampSamples:
        """Trace the held-out points.

        Returns:
            The samples.
        """


def trace_lamps(state: State, make: Callable[[State, float], Tracer] | None = None) -> LampTraining:
    """Trace as many points as the budget buys; those of an interrupted bake are read.

    Args:
        state: The prepared scene, with groups of lamps.
        make: Makes what traces them, from the state and the seconds of the role; None: in the pose of the scene.

    Returns:
        The samples.

    Raises:
        ValueError: No lamp lights any point.
    """
    job, part = state.job, state.job.work.part(role="static", lamps=[group.name for group in state.lamps])
    begin = part.get("plan.lamps.begin", partial(_begin, state), JSON)
    tracer = make(state, begin["seconds"]) if make else LampTracer(state)
    parts: list[LampSamples] = []
    with job.work.timed("trace"), job.progress.stage("trace lamps", MOST_BATCHES, "batches") as stage:
        count = part.find("plan.lamps.batches", JSON) or job.request.shards
        while len(parts) < (count or MOST_BATCHES):
            start = perf_counter()
            parts.append(_batch(part, tracer, len(parts)))
            if len(parts) == 2 and not count:  # The first one also pays for what is traced before it.
                count = _batches(begin["end"] - job.work.elapsed, perf_counter() - start)
                part.put("plan.lamps.batches", count, JSON)
            stage.move_to(len(parts), f"of {count or MOST_BATCHES}")
    validation = part.part(validation=True).get("lamps.samples", tracer.held_out, RecordFormat(LampSamples))
    training = join_lamps(parts)
    mean = float(training.radiance.sum(axis=1).mean())
    if not mean > 0:
        raise ValueError("bake: none of the scene's own lamps lights any surface point; bake with --no-static")
    traced = Traced(len(training.shape) * tracer.rays, 0, len(training.shape), each=tracer.rays)
    return LampTraining(training, validation, UNIT_FACTOR * mean, begin["end"], traced)


def _begin(state: State) -> dict[str, float]:
    """When the role should be learned, on the clock of the bake."""
    budget, begin = state.job.request.budget, state.job.work.elapsed
    seconds = learning_seconds(budget, begin) if budget.seconds else budget.round_seconds
    return {"end": begin + seconds, "seconds": seconds}


def _batches(seconds: float, cost: float) -> int:
    """Batches for the time that is left, of which two are traced."""
    return int(np.clip(2 + TRACE_SHARE * seconds / max(cost, 1e-3), 2, MOST_BATCHES))


def _batch(part: WorkPart, tracer: Tracer, index: int) -> LampSamples:
    return part.part(batch=index).get("lamps.samples", partial(tracer.batch, index), RecordFormat(LampSamples))


def points_drawn(state: State) -> int:
    """Count the points that are drawn before the first batch: a power of two, for the budget or the fixed shards.

    Args:
        state: The prepared scene.

    Returns:
        Points, at least those of one batch.
    """
    request = state.job.request
    wanted = request.shards * BATCH if request.shards else POINTS_PER_SECOND * request.budget.round_seconds
    return int(np.clip(1 << int(wanted - 1).bit_length(), BATCH, MOST_BATCHES * BATCH))


class LampTracer:
    """Points and lit bins of a scene, made when the first batch is traced."""

    def __init__(
        self, state: State, count: int | None = None, size: int | None = None, stream: tuple[int, ...] = ()
    ) -> None:
        """Prepare to trace; nothing is traced yet.

        Args:
            state: The prepared scene, with groups of lamps; nothing moves.
            count: Points that batches choose from; None: ``points_drawn``.
            size: Points of a batch; None: ``BATCH``.
            stream: Numbers beside the seed of the bake, so that no two tracers share a random number.
        """
        self._state, self._size, request = state, size or BATCH, state.job.request
        self.rays = RAYS[request.quality] // RAYS_SHARE
        self._seeds = np.random.SeedSequence([request.seed, 0x1A, *stream]).generate_state(5)
        self._count = count or points_drawn(state)
        self._light: LampLight | None = None
        settings = ShardSettings(seed=request.seed)
        floor = max(self._count * settings.floor // settings.size, 1)
        bins = GatherSize.of(max(self._count // (1 << 14), 1), ShardSettings()).bins
        self._seen = SeenBins(state.variable, self._count, bins, floor, (int(self._seeds[0]), int(self._seeds[1])))

    @property
    def points(self) -> SurfacePoints:
        """The points that batches choose from."""
        return self._seen.make(self._state.scene)[0]

    @property
    def light(self) -> LampLight:
        """The lit bins."""
        if self._light is None:
            radiosity = self._seen.make(self._state.scene)[1]
            self._light = LampLight(radiosity, self._state.lamps, int(self._seeds[2]))
        return self._light

    def batch(self, index: int) -> LampSamples:
        """Trace one batch; where all points are used, the same ones with other rays.

        Args:
            index: Number of the batch.

        Returns:
            The samples.
        """
        first = index * self._size
        rows = (np.arange(self._size) + first) % len(self.points)
        recipe = lambda start, count: self._seen.recipe((first + start, count))  # noqa: E731
        return self._samples(self.points[rows], self.rays, int(self._seeds[3]) + first, recipe)

    def held_out(self, count: int | None = None) -> LampSamples:
        """Trace held-out points.

        Args:
            count: How many; None: ``VALIDATION_POINTS``.

        Returns:
            The samples, which have more rays.
        """
        scene, variable, count = self._state.scene, self._state.variable, count or VALIDATION_POINTS
        seed = int(self._seeds[4])
        points = draw_seen(scene, variable, count, seed, floor=FLOOR, shown=True).points
        recipe = lambda *rows: self._seen.recipe(rows, (count, seed, FLOOR))  # noqa: E731
        return self._samples(points, VALIDATION_RAYS * self.rays, seed, recipe)

    def _samples(self, points: SurfacePoints, rays: int, seed: int, recipe: Callable[..., Recipe]) -> LampSamples:
        shares: LampShares = self.light.shares(points, rays, seed, recipe=recipe)
        query = make_query(self._state.scene, points, np.zeros(3, np.float32))
        halves = (np.nan_to_num(half, posinf=0, neginf=0) for half in (shares.half_a, shares.half_b))
        return LampSamples(query, *halves, shape=np.asarray(points.shape, np.uint32))


def join_lamps(parts: list[LampSamples]) -> LampSamples:
    """Join samples, in order.

    Args:
        parts: At least one set of samples.

    Returns:
        All rows.
    """
    join = lambda name: np.concatenate([getattr(part, name) for part in parts])  # noqa: E731
    columns = columns_of(parts[0].query)
    query = Query(**{name: np.concatenate([getattr(part.query, name) for part in parts]) for name in columns})
    return LampSamples(query, join("half_a"), join("half_b"), join("shape"))
