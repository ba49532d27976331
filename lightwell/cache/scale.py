"""The radiance scale, a power of two that brings what the network learns to order one; and the level of a still."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

# Brightest records left out of the mean; memory of the mean; frames that the ideal must be off by more than a factor.
TRIM, MEMORY, PATIENCE, FACTOR = 0.005, 0.8, 8, 2.0


class RadianceScale:
    """Tracks the mean luminance m of the targets and keeps the scale near 1 / m."""

    def __init__(self, manual: float = 0.0) -> None:
        self.manual = manual > 0
        self.value = manual if self.manual else 1.0
        """Radiance times this is what the network says."""
        self.mean = 1.0
        """Running mean of the luminance of targets, radiance."""
        self.started = False
        self._off: deque[bool] = deque(maxlen=PATIENCE)

    def update(self, luminances: np.ndarray) -> float:
        """Take in one frame's luminances [N]; returns the factor by which the scale changed, mostly 1."""
        luminances = luminances[np.isfinite(luminances)]
        if not len(luminances):
            return 1.0
        kept = len(luminances) - int(TRIM * len(luminances))
        mean = float(np.partition(luminances, kept - 1)[:kept].mean())
        if mean <= 0:
            return 1.0
        self.mean = mean if not self.started else MEMORY * self.mean + (1 - MEMORY) * mean
        if self.manual:
            self.started = True
            return 1.0
        ideal = 2.0 ** round(math.log2(1 / self.mean))
        self._off.append(not 1 / FACTOR <= ideal / self.value <= FACTOR)
        # The first frame sets the scale at once: nothing has been learned yet that could jump.
        if not self.started or (len(self._off) == PATIENCE and all(self._off)):
            self.started = True
            factor, self.value = ideal / self.value, ideal
            self._off.clear()
            return factor
        return 1.0


# Frames over which light is compared, and relative noise from which on less of a difference is believed.
LEVEL_FRAMES = 3
# A factor beyond this is no correction.
LEVEL_MOST = 2.0


class Level:
    """How much brighter the traced light of a picture is than what the cache says of it, as one factor.

    Rare bright records, capped so that they do not ruin the fit, carry a share of the light; and Adam, which divides by
    the root of the mean square, follows the many dark ones first. The cache comes out too dark, by about the same share
    everywhere. Training paths that end by roulette tell how much.
    """

    def __init__(self) -> None:
        self.count, self.traced, self.cached, self.square = 0.0, 0.0, 0.0, 0.0
        """Paths, and sums of prefix * traced, prefix * network, and the square of their difference."""

    def reset(self) -> None:
        """Begin anew: the light is another."""
        self.__init__()

    def update(self, count: float, traced: float, cached: float, square: float) -> None:
        """Take in one frame; the network's values are those without this factor."""
        if not all(math.isfinite(x) for x in (count, traced, cached, square)):
            return
        memory = 1 - 1 / LEVEL_FRAMES
        self.count, self.traced = memory * self.count + count, memory * self.traced + traced
        self.cached, self.square = memory * self.cached + cached, memory * self.square + square

    @property
    def factor(self) -> float:
        """Shrunk towards 1 by what of it may be noise."""
        if self.count < 2 or not (self.cached > 0 and self.traced > 0):
            return 1.0
        off = self.traced / self.cached - 1
        noise = self.square / self.cached**2
        return min(max(1 + off * off**2 / (off**2 + noise), 1 / LEVEL_MOST), LEVEL_MOST)
