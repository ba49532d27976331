"""How large the training frames of a cache are: paths, gradient steps, learning rate."""

from __future__ import annotations

import logging
from dataclasses import asdict
from typing import Any

from lightwell.cache.settings import CacheSettings
from lightwell.cache.tiles import FIRST, SLACK, Tiles

# Number of larger frames of an untrained cache, and factor of the lead-in where frames are not larger.
EAGER_FRAMES, SMALL_FRAMES = 8, 4
# Larger frames after a change of the scene; factor of the learning rate after one, and frames that have it.
REACTION, BOOST, BOOST_FRAMES = 4, 2.0, 6
# Frames in which a cache may grow brighter, because each can add a bounce of light; gradient steps, because frames of
# small pictures have few (32 x 32: one, and the cache grows for more than 48 + 64 frames).
YOUNG, YOUNG_STEPS = 48, 512
# Frames of training before a still: largest share of pixels, records, first side of the tiles, and their slack.
STILL_FRACTION, STILL_RECORDS, STILL_SIDE, STILL_SLACK = 1.0, 1 << 17, 2.0, 0.4
# The first frames before a still with a time limit find out whether training pays: their tiles are so many times wider.
PROBES, PROBE_SIDE = 2, 2.0
# budget=auto: training takes this share of a frame's time at most.
TRAINING_SHARE = 0.25
LOG = logging.getLogger("lightwell.cache")


class FrameSchedule:
    """Counts the frames and decides how large the next one is."""

    def __init__(self, settings: CacheSettings) -> None:
        """Start with an untrained cache.

        Args:
            settings: Settings of the cache.
        """
        self._settings = settings
        self.still = False
        """Whether training precedes a still; its frames are larger, because no image is displayed meanwhile."""
        self.frame = 0
        """Frames trained."""
        self.since_change = 0
        """Frames trained; reduced when the scene changes."""
        # Value of ``since_change`` after the last change; frames that still have a higher learning rate because of one.
        self._begun = self._boost = 0
        self.rate_factor = 1.0
        """Factor of the learning rate; decays while a still trains."""
        # budget=auto: largest number of gradient steps of a frame; 0: that of the settings.
        self._most_steps = 0
        self._tiles: dict[tuple[int, int, bool], Tiles] = {}

    def state(self) -> dict[str, Any]:
        """Return the state that the next frame depends on, beside ``frame`` and ``since_change``.

        Returns:
            Dictionary of JSON types.
        """
        tiles = [[list(key), asdict(tiles)] for key, tiles in self._tiles.items()]
        counters = {"boost": self._boost, "begun": self._begun, "rate_factor": self.rate_factor}
        return {"counters": counters | {"most_steps": self._most_steps}, "tiles": tiles}

    def restore(self, state: dict[str, Any]) -> None:
        """Restore the state of a checkpoint.

        Args:
            state: Dictionary from ``state``.
        """
        counters = state["counters"]
        self._boost, self._begun = int(counters["boost"]), int(counters["begun"])
        self.rate_factor, self._most_steps = float(counters["rate_factor"]), int(counters["most_steps"])
        self._tiles = {tuple(key): Tiles(**fields) for key, fields in state["tiles"]}

    def restart(self) -> None:
        """React to a change of the scene: some larger frames, and a higher learning rate for a while."""
        self.since_change = self._begun = min(self.since_change, EAGER_FRAMES - REACTION)
        self._boost = BOOST_FRAMES
        # Tiles of larger frames restart: their size fits paths that end early, and the next paths do not.
        self._tiles = {key: tiles for key, tiles in self._tiles.items() if not key[2]}

    def finish_frame(self) -> None:
        """Count a trained frame."""
        self.frame += 1
        self.since_change += 1

    @property
    def young(self) -> bool:
        """Return whether so few frames were trained since the last change that the cache may still grow brighter.

        Returns:
            True for the first ``YOUNG`` frames.
        """
        return self.since_change - self._begun < YOUNG

    def tiles_of(self, width: int, height: int) -> Tiles:
        """Return the tile controller of an image size.

        Args:
            width: Image width, pixels.
            height: Image height, pixels.

        Returns:
            The controller, with the number of records of the next frame as its target.
        """
        large = self.still or self.eager
        if self.still and self.frame < PROBES and self._settings.caching and self._settings.image.seconds > 0:
            return Tiles(STILL_RECORDS, STILL_FRACTION, PROBE_SIDE * STILL_SIDE, STILL_SLACK)
        key = (width, height, large)
        if key not in self._tiles:
            fraction = self._settings.training.train_fraction_max
            fraction = max(fraction, STILL_FRACTION) if large else fraction
            side, slack = (STILL_SIDE, STILL_SLACK) if large else (FIRST, SLACK)
            self._tiles[key] = Tiles(1, fraction, side, slack)
        self._tiles[key].target = STILL_RECORDS if self.still else self._settings.training.batch * self.steps
        return self._tiles[key]

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
        s = self._settings.training
        return s.budget == "preset" and s.eager > 1 and self._settings.paths.unbiased_fraction > 0

    @property
    def steps(self) -> int:
        """Return the largest number of gradient steps of the next frame.

        Returns:
            Number of steps, ≥ 1.
        """
        s = self._settings.training
        if self.still:
            return max(s.steps, 2 * STILL_RECORDS // s.batch)
        steps = min(self._most_steps or s.steps, s.steps)
        return steps * s.eager if self.eager else steps

    @property
    def unbiased_share(self) -> float:
        """Return the share of the next frame's training paths that only Russian roulette ends.

        Returns:
            Share in [0, 1].
        """
        paths = self._settings.paths
        u = paths.still_unbiased if self.still else paths.unbiased_fraction
        if not self._settings.caching:
            return 1.0
        # The predictions of an untrained cache must not end paths.
        frames = self._settings.training.lead_in * (1 if self._larger else SMALL_FRAMES)
        return 1.0 if 0 < u and self.since_change - self._begun < frames else u

    def balance(self, training: float, frame: float) -> None:
        """Limit training to ``TRAINING_SHARE`` of the frame time (budget=auto), by the number of gradient steps.

        Args:
            training: Time of the last frame's training, seconds.
            frame: Time of the whole frame, seconds.
        """
        most = self._settings.training.steps
        now, share = self._most_steps or most, training / max(frame, 1e-9)
        wanted = now - 1 if share > TRAINING_SHARE else now + 1 if share < 0.7 * TRAINING_SHARE else now
        wanted = min(max(wanted, 1), most)
        if wanted != now:
            LOG.info("nrc: training takes %.0f %% of a frame; %d steps from now on", 100 * share, wanted)
        self._most_steps = wanted

    def next_rate(self) -> float:
        """Return the learning rate of the next frame; a frame of the boost is used up.

        Returns:
            Step size of the optimiser, > 0.
        """
        boosted = BOOST if self._boost > 0 else 1.0
        self._boost = max(0, self._boost - 1)
        return self._settings.training.learning_rate * self.rate_factor * boosted


def skip_cold_start(schedule: FrameSchedule) -> None:
    """Treat a cache as trained: no larger frames, and no lead-in of plain paths.

    Args:
        schedule: Schedule of the cache.
    """
    schedule.since_change = max(schedule.since_change, EAGER_FRAMES)
