"""The budget of a bake: a quality, a time, or an error to reach."""

from __future__ import annotations

from dataclasses import dataclass

from lightwell.core.units import SECONDS, quantity

# Wall seconds of a whole bake on two cores, by quality. A field maps each name to sizes of its own.
QUALITY_SECONDS = {"draft": 30.0, "good": 180.0, "best": 1200.0}
DEFAULT_QUALITY, BEST = "good", "best"
# An error budget works in rounds of this many seconds of tracing and training until the goal is met ...
ROUND_SECONDS = 60.0
# ... or this many rounds have passed.
MOST_ROUNDS = 20
# Share of the wall time that scoring, pictures and writing are given, within these bounds in seconds.
SCORING_SHARE, SCORING_LEAST, SCORING_MOST = 0.32, 10.0, 240.0
# Tracing and training get at least this share of the budget, however long loading took.
LEAST_LEARNING_SHARE = 0.2
# Share of tracing in the time before scoring, for the estimate that is printed at the start.
TRACING_SHARE = 0.65


@dataclass(frozen=True)
class Budget:
    """The wall seconds of a whole bake, or a relative error to reach on held-out samples; neither: the seconds of the
    quality.
    """

    seconds: float | None = None
    """Seconds, > 0; None: ``error`` decides."""
    error: float | None = None
    """Mean relative error, 0.05 for 5 %."""
    rounds: int = MOST_ROUNDS
    """Most rounds of work towards ``error``."""

    @staticmethod
    def parse(text: str) -> Budget:
        """Read a budget from text.

        Args:
            text: A time like ``60s``, ``5m`` or ``1h``, or a relative error like ``5%``. Anything else is a
                ``ValueError``.

        Returns:
            The budget.
        """
        value = quantity(text, SECONDS | {"%": 0.01}, "a time or an error; write 60s, 5m, 1h or 5%")
        return Budget(None, value) if "%" in text else Budget(value)

    def or_of(self, quality: str) -> Budget:
        """Complete a budget that asks for neither a time nor an error.

        Args:
            quality: One of ``QUALITY_SECONDS``.

        Returns:
            This budget, or one of the seconds of the quality.
        """
        return self if self.seconds or self.error else Budget(QUALITY_SECONDS[quality])

    @property
    def round_seconds(self) -> float:
        """Seconds of the first (or only) round."""
        return self.seconds if self.seconds else ROUND_SECONDS


def scoring_seconds(seconds: float) -> float:
    """Compute the share of a budget that is kept for scoring, pictures and writing.

    Args:
        seconds: Wall seconds of the whole bake.

    Returns:
        Seconds.
    """
    return min(max(SCORING_SHARE * seconds, SCORING_LEAST), SCORING_MOST)


def learning_end(seconds: float, elapsed: float) -> float:
    """Compute when tracing and training should end.

    Args:
        seconds: Wall seconds of the whole bake.
        elapsed: Wall seconds that have passed when they start.

    Returns:
        Wall seconds after the start of the bake.
    """
    return max(seconds - scoring_seconds(seconds), elapsed + LEAST_LEARNING_SHARE * seconds)


def learning_seconds(budget: Budget, elapsed: float) -> float:
    """Compute the time of tracing and training.

    Args:
        budget: Budget of the bake.
        elapsed: Wall seconds that have passed when they start.

    Returns:
        Seconds, of the first round where the budget is an error.
    """
    return learning_end(budget.seconds, elapsed) - elapsed if budget.seconds else budget.round_seconds


def estimate(budget: Budget) -> str:
    """Say in one line how long a bake will take.

    Args:
        budget: Its budget.

    Returns:
        The line; empty without a time.
    """
    if budget.seconds is None:
        return ""
    scoring = scoring_seconds(budget.seconds)
    tracing = TRACING_SHARE * (budget.seconds - scoring)
    training = budget.seconds - scoring - tracing
    parts = ((tracing, "tracing"), (training, "training"), (scoring, "scoring"))
    return f"about {_rounded(budget.seconds)}: " + ", ".join(f"{_rounded(s)} {what}" for s, what in parts)


def _rounded(seconds: float) -> str:
    if seconds < 100:
        return f"{max(round(seconds / 5) * 5, 5)} s" if seconds >= 10 else f"{max(round(seconds), 1)} s"
    return f"{seconds / 60:.2g} min"
