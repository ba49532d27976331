"""The radiance scale, a power of two that brings what the network learns to order one."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

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

    def state(self) -> dict[str, Any]:
        """What the next frame depends on beside ``value`` and ``mean``, in types of JSON."""
        return {"started": self.started, "off": list(self._off)}

    def restore(self, state: dict[str, Any]) -> None:
        """Take over what ``state`` gave."""
        self.started = bool(state["started"])
        self._off.extend(bool(off) for off in state["off"])

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
