"""Training of a cache on one frame after the other."""

from __future__ import annotations

import math
import time
import warnings
from collections import deque
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.batches import frozen_batches
from lightwell.cache.brightness_correction import RecentRecords
from lightwell.cache.change_detection import ChangeDetector, DivergenceMonitor
from lightwell.cache.guide_table import GuideTable
from lightwell.cache.guide_training import GuideTraining
from lightwell.cache.learner import Batch
from lightwell.cache.predictor import Predictor
from lightwell.cache.replay import Replay
from lightwell.cache.scene_region import SceneRegion
from lightwell.cache.schedule import YOUNG_STEPS, FrameSchedule
from lightwell.cache.settings import CacheSettings
from lightwell.cache.training_frame import FrameParameters, FrameShape, TracedRecords, choice_of, frozen_frame
from lightwell.cache.training_stats import TrainingStats, noise_of

# Frames between two copies of the weights.
SNAPSHOT = 64


class Trainer:
    """Traces training paths and takes gradient steps on their records."""

    def __init__(
        self, settings: CacheSettings, region: SceneRegion, predictor: Predictor, schedule: FrameSchedule,
        guiding: GuideTraining,
    ) -> None:  # fmt: skip
        """Train these parts of a cache.

        Args:
            settings: Settings of the cache.
            region: Scene that is learned.
            predictor: Network that is trained.
            schedule: Size of the frames.
            guiding: Guide that is trained, if there is one.
        """
        self.settings, self.region, self.predictor = settings, region, predictor
        self.schedule, self.guiding = schedule, guiding
        self.detector, self.growth = ChangeDetector(), DivergenceMonitor()
        """Detectors of changes of the scene and of unbounded growth."""
        self.replay = Replay()
        """Pool of rays of earlier cameras."""
        self.history: deque[TrainingStats] = deque(maxlen=4096)
        """Statistics of the last frames."""
        self._recent = RecentRecords()

    def restart(self) -> None:
        """React to a change of the scene."""
        self.predictor.learner.forget()
        self.predictor.correct(None)
        self.schedule.restart()
        self.detector.reset()
        self.growth.reset()
        self._recent.clear()
        self.guiding.forget()

    def train(self, scene: Any, sensor: Any, seed: int) -> TrainingStats:
        """Train on one frame: trace training paths, take gradient steps, adapt scale and tiles.

        Args:
            scene: Mitsuba scene of the region.
            sensor: Mitsuba sensor from which training paths start.
            seed: Seed of the image.

        Returns:
            Statistics of the frame; ``changed`` tells whether the scene appears to have changed.
        """
        stats = TrainingStats(frame=self.schedule.frame, scale=self.predictor.scale.value)
        if self.predictor.level is not None:
            self.predictor.correct(None)
        with dr.suspend_grad():
            start = time.perf_counter()
            traced, grid = self._trace(scene, sensor, seed, stats)
            stats.seconds["trace"] = time.perf_counter() - start
            start = time.perf_counter()
            batch, steps = self._records(traced, grid, seed, stats)
            stats.seconds["records"] = time.perf_counter() - start
        start = time.perf_counter()
        self._learn(batch, steps, stats)
        stats.seconds["train"] = time.perf_counter() - start
        return stats

    def settle(self) -> None:
        """Measure the local gain of a still with the records of its last training frames."""
        predictor = self.predictor
        with dr.suspend_grad():
            level = self._recent.levels(predictor.model, predictor.packed("ema")[0], predictor.scale.value)
        if level is not None:
            predictor.correct(level)
        self._recent.clear()

    def watch_growth(self, level: float) -> None:
        """Warn when predictions used as targets make the cache brighter without bound; not while it is untrained.

        Args:
            level: Mean luminance of the predictions that ended training paths.
        """
        if self.schedule.young or self.predictor.learner.averaged < YOUNG_STEPS:
            return
        if factor := self.growth.update(level):
            materials = self.region.materials
            warnings.warn(
                f"nrc: the cache grew {factor:.1f} times brighter while the scene rested; its materials reflect up to "
                f"{materials.highest if materials else 1:.2f} of what they receive: set tail_attenuation=0.9",
                stacklevel=2,
            )

    def _trace(self, scene: Any, sensor: Any, seed: int, stats: TrainingStats) -> tuple[TracedRecords, tuple[int, int]]:
        """Trace training paths, and compute their targets and the bias estimate; also return columns and rows."""
        s, schedule = self.settings, self.schedule
        film = sensor.film()
        width, height = (int(x) for x in film.crop_size())
        tiles = schedule.tiles_of(width, height)
        columns, rows, tile_w, tile_h = tiles.grid(width, height)
        table = self.guiding.next_table(schedule.still, self.history[-1].noise if self.history else math.nan)
        # With a cache, the guide is trained with plain paths: guided ones take longer without benefit for the cache.
        guide = None if s.caching else self.guiding.guide
        u = schedule.unbiased_share
        shape = FrameShape(
            columns * rows, s.paths.max_vertices, (width, height),
            (float(sensor.shutter_open()), float(sensor.shutter_open_time())), choice_of(u),
            f"{sensor.class_name()} {film.size()} {film.crop_offset()}", table is not None, guide is not None,
            s.caching,
        )  # fmt: skip
        cells = mi.Vector3f(1) if table is None else table.opaque_cells
        self.replay.look(str(sensor.world_transform().matrix))
        numbers = FrameParameters(
            seed, schedule.frame, columns, (tile_w, tile_h), u, s.paths.tail_attenuation, s.paths.tail_after,
            s.training.replay, self.replay.held,
        )  # fmt: skip
        tails, pixels = self.predictor.packed(s.training.bootstrap), self.predictor.packed("ema")
        traced = frozen_frame(self.predictor.model, shape)(
            scene, sensor, self.region.context, tails, pixels, numbers, self.replay.pool, cells, guide
        )
        self.replay.saw(traced.o, traced.d)
        self.watch_growth(float(traced.level[0]))
        self._read(traced, table, stats)
        stats.paths = shape.P
        tiles.update(stats.records, stats.paths, width, height)
        return traced, (columns, rows)

    @staticmethod
    def _read(traced: TracedRecords, table: GuideTable | None, stats: TrainingStats) -> None:
        """Read counts and bias estimate of a frame, and add its records to the guide."""
        if table is not None:
            found = traced.guide
            table.add(*(np.array(x) for x in (found.cell, found.bin, found.met, found.reach, found.whole)))
        stats.records, stats.dropped = int(traced.count[0]), int(traced.dropped[0])
        stats.hits = int(traced.hits[0])
        count, total, square = (float(x[0]) for x in traced.meter)
        stats.bias_paths = int(count)
        if count > 1:
            mean = total / count
            stats.bias = (mean, math.sqrt(max(square / count - mean**2, 0) / (count - 1)))

    def _records(
        self, traced: TracedRecords, grid: tuple[int, int], seed: int, stats: TrainingStats
    ) -> tuple[Batch | None, int]:
        """Return shuffled batches on the device and the number of steps that they suffice for."""
        s, scale = self.settings, self.predictor.scale
        luminances = np.array(traced.luminance)
        if self.schedule.still:
            stats.noise = noise_of(luminances[:: s.paths.max_vertices], *grid)
        if not s.caching:
            return None, 0
        factor = scale.update(luminances[luminances >= 0])
        if factor != 1.0:
            self.predictor.learner.rescale(factor)
            self.predictor.touched()
        stats.scale = scale.value
        size = s.training.batch
        steps = min(self.schedule.steps, -(-stats.records // size))
        # A step with less than half a batch is omitted unless it is the only one.
        if steps > 1 and stats.records - (steps - 1) * size < size // 2:
            steps -= 1
        if steps == 0:
            return None, 0
        if self.schedule.still and s.image.local_level:
            self._recent.add(traced.features, traced.targets, traced.rows, stats.records)
        order = dr.opaque(mi.UInt32, (seed * 7919 + self.schedule.frame) & 0xFFFFFFFF)
        bits = max(1, (dr.width(traced.rows) - 1).bit_length())
        pack = frozen_batches(self.predictor.model, steps * size, bits)
        unit = dr.opaque(mi.Float, scale.value)
        batch = Batch(*pack(traced.features, traced.targets, traced.rows, traced.count, order, unit))
        dr.eval(batch.direct, batch.points, batch.target, batch.weight)
        return batch, steps

    def _learn(self, batch: Batch | None, steps: int, stats: TrainingStats) -> None:
        """Take the gradient steps of a frame."""
        learner, rate = self.predictor.learner, self.schedule.next_rate()
        stats.steps = steps
        if batch is None:
            return
        points = [learner.train(batch, k * self.settings.training.batch, rate) for k in range(steps)]
        values = np.array([np.array(point).ravel() for point in points])
        stats.loss, stats.residual = float(values[:, 0].mean()), float(values[:, 1].mean())
        if not np.isfinite(stats.loss):
            learner.restore()
        elif self.schedule.frame % SNAPSHOT == SNAPSHOT - 1:
            learner.keep()
        self.predictor.touched()
        if self.settings.training.on_change == "detect":
            stats.changed = self.detector.update(stats.loss, stats.residual)
