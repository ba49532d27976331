"""Seconds of training at each step, summed over all runs of a bake."""

from __future__ import annotations

from time import perf_counter

import numpy as np


class Clock:
    """Records the time of steps."""

    def __init__(self, marks: np.ndarray | None = None) -> None:
        """Continue from the marks of an earlier run.

        Args:
            marks: [K, 2] step and seconds, the latest last; None: start at zero.

        Raises:
            ValueError: The marks are not rows of step and seconds.
        """
        stored = np.zeros((1, 2)) if marks is None else marks
        if stored.ndim != 2 or stored.shape[1] != 2 or not len(stored) or not np.isfinite(stored).all():
            raise ValueError("the clock is not rows of step and seconds")
        self.marks = [(int(step), float(seconds)) for step, seconds in stored]
        self._start = perf_counter() - self.marks[-1][1]

    @property
    def seconds(self) -> float:
        """Seconds up to now."""
        return perf_counter() - self._start

    def mark(self, step: int) -> None:
        """Record the time of a step.

        Args:
            step: Number of the step.
        """
        self.marks.append((step, round(self.seconds, 4)))

    def skip(self, seconds: float) -> None:
        """Leave out time in which nothing was trained.

        Args:
            seconds: Seconds, ≥ 0.
        """
        self._start += seconds

    def array(self) -> np.ndarray:
        """Return the marks of a checkpoint.

        Returns:
            [K, 2] float64 step and seconds.
        """
        return np.array(self.marks, np.float64)

    def at(self, step: float) -> float:
        """Interpolate the time of a step linearly.

        Args:
            step: Number of the step.

        Returns:
            Seconds of training.
        """
        before = max((mark for mark in self.marks if mark[0] <= step), default=self.marks[0])
        after = min((mark for mark in self.marks if mark[0] >= step), default=self.marks[-1])
        span = after[0] - before[0]
        return before[1] if span <= 0 else before[1] + (after[1] - before[1]) * (step - before[0]) / span
