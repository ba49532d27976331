"""The budget of a field: a time, or an error to reach."""

from __future__ import annotations

from dataclasses import dataclass

from lightwell.core.units import SECONDS, quantity

# Seconds of tracing and training when nothing else is asked for: good on two cores.
DEFAULT_SECONDS = 120.0
# An error budget works in rounds of this many seconds until the goal is met ...
ROUND_SECONDS = 60.0
# ... or this many rounds have passed.
MOST_ROUNDS = 20


@dataclass(frozen=True)
class Budget:
    """Either seconds of tracing and training, or a relative error to reach on held-out samples."""

    seconds: float | None = DEFAULT_SECONDS
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

    @property
    def round_seconds(self) -> float:
        """Seconds of the first (or only) round."""
        return self.seconds if self.seconds else ROUND_SECONDS
