"""Radiance scale: a power of two that brings the targets of the network to order one."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

# Share of the brightest records that is left out of the mean; decay of the running mean; frames in which the scale must
# differ from the ideal one by more than FACTOR before it changes.
TRIM, MEMORY, PATIENCE, FACTOR = 0.005, 0.8, 8, 2.0


class RadianceScale:
    """Tracks the mean luminance m of the targets and keeps the scale near 1 / m."""

    def __init__(self, manual: float = 0.0) -> None:
        """Start at a fixed or an automatic scale.

        Args:
            manual: Fixed scale, > 0; 0: automatic.
        """
        self.manual = manual > 0
        self.value = manual if self.manual else 1.0
        """Network output per unit of radiance."""
        self.mean = 1.0
        """Running mean of the luminance of targets, in units of radiance."""
        self.started = False
        """Whether a frame with light has been added."""
        self._off: deque[bool] = deque(maxlen=PATIENCE)

    def state(self) -> dict[str, Any]:
        """Return the state that the next frame depends on, beside ``value`` and ``mean``.

        Returns:
            Dictionary of JSON types.
        """
        return {"started": self.started, "off": list(self._off)}

    def restore(self, state: dict[str, Any]) -> None:
        """Restore the state of a checkpoint.

        Args:
            state: Dictionary from ``state``.
        """
        self.started = bool(state["started"])
        self._off.extend(bool(off) for off in state["off"])

    def update(self, luminances: np.ndarray) -> float:
        """Add the targets of one frame.

        Args:
            luminances: [N] luminances, ≥ 0; values that are not finite are ignored.

        Returns:
            Factor by which the scale changed, in most frames 1.
        """
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
        # The first frame sets the scale at once: the weights are untrained, and no visible jump can result.
        if not self.started or (len(self._off) == PATIENCE and all(self._off)):
            self.started = True
            factor, self.value = ideal / self.value, ideal
            self._off.clear()
            return factor
        return 1.0
