"""Rows of a scene on the workers of a Dask cluster; see ``lightwell.scenes.executor``.

Rows are cut into units of work whose results are files of the store, named by a hash of everything that they are made
from. What the store has is not computed again: a lost worker costs what it was computing, a lost scheduler the same.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future as Written
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from distributed import Client, Future

from lightwell.cluster import worker as remote
from lightwell.cluster.ledger import Ledger, UnitFailed
from lightwell.cluster.roster import Roster
from lightwell.cluster.work import Order, Work, array_names, inputs_digest, recipe_name
from lightwell.core.formats import ARRAYS
from lightwell.core.keys import Key, key
from lightwell.core.store import Store
from lightwell.scenes.executor import Arrays, Recipe
from lightwell.scenes.scene import Scene
from lightwell.transport.row_tasks import TASKS

# Paths of a unit, and the fewest paths that are worth sending at all.
UNIT_LANES, LEAST_LANES = 1 << 20, 1 << 17
# Units on their way, as a multiple of the workers' threads.
BACKLOG = 2
# Seconds between two looks at the workers and at results, until a result must have come, and until a lost scheduler
# must be back.
LOOK, POLL, FETCH, BACK = 2.0, 0.01, 120.0, 120.0
# Errors of a connection.
LOST = (OSError, TimeoutError, asyncio.TimeoutError, asyncio.CancelledError)
# Seconds between two lines about work that takes long.
TELL = 30.0
# Calls whose arrays stay on the cluster.
MOST_SCATTERED = 4


@dataclass
class Call:
    """What the units of a call have in common."""

    task: str
    settings: Mapping[str, Any]
    shared: Arrays
    shared_names: dict[str, str]
    """``array_names`` of the shared arrays."""
    recipe: Recipe | None
    """How workers make the rows; None: they are sent. Where a worker makes other ones it becomes None."""
    name: str = ""
    """``recipe_name`` of the recipe, once it was chosen."""
    array_names: dict[str, str] = field(default_factory=dict)
    """``array_names`` of its arrays."""


@dataclass(frozen=True)
class Unit:
    """Some rows."""

    first: int
    columns: Arrays
    key: Key
    digest: str
    """Digest of its inputs, as ``inputs_digest``."""

    @property
    def name(self) -> str:
        """Name of the unit on the cluster."""
        return f"lightwell-{self.key.digest}"


@dataclass(frozen=True)
class Flight:
    """A unit that was sent."""

    unit: Unit
    future: Future
    workers: frozenset[str]
    """Workers that may compute it."""


@dataclass
class Moved:
    """What has been computed and sent so far."""

    units: int = 0
    from_store: int = 0
    bytes_sent: int = 0
    """Units, and arrays that every worker gets once."""
    bytes_received: int = 0
    again: int = 0
    """Units that were sent again after a failure or a loss."""


@dataclass
class DaskExecutor:
    """Runs units on the workers of a cluster; use ``connect.connected`` to make one."""

    scene: Scene
    roster: Roster
    connect: Callable[[], Client]
    """Makes a client of the same cluster anew, after its scheduler was lost."""
    store: Store
    say: Callable[[str], None]
    ledger: Ledger = field(default_factory=Ledger)
    moved: Moved = field(default_factory=Moved)
    unit_lanes: int = UNIT_LANES
    least_lanes: int = LEAST_LANES
    stores: bool = True
    """Whether results are stored; False after the store could not be written."""
    near: bool = False
    """Whether all workers are on this machine: rows are then sent, which takes less time than making them again."""
    _sends: int = 0
    # Arrays on the cluster, by digest, the last used ones.
    _scattered: dict[str, Future] = field(default_factory=dict)
    # When something was said last, and the units until then.
    _told: float = 0.0
    _before: int = 0

    def rows(
        self,
        task: str,
        settings: Mapping[str, Any],
        columns: Arrays,
        lanes: int,
        shared: Arrays | None = None,
        recipe: Recipe | None = None,
    ) -> Arrays:
        """Compute the results of all rows; see ``RowExecutor.rows``.

        Args:
            task: Name of the function.
            settings: Its settings.
            columns: Inputs of N rows, [N, ...] by name.
            lanes: Paths of a row.
            shared: Arrays [...] that all rows share.
            recipe: Makes ``columns`` and ``shared`` on workers.

        Returns:
            Results [N, ...] by name.
        """
        count = len(next(iter(columns.values())))
        if count * lanes < self.least_lanes:
            return TASKS[task](self.scene, settings, columns, 0, shared or {})
        call = Call(task, settings, shared or {}, array_names(shared or {}), None if self.near else recipe)
        units = self._units(call, columns, lanes)
        found: dict[int, Arrays] = {}
        missing = []
        for unit in units:
            kept = self.store.find(unit.key, ARRAYS)
            if kept is None:
                missing.append(unit)
            else:
                found[unit.first] = kept
        self.moved.from_store += len(found)
        if missing:
            found |= self._computed(call, missing)
        parts = [found[unit.first] for unit in units]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _units(self, call: Call, columns: Arrays, lanes: int) -> list[Unit]:
        """Cut rows into units; the cuts depend on the rows alone, so that the store serves every cluster."""
        size, count = max(1, self.unit_lanes // max(lanes, 1)), len(next(iter(columns.values())))
        common = {name: words.split()[-1] for name, words in call.shared_names.items()}
        about = {"scene": self.scene.digest, "settings": call.settings, "shared": common}
        function, units = (f"rows.{call.task}", TASKS[call.task].version), []
        for first in range(0, count, size):
            part = {name: np.ascontiguousarray(value[first : first + size]) for name, value in columns.items()}
            of = key(*function, first=first, rows=part, **about)
            units.append(Unit(first, part, of, inputs_digest(part, call.shared_names)))
        return units

    def _choose(self, call: Call, units: Sequence[Unit]) -> None:
        """Send rows in place of the arrays of a recipe where those are larger."""
        if call.recipe is None or call.name:
            return
        call.name, call.array_names = recipe_name(call.recipe), array_names(call.recipe.arrays)
        more = (_nbytes(call.recipe.arrays) - _nbytes(call.shared)) * len(self.roster.workers())
        there = str(call.array_names) in self._scattered
        if not there and more > sum(_nbytes(unit.columns) for unit in units) * call.recipe.calls:
            call.recipe = None

    # ------------------------------------------------------------------ the cluster

    def _computed(self, call: Call, units: Sequence[Unit]) -> dict[int, Arrays]:
        """Compute units; by the number of their first row."""
        with ThreadPoolExecutor(1) as writer:
            found, written = dict[int, Arrays](), list[Written[None]]()

            def take(unit: Unit, result: Arrays) -> None:
                # Workers go on while results are written to the disk.
                found[unit.first] = result
                written.append(writer.submit(self._keep, unit, result))

            self._rounds(call, deque(units), take)
            for done in written:
                done.result()
        return found

    def _rounds(self, call: Call, waiting: deque[Unit], take: Callable[[Unit, Arrays], None]) -> None:
        """Compute units until none is waiting, with another connection where one is lost."""
        while waiting:
            try:
                self._round(call, waiting, take)
            except UnitFailed:
                raise
            except (Exception, asyncio.CancelledError) as error:
                # Clients raise all kinds of errors when their scheduler is gone; others are those of the work.
                if not isinstance(error, LOST) and self.roster.client.status == "running":
                    raise
                # Results so far are files; what was on its way is in ``waiting`` again.
                self._reconnect(error)

    def _round(self, call: Call, waiting: deque[Unit], take: Callable[[Unit, Arrays], None]) -> None:
        """Send units and take results until all are there, or until the scheduler is lost."""
        client, flying, done = self.roster.client, dict[str, Flight](), 0
        self._choose(call, waiting)
        try:
            while waiting or flying:
                while waiting and len(flying) < BACKLOG * self.roster.threads():
                    # A unit leaves one list when it is in the other: either step may lose the scheduler.
                    flying[waiting[0].name] = self._sent(client, call, waiting[0])
                    waiting.popleft()
                for name in self._landed(flying):
                    result, unit = self._taken(call, flying[name]), flying.pop(name).unit
                    if result is None:
                        self.moved.again += 1
                        waiting.append(unit)
                    else:
                        take(unit, result)
                        done += 1
                self._tell(call.task, done, done + len(waiting) + len(flying))
        finally:
            left = [flight.future for flight in flying.values()]
            waiting.extend(flight.unit for flight in flying.values())
            if left and client.status == "running":
                client.cancel(left, force=True)

    def _sent(self, client: Client, call: Call, unit: Unit) -> Flight:
        """Send a unit to the workers that may compute it."""
        order, count = Order(call.task, self.scene.digest, call.settings), len(next(iter(unit.columns.values())))
        columns = unit.columns
        if call.recipe is not None:
            order, columns = replace(order, recipe=replace(call.recipe, arrays={}), name=call.name), {}
        work = Work(order.packed(), unit.first, count, columns, unit.digest)
        self.moved.bytes_sent += work.nbytes()
        workers = self.roster.workers(self.ledger.avoided(unit.name))
        # A name of its own for every time that it is sent: Dask may still know the last one.
        self._sends += 1
        future = client.submit(
            remote.compute, work, self._on_cluster(call),
            key=f"{unit.name}-{self._sends}", workers=workers, allow_other_workers=False, pure=False, retries=0,
        )  # fmt: skip
        return Flight(unit, future, frozenset(workers))

    def _landed(self, flying: Mapping[str, Flight]) -> list[str]:
        """Wait for a moment for units that have an end, good or bad; their names."""
        end = time.monotonic() + LOOK
        while time.monotonic() < end:
            if done := [name for name, flight in flying.items() if flight.future.status != "pending"]:
                return done
            time.sleep(POLL)
        if self.roster.client.status != "running":
            raise OSError("the scheduler is gone")
        there = set(self.roster.workers())
        # Dask waits for ever for workers that have died.
        return [name for name, flight in flying.items() if not flight.workers & there]

    def _on_cluster(self, call: Call) -> Future | None:
        """What each worker fetches once: the arrays of the recipe, or those that the rows share."""
        arrays, name = call.shared, str(call.shared_names)
        if call.recipe is not None:
            arrays, name = call.recipe.arrays, str(call.array_names)
        if not arrays:
            return None
        future = self._scattered.pop(name, None)
        if future is None or future.status != "finished":
            self.moved.bytes_sent += _nbytes(arrays) * max(len(self.roster.workers()), 1)
            future = self.roster.client.scatter([arrays], hash=True)[0]
        # The last used one is the last.
        self._scattered[name] = future
        while len(self._scattered) > MOST_SCATTERED:
            self._scattered.pop(next(iter(self._scattered)))
        return future

    def _taken(self, call: Call, flight: Flight) -> Arrays | None:
        """The result of a unit; None where it must be computed again."""
        unit, future = flight.unit, flight.future
        if future.status in ("cancelled", "lost") and self.roster.client.status != "running":
            raise OSError("the scheduler is gone")
        if future.status == "error":
            # Whatever Dask itself raises: the worker died of it, or its result cannot be fetched.
            self.ledger.died(unit.name)
        if future.status != "finished":
            future.cancel(force=True)
            return None
        try:
            address, result = future.result(timeout=FETCH)
        except (Exception, asyncio.CancelledError) as error:
            # The worker died with the result, or the connection did.
            self.say(f"[yellow]cluster: a result is lost ({type(error).__name__}); it is computed again")
            return None
        if result == remote.NO_SCENE:
            self.roster.forget(address)
            return None
        if result == remote.OTHER_ROWS:
            if call.recipe is not None:
                self.say(f"[yellow]cluster: worker {address} makes other rows of '{call.task}'; they are sent")
            call.recipe = None
            return None
        if isinstance(result, str):
            if self.ledger.failed(unit.name, address, result):
                self.roster.set_aside(address)
                self.say(f"[yellow]cluster: worker {address} failed three times and gets no more work:[/] {result}")
            return None
        self.moved.units += 1
        self.moved.bytes_received += sum(value.nbytes for value in result.values())
        return result

    def _keep(self, unit: Unit, result: Arrays) -> None:
        """Store a result. A full disk costs only what an interrupted bake could go on from."""
        if not self.stores:
            return
        try:
            self.store.put(unit.key, result, ARRAYS)
        except OSError as error:
            self.stores = False
            self.say(f"[yellow]cluster: results are no longer stored:[/] {' '.join(str(error).split())}")

    def _reconnect(self, error: BaseException) -> None:
        """Connect to the cluster again; without a scheduler the bake ends with one line."""
        self._scattered.clear()
        self.say(f"[yellow]cluster: connection lost ({' '.join(str(error).split())[:100]}); connecting again")
        end = time.monotonic() + BACK
        while True:
            try:
                self.roster.adopt(self.connect())
                return
            except LOST:
                if time.monotonic() > end:
                    raise RuntimeError(
                        f"cluster: no scheduler for {BACK:.0f} s; start it again and go on with --resume, with or "
                        "without --cluster"
                    ) from None
                time.sleep(LOOK)

    def _tell(self, task: str, done: int, all_units: int) -> None:
        """Say now and then how far long work is."""
        now = time.monotonic()
        if now - self._told < TELL or done == all_units:
            return
        if self._told:
            rate = (self.moved.units - self._before) * self.unit_lanes / (now - self._told) / 1e6
            moved = (self.moved.bytes_sent + self.moved.bytes_received) / 1e6
            workers = len(self.roster.workers())
            self.say(
                f"cluster: {task}, {done} of {all_units} units, {workers} workers, {rate:.2f} M paths/s, {moved:.0f} MB"
            )
        self._told, self._before = now, self.moved.units

    def summary(self) -> str:
        """Say in one line what was computed and sent.

        Returns:
            The line.
        """
        moved = self.moved
        kept = f", {moved.from_store} from the store" if moved.from_store else ""
        again = f", {moved.again} sent again" if moved.again else ""
        sent, received = moved.bytes_sent + self.roster.bytes_sent, moved.bytes_received
        return (
            f"cluster: {moved.units} units on {self.roster.seen} workers{kept}{again}; "
            f"{sent / 1e3:,.1f} kB sent, {received / 1e6:.1f} MB received"
        )


def _nbytes(arrays: Arrays) -> int:
    return sum(value.nbytes for value in arrays.values())
