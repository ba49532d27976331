"""Seconds of training at each step, summed over all runs of a bake."""

from __future__ import annotations

import json
from pathlib import Path
from time import perf_counter

from lightwell.core.json_files import read_json
from lightwell.files import write_atomically


class Clock:
    """Records the time of steps, in a file beside the checkpoint."""

    def __init__(self, path: Path | None = None) -> None:
        """Continue from the times in a file.

        Args:
            path: File of the times; None: they are not stored.
        """
        self._path = path
        stored = (read_json(path, list) if path is not None else None) or [(0, 0.0)]
        self.marks: list[tuple[int, float]] = [(step, seconds) for step, seconds in stored]
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

    def save(self) -> None:
        """Write the marks."""
        if self._path:
            write_atomically(self._path, json.dumps(self.marks))

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
