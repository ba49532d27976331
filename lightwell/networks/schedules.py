"""Learning rates as functions of how far the training is. Each takes (rate, progress, epoch, tau)."""

from __future__ import annotations

import math
from collections.abc import Callable

# τ of the report's text, in epochs.
REPORT_TAU = 50.0


def constant(rate: float, progress: float, epoch: float, tau: float = REPORT_TAU) -> float:
    """The same rate throughout."""
    return rate


def cosine(rate: float, progress: float, epoch: float, tau: float = REPORT_TAU) -> float:
    """From ``rate`` down to ``rate / 100`` along half a cosine; progress in [0, 1]."""
    floor = 0.01 * rate
    return floor + 0.5 * (rate - floor) * (1 + math.cos(math.pi * min(max(progress, 0.0), 1.0)))


def report(rate: float, progress: float, epoch: float, tau: float = REPORT_TAU) -> float:
    """μ_e = μ0 τ / (τ + e) with e in epochs (the report on mixtures of experts, 2013); e may be an array."""
    return rate * tau / (tau + epoch)


SCHEDULES: dict[str, Callable[..., float]] = {
    "constant": constant,
    "cosine": cosine,
    "report": report,
}
