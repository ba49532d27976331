"""Has the scene changed? A fast and a slow mean of what training says before its steps."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import Any

import numpy as np

# Frames of the fast and of the slow mean; frames without an alarm after a change or a cold start.
FAST, SLOW, QUIET = 3, 60, 36
# An alarm needs both so many standard deviations and a change that matters (mean output is about 1; loss: logarithm).
SIGMAS, RESIDUAL, LOG_LOSS = 4.5, 0.2, 0.7
# Share of what two frames must show in the mean that each of them must show.
CLEAR = 0.3


class ChangeDetector:
    """Compares the last frames with those before them."""

    def __init__(self) -> None:
        self._residuals: deque[float] = deque(maxlen=SLOW)
        self._losses: deque[float] = deque(maxlen=SLOW)
        self._frames = 0

    def reset(self) -> None:
        """Begin anew: after a change, or when none must be found."""
        self.__init__()

    def state(self) -> dict[str, Any]:
        """What the next frame depends on, in types of JSON."""
        return {"residuals": list(self._residuals), "losses": list(self._losses), "frames": self._frames}

    def restore(self, state: dict[str, Any]) -> None:
        """Take over what ``state`` gave."""
        self._residuals.extend(float(value) for value in state["residuals"])
        self._losses.extend(float(value) for value in state["losses"])
        self._frames = int(state["frames"])

    def update(self, loss: float, residual: float) -> bool:
        """Take in one frame's pre-step loss and signed residual; says whether the scene seems to have changed."""
        if not (math.isfinite(loss) and math.isfinite(residual)):
            return False
        self._frames += 1
        if self._frames <= QUIET // 2:
            return False  # What a cold cache says of its first frames is no measure of the noise.
        self._residuals.append(residual)
        self._losses.append(math.log(max(loss, 1e-12)))
        if self._frames < QUIET:
            return False
        found = self._darkened() or self._jumped(self._residuals, RESIDUAL) or self._jumped(self._losses, LOG_LOSS)
        if found:
            self.reset()
        return found

    def _darkened(self) -> bool:
        """Light went: the cache is too bright two frames running, by so much in the mean, and in both clearly (a cache
        that follows fast has learned most in the first). Noise cannot do that, for targets are never below zero; and
        after two more frames it would have learned the dark by itself, slowly where it is darkest."""
        numbers = np.array(self._residuals)
        old = numbers[:-2]
        noise = 1.4826 * np.median(np.abs(old - np.median(old)))
        least = max(0.5 * RESIDUAL, 1.5 * SIGMAS * noise)
        new = numbers[-2:] - np.median(old)
        return bool(new.mean() > 1.5 * least and new.min() > CLEAR * least) or bool(new.min() > least)

    @staticmethod
    def _jumped(values: deque[float], least: float) -> bool:
        numbers = np.array(values)
        old, new = numbers[:-FAST], numbers[-FAST:]
        difference = np.median(new) - np.median(old)
        # All recent frames must agree: one bright record is no change.
        agree = np.all(np.sign(new - np.median(old)) == np.sign(difference))
        noise = 1.4826 * np.median(np.abs(old - np.median(old)))
        return bool(agree and abs(difference) > max(least, SIGMAS * noise))


# Frames between which growth is looked for, frames of one mean, and the factor that is too much.
SPAN, FEW, TOO_MUCH = 64, 8, 1.5


class GrowthWatch:
    """Does a cache that feeds on itself brighten without bound, though nothing in the scene changes?"""

    def __init__(self) -> None:
        self._levels: deque[float] = deque(maxlen=SPAN)

    def reset(self) -> None:
        """Begin anew: after a change."""
        self._levels.clear()

    def state(self) -> list[float]:
        """What the next frame depends on."""
        return list(self._levels)

    def restore(self, state: list[float]) -> None:
        """Take over what ``state`` gave."""
        self._levels.extend(float(level) for level in state)

    def update(self, level: float) -> float:
        """Take in one frame's mean radiance of the cache; returns the growth factor where it is too much, else 0."""
        if not math.isfinite(level) or level <= 0:
            return 0.0
        self._levels.append(level)
        if len(self._levels) < SPAN:
            return 0.0
        numbers = np.array(self._levels)
        parts = [float(np.median(part)) for part in np.split(numbers, SPAN // FEW)]
        steady = sum(b > a for a, b in pairwise(parts)) >= len(parts) - 2
        factor = parts[-1] / parts[0]
        if not steady or factor < TOO_MUCH:
            return 0.0
        self.reset()
        return factor
