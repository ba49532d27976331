"""Learning rates as functions of the progress of a training. Each takes (rate, progress, epoch, tau)."""

from __future__ import annotations

import math
from collections.abc import Callable

# τ of the report's text, in epochs.
REPORT_TAU = 50.0


def constant(rate: float, progress: float, epoch: float, tau: float = REPORT_TAU) -> float:
    """Return the same rate throughout.

    Args:
        rate: Initial rate.
        progress: Not used.
        epoch: Not used.
        tau: Not used.

    Returns:
        ``rate``.
    """
    return rate


def cosine(rate: float, progress: float, epoch: float, tau: float = REPORT_TAU) -> float:
    """Decrease the rate to a hundredth along half a cosine.

    Args:
        rate: Initial rate.
        progress: Share of the steps done, in [0, 1].
        epoch: Not used.
        tau: Not used.

    Returns:
        The rate at this progress.
    """
    floor = 0.01 * rate
    return floor + 0.5 * (rate - floor) * (1 + math.cos(math.pi * min(max(progress, 0.0), 1.0)))


def report(rate: float, progress: float, epoch: float, tau: float = REPORT_TAU) -> float:
    """Decrease the rate as the 2013 report on mixtures of experts does: μ0 τ / (τ + e).

    Args:
        rate: Initial rate μ0.
        progress: Not used.
        epoch: e, in epochs; may be an array.
        tau: τ, epochs after which the rate is halved.

    Returns:
        The rate in this epoch.
    """
    return rate * tau / (tau + epoch)


SCHEDULES: dict[str, Callable[..., float]] = {
    "constant": constant,
    "cosine": cosine,
    "report": report,
}
