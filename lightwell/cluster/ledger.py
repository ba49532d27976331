"""Which worker and which unit of work failed how often, and what follows; it knows nothing of Dask."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

# A worker that fails so many different units is set aside; a unit that fails on so many workers ends the bake.
MOST_OF_WORKER, MOST_OF_UNIT = 3, 3


class UnitFailed(RuntimeError):
    """A unit of work failed on several workers; the text is its own error."""


@dataclass
class Ledger:
    """Failures so far."""

    units_of: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    """Worker -> units that failed there."""
    workers_of: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    """Unit -> workers on which it failed, once for each time."""
    deaths_of: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    """Unit -> how often a worker died while it computed it."""

    def failed(self, unit: str, worker: str, reason: str) -> bool:
        """Take note that a unit raised an error on a worker.

        Args:
            unit: Key of the unit.
            worker: Address of the worker.
            reason: The error.

        Returns:
            Whether the worker is set aside from now on.

        Raises:
            UnitFailed: The unit has failed on several workers.
        """
        self.units_of[worker].add(unit)
        self.workers_of[unit].append(worker)
        # On as many different workers, where there are so many: see ``avoided``.
        if len(self.workers_of[unit]) >= MOST_OF_UNIT:
            count = len(set(self.workers_of[unit]))
            raise UnitFailed(f"cluster: the same work failed {MOST_OF_UNIT} times on {count} workers: {reason}")
        return len(self.units_of[worker]) == MOST_OF_WORKER

    def died(self, unit: str) -> None:
        """Take note that workers died while they computed a unit, as often as Dask tries it.

        Args:
            unit: Key of the unit.

        Raises:
            UnitFailed: Too many have.
        """
        self.deaths_of[unit] += 1
        if self.deaths_of[unit] >= MOST_OF_UNIT:
            raise UnitFailed(
                "cluster: workers die of the same work again and again; look at their logs, most often memory runs out"
            )

    def set_aside(self, worker: str) -> bool:
        """Return whether a worker gets no more work.

        Args:
            worker: Address of the worker.

        Returns:
            True when it failed several different units.
        """
        return len(self.units_of.get(worker, ())) >= MOST_OF_WORKER

    def avoided(self, unit: str) -> set[str]:
        """Return the workers that should not get a unit again.

        Args:
            unit: Key of the unit.

        Returns:
            Addresses of workers on which it failed.
        """
        return set(self.workers_of.get(unit, ()))
