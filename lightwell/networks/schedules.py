"""Learning rates as functions of how far the training is."""

from __future__ import annotations

import math
from collections.abc import Callable


def constant(rate: float, progress: float, epoch: float) -> float:
    """The same rate throughout."""
    return rate


def cosine(rate: float, progress: float, epoch: float) -> float:
    """From ``rate`` down to ``rate / 100`` along half a cosine; progress in [0, 1]."""
    floor = 0.01 * rate
    return floor + 0.5 * (rate - floor) * (1 + math.cos(math.pi * min(max(progress, 0.0), 1.0)))


# τ of the report's schedule, in epochs.
REPORT_TAU = 50.0


def report(rate: float, progress: float, epoch: float) -> float:
    """μ_e = μ0 τ / (τ + e) with e in epochs (the report on mixtures of experts, 2013)."""
    return rate * REPORT_TAU / (REPORT_TAU + epoch)


SCHEDULES: dict[str, Callable[[float, float, float], float]] = {
    "constant": constant,
    "cosine": cosine,
    "report": report,
}
