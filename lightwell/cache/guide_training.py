"""When the guide of a cache is trained, and when it is used."""

from __future__ import annotations

import numpy as np

from lightwell.cache.guide import Guide
from lightwell.cache.guide_table import GuideTable
from lightwell.cache.settings import CacheSettings

# Frames of a still with a cache whose records are added to the guide: more would take time from the cache.
LESSONS = 8
# Images whose paths have less relative variance than this gain nothing from a guide (measured: Cornell box 0.9,
# veach-ajar 6).
CALM = 3.0
# The same of stills without a cache, where the guide has to pay for its training alone (measured at 96^2: staircase2 at
# 3.05 loses, veach-bidir at 4.2 gains nothing, veach-ajar at 7 gains; at 256^2, hello-webxr-hall at 5.1: passes are
# 1.03 to 1.13 times as good, and the comparison takes a tenth of the time).
CALM_UNBIASED = 5.5


class GuideTraining:
    """The guide of a cache, if it has one."""

    def __init__(self, settings: CacheSettings) -> None:
        """Make no table yet.

        Args:
            settings: Settings of the cache.
        """
        self.settings = settings
        self.table: GuideTable | None = None
        """Training data of the guide; made by ``prepare`` where the settings enable a guide."""
        self.allowed = False
        """guide=auto: whether the still has enough samples to try a guide."""
        self.calm = CALM if settings.caching else CALM_UNBIASED
        """guide=auto: relative variance of a path below which no guide is trained."""

    def prepare(self, box: np.ndarray) -> None:
        """Make the table, where the settings enable a guide and there is none.

        Args:
            box: [2, 3] corners of the scene's box, metres.
        """
        if self.settings.guided and self.table is None:
            self.table = GuideTable(box, self.settings.guiding.guide_share)

    @property
    def guide(self) -> Guide | None:
        """Return the guide.

        Returns:
            Table of the guide; None when it is disabled or has no data yet.
        """
        return None if self.table is None or not len(self.table.keys) else self.table.guide()

    def next_table(self, still: bool, noise: float) -> GuideTable | None:
        """Return the table that the records of the next frame train.

        Without a cache they always do; with a cache in the first frames of a still; with guide=auto only where the
        previous frame was noisy and the image has enough samples for a pilot.

        Args:
            still: Whether the training precedes a still.
            noise: Relative variance of a path in the previous frame; NaN: unknown.

        Returns:
            The table; None when they do not.
        """
        table = self.table
        if table is None or not self.settings.caching:
            return table
        if self.settings.guiding.guide == "always":
            teaches = not still or table.frames < LESSONS
        else:
            begun = noise >= self.calm or table.frames > 0
            teaches = still and self.allowed and table.frames < LESSONS and begun
        return table if teaches else None

    def settle(self) -> None:
        """Let the guide hold all records; to be called when training ends."""
        if self.table is not None:
            self.table.made = None

    def forget(self) -> None:
        """Reduce the weight of the training data after a change of the scene."""
        if self.table is not None:
            self.table.forget()
