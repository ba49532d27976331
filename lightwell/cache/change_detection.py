"""Detection of changes of the scene, from a fast and a slow statistic of the training loss and residual."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import Any

import numpy as np

# Frames of the fast and of the slow statistic; frames without a report after a change or a cold start.
FAST, SLOW, QUIET = 3, 60, 36
# A change is reported when the difference exceeds SIGMAS standard deviations and an absolute threshold (the mean output
# of the network is about 1; the loss is compared by its logarithm).
SIGMAS, RESIDUAL, LOG_LOSS = 4.5, 0.2, 0.7
# Share of the threshold for the mean of two frames that each of them must exceed.
CLEAR = 0.3


class ChangeDetector:
    """Detects changes of the scene by comparing the most recent frames with those before them."""

    def __init__(self) -> None:
        self._residuals: deque[float] = deque(maxlen=SLOW)
        self._losses: deque[float] = deque(maxlen=SLOW)
        self._frames = 0

    def reset(self) -> None:
        """Discard all statistics, after a change or when no change must be reported."""
        self._residuals.clear()
        self._losses.clear()
        self._frames = 0

    def state(self) -> dict[str, Any]:
        """Return the state that the next frame depends on.

        Returns:
            Dictionary of JSON types.
        """
        return {"residuals": list(self._residuals), "losses": list(self._losses), "frames": self._frames}

    def restore(self, state: dict[str, Any]) -> None:
        """Restore the state of a checkpoint.

        Args:
            state: Dictionary from ``state``.
        """
        self._residuals.extend(float(value) for value in state["residuals"])
        self._losses.extend(float(value) for value in state["losses"])
        self._frames = int(state["frames"])

    def update(self, loss: float, residual: float) -> bool:
        """Add the statistics of one frame.

        Args:
            loss: Mean loss before the gradient steps, ≥ 0.
            residual: Mean signed difference prediction − target before the steps, in units of the network.

        Returns:
            Whether the scene appears to have changed.
        """
        if not (math.isfinite(loss) and math.isfinite(residual)):
            return False
        self._frames += 1
        if self._frames <= QUIET // 2:
            return False  # The first residuals of an untrained cache do not measure the noise.
        self._residuals.append(residual)
        self._losses.append(math.log(max(loss, 1e-12)))
        if self._frames < QUIET:
            return False
        found = self._darkened() or self._jumped(self._residuals, RESIDUAL) or self._jumped(self._losses, LOG_LOSS)
        if found:
            self.reset()
        return found

    def _darkened(self) -> bool:
        """Detect light that was switched off.

        The prediction is too bright in two successive frames: clearly in their mean and to some extent in each (a cache
        with a high learning rate corrects most in the first). Noise cannot cause this, because targets are never
        negative. The test is needed because after two more frames the cache would have adapted unnoticed, slowly in the
        darkest places.
        """
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
        # All recent frames must agree in sign: a single bright record is not a change.
        agree = np.all(np.sign(new - np.median(old)) == np.sign(difference))
        noise = 1.4826 * np.median(np.abs(old - np.median(old)))
        return bool(agree and abs(difference) > max(least, SIGMAS * noise))


# Frames over which growth is measured, frames of one median, and the factor that is reported.
SPAN, FEW, TOO_MUCH = 64, 8, 1.5


class DivergenceMonitor:
    """Detects a cache whose own predictions, used as targets, make it brighter and brighter in an unchanged scene."""

    def __init__(self) -> None:
        self._levels: deque[float] = deque(maxlen=SPAN)

    def reset(self) -> None:
        """Discard all levels, after a change of the scene."""
        self._levels.clear()

    def state(self) -> list[float]:
        """Return the state that the next frame depends on.

        Returns:
            Mean radiances of the last frames.
        """
        return list(self._levels)

    def restore(self, state: list[float]) -> None:
        """Restore the state of a checkpoint.

        Args:
            state: List from ``state``.
        """
        self._levels.extend(float(level) for level in state)

    def update(self, level: float) -> float:
        """Add the mean prediction of one frame.

        Args:
            level: Mean radiance of the cache at the tails of training paths; values ≤ 0 or not finite are ignored.

        Returns:
            Factor by which the level grew when it exceeds ``TOO_MUCH`` and the growth was steady, else 0.
        """
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
