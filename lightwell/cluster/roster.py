"""The workers of a cluster that may compute: those that have shown the same bytes and have the scene."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from distributed import Client, Future

from lightwell.cluster import worker as remote
from lightwell.cluster.worker import SceneSource

# Seconds between two looks at the workers, and until the first one must be ready.
LOOK, FIRST = 2.0, 600.0
POLL = 0.1
# Tests of a worker that end with an error before it is refused: the first may be an accident.
MOST_ERRORS = 2
# Seconds in which another worker may come where all were refused.
GRACE = 10.0
# What must agree besides the bytes, for the message.
_ABOUT = ("lightwell", "mitsuba", "drjit", "variant", "processor")


class Roster:
    """Keeps the list of workers; new ones are tested when they appear."""

    def __init__(
        self,
        client: Client,
        source: SceneSource,
        own: Mapping[str, str],
        say: Callable[[str], None],
        allow_mixed: bool = False,
    ) -> None:
        """Look at the workers of a cluster.

        Args:
            client: Client of the cluster.
            source: The scene that workers need.
            own: Fingerprint of this process.
            say: Takes a line for each worker that is refused.
            allow_mixed: Take workers that compute other bytes.
        """
        self.client, self._source, self._own, self._say = client, source, own, say
        self._allow_mixed = allow_mixed
        self._ready: dict[str, int] = {}
        self._proving: dict[str, Future] = {}
        self._refused: dict[str, str] = {}
        # Tests that ended with an error, by address.
        self._errors: Counter[str] = Counter()
        self._looked = -LOOK
        self._files: dict[str, bytes] | None = None
        self.mixed = False
        """Whether a worker of other bytes takes part."""
        self.bytes_sent = 0
        """Bytes of scene files that were sent to workers."""
        self._seen: set[str] = set()

    @property
    def seen(self) -> int:
        """Workers that have taken part so far."""
        return len(self._seen)

    def adopt(self, client: Client) -> None:
        """Go on with another client; all workers are tested again.

        Args:
            client: Client of the cluster.
        """
        with contextlib.suppress(Exception, asyncio.CancelledError):  # a client without a scheduler
            self.client.close(timeout=1)
        self.client = client
        self._ready, self._proving, self._looked = {}, {}, -LOOK

    def workers(self, avoided: set[str] | None = None) -> list[str]:
        """List the workers that may compute; waits until there is one.

        Args:
            avoided: Workers that should not get the work, if there are others.

        Returns:
            Addresses.

        Raises:
            RuntimeError: No worker is ready in time, or all were refused; one line.
            OSError: The scheduler is gone.
        """
        self._look()
        end = time.monotonic() + FIRST
        while not self._ready:
            if self.client.status != "running":
                raise OSError("the scheduler is gone")
            if self._refused and not self._proving and time.monotonic() > end - FIRST + GRACE:
                raise RuntimeError(next(iter(self._refused.values())))
            if time.monotonic() > end:
                raise RuntimeError(f"cluster: no worker was ready within {FIRST / 60:.0f} minutes; look at its logs")
            time.sleep(POLL)
            self._look(now=True)
        return sorted(self._ready.keys() - (avoided or set())) or sorted(self._ready)

    def threads(self) -> int:
        """Count the threads of the workers that may compute.

        Returns:
            At least 1.
        """
        return sum(self._ready[address] for address in self.workers())

    def forget(self, address: str) -> None:
        """Test a worker again: it was restarted.

        Args:
            address: Address of the worker.
        """
        self._ready.pop(address, None)

    def set_aside(self, address: str) -> None:
        """Give a worker no more work.

        Args:
            address: Address of the worker.
        """
        self._ready.pop(address, None)
        self._refused[address] = f"cluster: worker {address} failed too often; look at its log"

    # ------------------------------------------------------------------ tests of workers

    def _look(self, now: bool = False) -> None:
        """Test workers that have appeared, forget those that are gone."""
        if not now and time.monotonic() - self._looked < LOOK:
            return
        self._looked = time.monotonic()
        there = {a: int(w["nthreads"]) for a, w in self.client.scheduler_info(n_workers=-1)["workers"].items()}
        self._ready = {address: n for address, n in self._ready.items() if address in there}
        for address in [a for a in self._proving if a not in there]:
            self._proving.pop(address)
        for address in there.keys() - self._ready.keys() - self._proving.keys() - self._refused.keys():
            self._proving[address] = self._ask(address, _prove, self._source, None)
        for address, future in list(self._proving.items()):
            if future.done():
                self._proving.pop(address)
                self._judge(address, future, there[address])

    def _ask(self, address: str, function: Callable[..., Any], *arguments: Any) -> Future:
        return self.client.submit(function, *arguments, workers=[address], allow_other_workers=False, pure=False)

    def _judge(self, address: str, future: Future, threads: int) -> None:
        """Take a worker, refuse it, or send it the scene."""
        if future.status == "error":
            self._errors[address] += 1
            if self._errors[address] >= MOST_ERRORS:
                error = future.exception()
                said = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
                self._refuse(address, f"cannot be tested ({said}); look at its log")
            return
        if future.status != "finished":
            return  # It died; if it comes back, it is tested again.
        found, has_scene = future.result()
        if wrong := self._fault(found):
            self._refuse(address, wrong)
        elif has_scene:
            self._ready[address] = threads
            self._seen.add(address)
            self.mixed |= found["bytes"] != self._own["bytes"]
        elif self._files is None or found.get("sent") != "yes":
            self._send(address)
        else:
            self._refuse(address, f"cannot load the scene '{self._source.source}'")

    def _refuse(self, address: str, why: str) -> None:
        self._refused[address] = f"cluster: worker {address} {why}"
        self._say(f"[yellow]{self._refused[address]}")

    def _send(self, address: str) -> None:
        if self._files is None:
            self._files = remote.scene_files(self._source)
        self.bytes_sent += sum(map(len, self._files.values()))
        self._proving[address] = self._ask(address, _prove, self._source, self._files)

    def _fault(self, found: Mapping[str, str]) -> str:
        if found["lightwell"] != self._own["lightwell"]:
            return f"has lightwell {found['lightwell']}, this is {self._own['lightwell']}; install the same version"
        if found["bytes"] == self._own["bytes"] or self._allow_mixed:
            return ""
        other = [f"{name} {found[name]}, not {self._own[name]}" for name in _ABOUT if found[name] != self._own[name]]
        why = "; ".join(other) or "another kind of processor"
        return f"computes other bytes ({why}); leave it out, or take it with --allow-mixed"


def _prove(source: SceneSource, files: Mapping[str, bytes] | None) -> tuple[dict[str, str], bool]:
    """Fingerprint of the worker, and whether it has the scene."""
    found = remote.fingerprint() | {"sent": "no" if files is None else "yes"}
    return found, remote.take_scene(source, files)
