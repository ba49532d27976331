"""The radiance cache of one scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.cache import persist
from lightwell.cache.guide_training import GuideTraining
from lightwell.cache.predictor import Predictor
from lightwell.cache.scene_region import SceneRegion
from lightwell.cache.schedule import FrameSchedule
from lightwell.cache.settings import CacheSettings
from lightwell.cache.trainer import Trainer
from lightwell.cache.training_stats import TrainingStats

# Kinds of change of a scene.
KINDS = ("light", "material", "geometry", "camera")


class RadianceCache:
    """Neural radiance cache of one scene: predicts scattered radiance and is trained while the scene is rendered."""

    def __init__(self, settings: CacheSettings, box: np.ndarray | None = None) -> None:
        """Make an untrained cache.

        Args:
            settings: Settings.
            box: [2, 3] corners of the region that is learned, metres; None: the bounds of the scene.
        """
        self.settings = settings
        self.region = SceneRegion(settings.paths, box)
        """Box and materials of the scene."""
        self.predictor = Predictor(settings)
        """The network and its weights."""
        self.schedule = FrameSchedule(settings)
        """Number and size of the training frames."""
        self.guiding = GuideTraining(settings)
        """The guide and its training."""
        self.trainer = Trainer(settings, self.region, self.predictor, self.schedule, self.guiding)
        """Training, frame after frame."""
        self.changes = 0
        """Number of changes of the scene."""
        self.frozen = False
        """Whether training has stopped."""

    def prepare(self, scene: Any) -> None:
        """Read the bounds and the materials of a scene; to be called again when materials or geometry changed.

        Args:
            scene: Mitsuba scene.
        """
        self.guiding.prepare(self.region.prepare(scene))

    def scene_changed(self, kind: str, scene: Any | None = None) -> None:
        """React to a change of the scene.

        The average of the weights restarts, the learning rate is raised for some frames, and all training paths end by
        Russian roulette for some frames, so that new light does not have to propagate through outdated predictions.

        Args:
            kind: 'light', 'material', 'geometry' or 'camera'; the latter has no effect.
            scene: Mitsuba scene, whose materials or emitters are read again; None: neither has changed.

        Raises:
            ValueError: ``kind`` is none of these.
        """
        if kind not in KINDS:
            raise ValueError(f"nrc: scene_changed('{kind}'), expected one of {', '.join(KINDS)}")
        if kind == "camera":
            return
        if scene is not None and kind == "light":
            self.region.read_emitters(scene)
        elif scene is not None:
            self.prepare(scene)
        self.trainer.restart()
        self.changes += 1

    def freeze(self) -> None:
        """Stop training: the weights no longer change."""
        self.frozen = True

    def train_frame(self, scene: Any, sensor: Any, seed: int = 0) -> TrainingStats:
        """Train on one frame: trace training paths, take gradient steps, adapt scale and tiles.

        Args:
            scene: Mitsuba scene, as given to ``prepare``.
            sensor: Mitsuba sensor from which training paths start.
            seed: Seed of the image.

        Returns:
            Statistics of the frame.
        """
        if self.frozen or not self.settings.learns:
            return TrainingStats(frame=self.schedule.frame, scale=self.predictor.scale.value)
        stats = self.trainer.train(scene, sensor, seed)
        if stats.changed:
            self.scene_changed("light", scene)
        self.schedule.finish_frame()
        self.trainer.history.append(stats)
        return stats

    @property
    def history(self) -> Sequence[TrainingStats]:
        """Return the statistics of the last training frames.

        Returns:
            Up to 4,096 frames, oldest first.
        """
        return self.trainer.history

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
