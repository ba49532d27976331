"""The radiance cache of one scene: training on traced paths, and queries by rendering paths."""

from __future__ import annotations

import math
import time
import warnings
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache import persist
from lightwell.cache.batches import frozen_batches
from lightwell.cache.brightness_correction import FRAMES, CellSums, CorrectedScaling, RadianceScaling
from lightwell.cache.change_detection import ChangeDetector, DivergenceMonitor
from lightwell.cache.features import WIDTH, Vertex, stored
from lightwell.cache.guide import Guide
from lightwell.cache.guide_table import CALM, LESSONS, GuideTable
from lightwell.cache.learner import Batch, Learner
from lightwell.cache.materials import CacheMaterialTable, material_table
from lightwell.cache.model import Model
from lightwell.cache.render_paths import PathContext
from lightwell.cache.replay import Replay
from lightwell.cache.scale import RadianceScale
from lightwell.cache.settings import CacheSettings
from lightwell.cache.tiles import FIRST, SLACK, Tiles
from lightwell.cache.training_frame import (
    FrameParameters,
    FrameShape,
    TracedRecords,
    choice_of,
    frozen_frame,
    shared_offset,
)

# Relative margin of the box, so that no surface lies on its boundary.
INFLATE = 0.01
# Number of larger frames of an untrained cache, and factor of the lead-in where frames are not larger. Kinds of change;
# larger frames after one; factor of the learning rate after one, and frames that have it.
EAGER_FRAMES, SMALL_FRAMES = 8, 4
KINDS = ("light", "material", "geometry", "camera")
REACTION, BOOST, BOOST_FRAMES = 4, 2.0, 6
# Frames in which a cache may grow brighter, because each can add a bounce of light.
YOUNG = 48
# Frames between two copies of the weights.
SNAPSHOT = 64
# Frames of training before a still: largest share of pixels, records, first side of the tiles, and their slack.
STILL_FRACTION, STILL_RECORDS, STILL_SIDE, STILL_SLACK = 1.0, 1 << 17, 2.0, 0.4


@dataclass
class TrainingStats:
    """Statistics of one training frame."""

    frame: int = 0
    """Number of the frame."""
    records: int = 0
    """Records used."""
    dropped: int = 0
    """Records discarded because they were not finite."""
    paths: int = 0
    """Training paths."""
    hits: int = -1
    """Training paths that hit a surface with a record; -1: unknown."""
    steps: int = 0
    """Gradient steps."""
    loss: float = float("nan")
    """Mean loss before the steps; NaN without a step."""
    residual: float = 0.0
    """Mean signed difference prediction - target, before the steps, in units of the network."""
    bias: tuple[float, float] = (0.0, float("inf"))
    """Bias estimate: mean of prefix * (traced - cached) over unbiased paths, and its standard error; radiance."""
    bias_paths: int = 0
    """Unbiased paths of that estimate."""
    noise: float = float("nan")
    """Stills: relative variance of one path per pixel, from neighbouring training paths."""
    scale: float = 1.0
    """Radiance scale."""
    changed: bool = False
    """Whether a change of the scene was detected."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Wall time by stage (trace, records, train), seconds."""


def noise_of(luminances: np.ndarray, columns: int, rows: int) -> float:
    """Estimate the relative variance of one path per pixel, within squares of 4 x 4 tiles.

    Args:
        luminances: [rows * columns] luminance over reflectance of the first record of each path; -1: no record.
        columns: Tiles per row.
        rows: Rows of tiles.

    Returns:
        Relative variance; NaN without a complete square.
    """
    whole = luminances.reshape(rows, columns)[: rows // 4 * 4, : columns // 4 * 4]
    groups = whole.reshape(rows // 4, 4, columns // 4, 4).swapaxes(1, 2).reshape(-1, 16).astype(np.float64)
    groups = groups[(groups >= 0).all(axis=1) & np.isfinite(groups).all(axis=1)]
    if not len(groups):
        return float("nan")
    mean = groups.mean(axis=1)
    return float(np.mean(groups.var(axis=1, ddof=1) / (mean**2 + 0.01 * mean.mean() ** 2 + 1e-30)))


def bounds_of(scene: Any) -> np.ndarray:
    """Compute the bounding box of a scene.

    Args:
        scene: Mitsuba scene.

    Returns:
        [2, 3] smallest and largest corner, metres.

    Raises:
        ValueError: The scene has no surfaces.
    """
    box = scene.bbox()
    corners = np.array([np.array(box.min), np.array(box.max)], np.float64).reshape(2, 3)
    if not np.isfinite(corners).all() or (corners[1] < corners[0]).any():
        raise ValueError("nrc: the scene has no surfaces to learn on; add a shape")
    return corners


class RadianceCache:
    """Neural radiance cache of one scene: predicts scattered radiance and is trained while the scene is rendered."""

    def __init__(self, settings: CacheSettings, box: np.ndarray | None = None) -> None:
        """Make an untrained cache.

        Args:
            settings: Settings.
            box: [2, 3] corners of the region that is learned, metres; None: the bounds of the scene.
        """
        self.settings = settings
        self.model = Model.of(settings)
        self.learner = Learner(self.model, settings)
        self.scale = RadianceScale(settings.radiance_scale)
        self.level: Any = None
        """Local gain of a still, see ``level.Sums.levels``; None: 1 everywhere."""
        self._recent: deque[tuple[Any, ...]] = deque(maxlen=FRAMES)
        self.tiles: dict[tuple[int, int, bool], Tiles] = {}
        self.still = False
        """Whether training precedes a still; its frames are larger, because no image is displayed meanwhile."""
        self.still_records = STILL_RECORDS
        """Wanted records of such a frame."""
        self.frame = 0
        """Frames trained."""
        self.scene_mark = ""
        """Fingerprint of the scene."""
        self.detector, self.changes, self.boost = ChangeDetector(), 0, 0
        """Detector of changes; number of changes; frames that still have a higher learning rate because of one."""
        self.guide_table: GuideTable | None = None
        """Training data of the guide; made by ``prepare`` where the settings enable a guide."""
        self.may_guide = False
        """guide=auto: whether the still has enough samples to try a guide."""
        self.growth, self.replay = DivergenceMonitor(), Replay()
        """Detector of unbounded growth; pool of rays of earlier cameras."""
        self.most_steps = 0
        """budget=auto: largest number of gradient steps of a frame; 0: that of the settings."""
        self.snapshot: tuple[Any, ...] | None = None
        """Last copy of finite weights."""
        self.rollbacks = 0
        """Number of times that the copy was restored."""
        self.since_change = 0
        """Frames trained; reset to ``begun`` when the scene changes."""
        self.begun = 0
        """Value of ``since_change`` after the last change."""
        self.frozen = False
        """Whether training has stopped."""
        self.rate_factor = 1.0
        """Factor of the learning rate; decays while a still trains."""
        self.history: deque[TrainingStats] = deque(maxlen=4096)
        self.fixed_box = box
        self.box: np.ndarray | None = None if box is None else np.asarray(box, np.float64)
        self.materials: CacheMaterialTable | None = None
        self._around: PathContext | None = None
        self._packs: dict[str, Any] = {}
        self.picture, self.grid = (0, 0), (1, 1)
        """Image size of the last training frame in pixels, and its numbers of tiles."""
        self.size = Tiles(1, 1.0)

    # ------------------------------------------------------------------ scene

    def prepare(self, scene: Any) -> None:
        """Read the bounds and the materials of a scene; to be called again when materials or geometry changed.

        Args:
            scene: Mitsuba scene.
        """
        if self.box is None:
            corners = bounds_of(scene)
            margin = np.maximum((corners[1] - corners[0]) * INFLATE, 1e-6 * max(1e-6, np.ptp(corners)))
            self.box = np.stack([corners[0] - margin, corners[1] + margin])
        if self.settings.guided and self.guide_table is None:
            self.guide_table = GuideTable(self.box, self.settings.guide_share)
        self.materials = material_table(scene)
        self._around = None
        self.scene_mark = persist.fingerprint(scene)

    def scene_changed(self, kind: str, scene: Any | None = None) -> None:
        """React to a change of the scene.

        The average of the weights restarts, the learning rate is raised for some frames, and all training paths end by
        Russian roulette for some frames, so that new light does not have to propagate through outdated predictions.

        Args:
            kind: 'light', 'material', 'geometry' or 'camera'; the latter has no effect.
            scene: Mitsuba scene, whose materials are read again; None: they have not changed.

        Raises:
            ValueError: ``kind`` is none of these.
        """
        if kind not in KINDS:
            raise ValueError(f"nrc: scene_changed('{kind}'), expected one of {', '.join(KINDS)}")
        if kind == "camera":
            return
        if scene is not None and kind in ("material", "geometry"):
            self.prepare(scene)
        self.learner.forget()
        self.since_change = self.begun = min(self.since_change, EAGER_FRAMES - REACTION)
        self.boost = BOOST_FRAMES
        # Tiles of larger frames restart: their size fits paths that end early, and the next paths do not.
        self.tiles = {key: tiles for key, tiles in self.tiles.items() if not key[2]}
        self.detector.reset()
        self.growth.reset()
        self.level = None
        self._recent.clear()
        if self.guide_table is not None:
            self.guide_table.forget()
        self.changes += 1
        self.touched()

    def freeze(self) -> None:
        """Stop training: the weights no longer change."""
        self.frozen = True

    def save(self, path: str | Path) -> None:
        """Write the cache to a file, see ``persist.save``.

        Args:
            path: File, ``.npz``.
        """
        persist.save(self, path)

    @staticmethod
    def load(path: str | Path, scene: Any | None = None) -> RadianceCache:
        """Read a file that ``save`` wrote, see ``persist.load``.

        Args:
            path: File.
            scene: Mitsuba scene that the cache must belong to; None: any.

        Returns:
            The cache.
        """
        return persist.load(path, RadianceCache, scene)

    def training_offset(self, seed: int) -> tuple[float, float]:
        """Return the position of the last frame's training pixels within their tiles.

        Args:
            seed: Seed of the image.

        Returns:
            Offset in [0, 1)^2.
        """
        at = shared_offset(dr.opaque(mi.UInt32, max(self.frame - 1, 0)), dr.opaque(mi.UInt32, seed & 0xFFFFFFFF))
        return float(at.x[0]), float(at.y[0])

    @property
    def around(self) -> PathContext:
        """Return the parameters of rendering paths.

        Returns:
            Parameters with the threshold of the settings.
        """
        if self._around is None:
            self._around = self.surroundings(self.settings.termination_c)
        return self._around

    def surroundings(self, c: float) -> PathContext:
        """Make the parameters of paths with a given termination threshold.

        Args:
            c: Threshold on the footprint over that of the primary hit, ≥ 0.

        Returns:
            The parameters.

        Raises:
            RuntimeError: ``prepare`` has not been called.
        """
        if self.box is None or self.materials is None:
            raise RuntimeError("nrc: the cache has no scene yet; call prepare(scene) first")
        a = PathContext()
        low, edge = self.box[0], self.box[1] - self.box[0]
        a.low = mi.Point3f(*[dr.opaque(mi.Float, float(x)) for x in low])
        a.inverse = mi.Vector3f(*[dr.opaque(mi.Float, float(1 / x)) for x in edge])
        a.roughness, a.albedo = self.materials.roughness, self.materials.albedo
        a.c = dr.opaque(mi.Float, min(c, 3e38))
        depth = self.settings.max_depth
        a.max_depth = dr.opaque(mi.UInt32, 0xFFFFFFFF if depth < 0 else depth)
        a.rr_depth = dr.opaque(mi.UInt32, self.settings.rr_depth)
        a.spike = dr.opaque(mi.Float, 3e38)
        return a

    # ------------------------------------------------------------------ queries

    def packed(self, which: str = "ema") -> tuple[tuple[Any, ...], RadianceScaling]:
        """Return the weights in the layout of kernels, with the factor to radiance.

        Args:
            which: 'ema': averaged weights, for pixels; 'raw': the newest ones.

        Returns:
            Packed weights and ``RadianceScaling``.
        """
        key = "raw" if which == "raw" or self.learner.shown is self.learner.values else "ema"
        if key not in self._packs:
            values = self.learner.values if key == "raw" else self.learner.shown
            views = self.model.packed(values)
            dr.eval(views)
            unscale = dr.opaque(mi.Float, 1 / self.scale.value)
            self._packs[key] = (
                views,
                RadianceScaling(unscale) if self.level is None else CorrectedScaling(unscale, self.level),
            )
        return self._packs[key]

    def touched(self) -> None:
        """Discard packed copies after a change of weights or scale."""
        self._packs.clear()

    def radiance(self, packed: tuple[tuple[Any, ...], RadianceScaling], v: Vertex) -> mi.Color3f:
        """Predict the scattered radiance towards ``v.w``.

        Args:
            packed: Result of ``packed``.
            v: Vertices.

        Returns:
            [N] radiance, ≥ 0.
        """
        return self.model.radiance(packed[0], v, packed[1])

    @property
    def guide(self) -> Guide | None:
        """Return the guide.

        Returns:
            Table of the guide; None when it is disabled or has no data yet.
        """
        table = self.guide_table
        return None if table is None or not len(table.keys) else table.guide()

    @property
    def teaches(self) -> bool:
        """Return whether the records of the next frame train the guide.

        Without a cache they always do; with a cache in the first frames of a still; with guide=auto only where the
        previous frame was noisy and the image has enough samples for a pilot.

        Returns:
            True when they do.
        """
        s, table = self.settings, self.guide_table
        if table is None or not s.caching:
            return table is not None
        if s.guide == "always":
            return not self.still or table.frames < LESSONS
        noisy = bool(self.history) and self.history[-1].noise >= CALM
        return self.still and self.may_guide and table.frames < LESSONS and (noisy or table.frames > 0)

    # ------------------------------------------------------------------ training

    def controller(self, width: int, height: int) -> Tiles:
        """Return the tile controller of an image size.

        Args:
            width: Image width, pixels.
            height: Image height, pixels.

        Returns:
            The controller, with the number of records of the next frame as its target.
        """
        large = self.still or self.eager
        key = (width, height, large)
        if key not in self.tiles:
            fraction = self.settings.train_fraction_max
            fraction = max(fraction, STILL_FRACTION) if large else fraction
            side, slack = (STILL_SIDE, STILL_SLACK) if large else (FIRST, SLACK)
            self.tiles[key] = Tiles(1, fraction, side, slack)
        self.tiles[key].target = self.still_records if self.still else self.settings.batch * self.steps
        return self.tiles[key]

    @property
    def eager(self) -> bool:
        """Return whether the next frame is larger, as the first ones of an untrained cache and after a change are.

        Returns:
            True for a larger frame.
        """
        return self._larger and not self.still and self.since_change < EAGER_FRAMES

    @property
    def _larger(self) -> bool:
        """Whether the first frames may be larger."""
        s = self.settings
        return s.budget == "preset" and s.eager > 1 and s.unbiased_fraction > 0

    @property
    def steps(self) -> int:
        """Return the largest number of gradient steps of the next frame.

        Returns:
            Number of steps, ≥ 1.
        """
        if self.still:
            return max(self.settings.steps, 2 * self.still_records // self.settings.batch)
        steps = min(self.most_steps or self.settings.steps, self.settings.steps)
        return steps * self.settings.eager if self.eager else steps

    def train_frame(self, scene: Any, sensor: Any, seed: int = 0) -> TrainingStats:
        """Train on one frame: trace training paths, take gradient steps, adapt scale and tiles.

        Args:
            scene: Mitsuba scene, as given to ``prepare``.
            sensor: Mitsuba sensor from which training paths start.
            seed: Seed of the image.

        Returns:
            Statistics of the frame.
        """
        stats = TrainingStats(frame=self.frame, scale=self.scale.value)
        if self.frozen or not self.settings.learns:
            return stats
        if self.level is not None:
            self.level = None
            self.touched()
        with dr.suspend_grad():
            start = time.perf_counter()
            traced = self._trace(scene, sensor, seed, stats)
            stats.seconds["trace"] = time.perf_counter() - start
            start = time.perf_counter()
            batch, steps = self._records(traced, seed, stats)
            stats.seconds["records"] = time.perf_counter() - start
        start = time.perf_counter()
        self._learn(batch, steps, stats)
        stats.seconds["train"] = time.perf_counter() - start
        self.frame += 1
        self.since_change += 1
        self.history.append(stats)
        return stats

    def _trace(self, scene, sensor, seed: int, stats: TrainingStats) -> TracedRecords:
        """Trace training paths and compute their targets and the bias estimate."""
        s = self.settings
        film = sensor.film()
        width, height = (int(x) for x in film.crop_size())
        self.picture, self.size = (width, height), self.controller(width, height)
        columns, rows, tile_w, tile_h = self.size.grid(width, height)
        self.grid = (columns, rows)
        u = self.unbiased_share
        shutter = (float(sensor.shutter_open()), float(sensor.shutter_open_time()))
        place = f"{sensor.class_name()} {film.size()} {film.crop_offset()}"
        # With a cache, the guide is trained with plain paths: guided ones take longer without benefit for the cache.
        table, guide = (self.guide_table if self.teaches else None), (None if s.caching else self.guide)
        shape = FrameShape(
            columns * rows, s.max_vertices, (width, height), shutter, choice_of(u), place, table is not None,
            guide is not None,
        )  # fmt: skip
        cells = mi.Vector3f(1) if table is None else table.opaque_cells
        self.replay.look(str(sensor.world_transform().matrix))
        numbers = FrameParameters(
            seed, self.frame, columns, (tile_w, tile_h), u, s.tail_attenuation, s.tail_after, s.replay, self.replay.held
        )
        tails = self.packed("raw" if s.bootstrap == "raw" else "ema")
        traced = frozen_frame(self.model, shape)(
            scene, sensor, self.around, tails, self.packed("ema"), numbers, self.replay.pool, cells, guide
        )
        self.replay.saw(traced.o, traced.d)
        self._watch_growth(float(traced.level[0]))
        if table is not None:
            table.add(*(np.array(x) for x in (traced.cell, traced.bin, traced.met, traced.reach, traced.whole)))
        stats.paths, stats.hits = shape.P, int(traced.hits[0])
        count, total, square = (float(x[0]) for x in traced.meter)
        stats.bias_paths = int(count)
        if count > 1:
            mean = total / count
            stats.bias = (mean, math.sqrt(max(square / count - mean**2, 0) / (count - 1)))
        return traced

    def settle(self) -> None:
        """Measure the local gain of a still with the records of its last training frames."""
        if not self._recent:
            return
        with dr.suspend_grad():
            sums, views = CellSums(len(self._recent)), self.packed("ema")[0]
            scale = dr.opaque(mi.Float, self.scale.value)
            for features, targets in self._recent:
                row = dr.arange(mi.UInt32, dr.width(targets) // 4)
                v, t = stored(features, row), dr.gather(mi.Vector4f, targets, row)
                traced, learned = self.model.target(dr.maximum(mi.Color3f(t.x, t.y, t.z), 0), v, scale)
                said = dr.select(learned > 0, dr.maximum(self.model.evaluate(views, v), 0), 0)
                sums.add(v, mi.luminance(traced), mi.luminance(said))
            self.level = sums.levels()
        self._recent.clear()
        self.touched()

    def _watch_growth(self, level: float) -> None:
        """Warn when predictions used as targets make the cache brighter without bound; not while it is untrained."""
        if self.since_change - self.begun < YOUNG:
            return
        if factor := self.growth.update(level):
            warnings.warn(
                f"nrc: the cache grew {factor:.1f} times brighter while the scene rested; its materials reflect up to "
                f"{self.materials.highest if self.materials else 1:.2f} of what they receive: set tail_attenuation=0.9",
                stacklevel=2,
            )

    @property
    def unbiased_share(self) -> float:
        """Return the share of the next frame's training paths that only Russian roulette ends.

        Returns:
            Share in [0, 1].
        """
        u = self.settings.still_unbiased if self.still else self.settings.unbiased_fraction
        if not self.settings.caching:
            return 1.0
        # The predictions of an untrained cache must not end paths.
        frames = self.settings.lead_in * (1 if self._larger else SMALL_FRAMES)
        return 1.0 if 0 < u and self.since_change - self.begun < frames else u

    def _records(self, traced: TracedRecords, seed: int, stats: TrainingStats):
        """Return shuffled batches on the device and the number of steps that they suffice for."""
        s = self.settings
        stats.records, stats.dropped = int(traced.count[0]), int(traced.dropped[0])
        self.size.update(stats.records, stats.paths, *self.picture)
        luminances = np.array(traced.luminance)
        if self.still:
            stats.noise = noise_of(luminances[:: s.max_vertices], *self.grid)
        if not s.caching:
            return None, 0
        self._calibrate(luminances, stats)
        steps = min(self.steps, -(-stats.records // s.batch))
        # A step with less than half a batch is omitted unless it is the only one.
        if steps > 1 and stats.records - (steps - 1) * s.batch < s.batch // 2:
            steps -= 1
        if steps == 0:
            return None, 0
        scale = dr.opaque(mi.Float, self.scale.value)
        order = dr.opaque(mi.UInt32, (seed * 7919 + self.frame) & 0xFFFFFFFF)
        slots = dr.width(traced.rows)
        if self.still and s.local_level:
            self._recent.append(_compact(traced, stats.records))
        pack = frozen_batches(self.model, steps * s.batch, max(1, (slots - 1).bit_length()))
        batch = Batch(*pack(traced.features, traced.targets, traced.rows, traced.count, order, scale))
        dr.eval(batch.direct, batch.points, batch.target, batch.weight)
        return batch, steps

    def _calibrate(self, luminances: np.ndarray, stats: TrainingStats) -> None:
        """Adapt the radiance scale and rescale the weights accordingly."""
        factor = self.scale.update(luminances[luminances >= 0])
        if factor != 1.0:
            self.learner.rescale(factor)
            self.touched()
        stats.scale = self.scale.value

    def _learn(self, batch, steps: int, stats: TrainingStats) -> None:
        boosted = BOOST if self.boost > 0 else 1.0
        self.boost = max(0, self.boost - 1)
        rate = self.settings.learning_rate * self.rate_factor * boosted
        said = [self.learner.train(batch, k * self.settings.batch, rate) for k in range(steps)]
        stats.steps = steps
        if steps:
            values = np.array([np.array(t).ravel() for t in said])
            self.touched()
            stats.loss, stats.residual = float(values[:, 0].mean()), float(values[:, 1].mean())
            self._guard(stats)
            if self.settings.on_change == "detect" and self.detector.update(stats.loss, stats.residual):
                stats.changed = True
                self.scene_changed("light")

    def _guard(self, stats: TrainingStats) -> None:
        """Keep a copy of finite weights, and restore it when the loss is not finite."""
        learner = self.learner
        if np.isfinite(stats.loss):
            if self.frame % SNAPSHOT == SNAPSHOT - 1:
                self.snapshot = (dict(learner.values), dict(learner.average), tuple(dict(m) for m in learner.moments))
        elif self.snapshot is not None:
            learner.values, learner.average, learner.moments = (
                dict(self.snapshot[0]), dict(self.snapshot[1]), tuple(dict(m) for m in self.snapshot[2]))  # fmt: skip
            self.rollbacks += 1
            self.touched()


def _compact(traced: TracedRecords, count: int) -> tuple[mi.Float, mi.Float]:
    """Gather the vertices [M * WIDTH] and targets [M * 4] of the M records of a frame."""
    row = dr.arange(mi.UInt32, count)
    of = dr.gather(mi.UInt32, traced.rows, row)
    features, targets = dr.empty(mi.Float, count * WIDTH), dr.empty(mi.Float, count * 4)
    stored(traced.features, of).store(features, row, mi.Bool(True))
    dr.scatter(targets, dr.gather(mi.Vector4f, traced.targets, of), row)
    dr.eval(features, targets)
    return features, targets


__all__ = ["WIDTH", "RadianceCache", "TrainingStats", "bounds_of"]
