"""A simulation of the scheduling of ``--cluster``: 100,000 units on 100 machines, and what a city block would cost.

    python benchmarks/cluster_simulation.py

Events are those of ``lightwell.cluster.executor``: the command keeps two units on their way for each thread, sends
rows, the scheduler handles a message at a time, a worker computes one unit at a time, results return over the link of
the command's machine and are stored one after the other. Nothing is measured here: times are the assumptions below.
"""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass

from lightwell.cluster.executor import BACKLOG, UNIT_LANES

# Dask's own figure for a task that passes the scheduler, seconds (docs.dask.org, "Best practices": "around 1 ms").
SCHEDULER_SECONDS = 1e-3
# Paths per second of a core: 0.3 million on the two cores of the benchmarks (benchmarks/results/main_job.json).
PATHS_PER_CORE = 1.5e5
# Bytes per row and per path of a result: points are 28 bytes and 24 return; bins are 8 bytes for each ray.
ROW_BYTES, BIN_BYTES = 28, 8
# Bytes per second of a link of 10 Gbit/s, and of a disk that takes results.
LINK, DISK = 1.25e9, 5e8


@dataclass(frozen=True)
class Plan:
    """What is simulated."""

    units: int = 100_000
    machines: int = 100
    cores: int = 16
    bytes_in: float = ROW_BYTES * UNIT_LANES / 64
    bytes_out: float = BIN_BYTES * UNIT_LANES
    deaths_per_hour: float = 0.05
    """Of a machine."""
    link: float = LINK
    scheduler_seconds: float = SCHEDULER_SECONDS


@dataclass(frozen=True)
class Simulated:
    """What came of it."""

    seconds: float
    efficiency: float
    """Time of computing over time of all machines."""
    link_share: float
    """Share of the time in which the link of the command's machine is busy."""
    disk_share: float
    scheduler_share: float
    again: int
    """Units that were computed again because a machine died."""


def simulate(plan: Plan, seed: int = 1) -> Simulated:
    """Run the events."""
    chance = random.Random(seed)
    seconds = UNIT_LANES / (PATHS_PER_CORE * plan.cores)
    death = plan.deaths_per_hour * seconds / 3600
    send, receive = plan.bytes_in / plan.link, plan.bytes_out / plan.link
    free_out = free_in = free_disk = free_scheduler = computing = now = 0.0
    machines = [0.0] * plan.machines
    """When each machine is free, a heap."""
    ends: list[float] = []
    """When units that are on their way are computed, a heap."""
    left, again = plan.units, 0
    while left or ends:
        while left and len(ends) < BACKLOG * plan.machines:
            left -= 1
            free_out = max(free_out, now) + send
            free_scheduler = max(free_scheduler, free_out) + plan.scheduler_seconds
            took = seconds * chance.uniform(0.8, 1.25)
            start = max(heapq.heappop(machines), free_scheduler)
            computing += took
            heapq.heappush(machines, start + took)
            heapq.heappush(ends, start + took)
        finished = heapq.heappop(ends)
        if chance.random() < death:
            left, again, now = left + 1, again + 1, max(now, finished)
            continue
        # Results arrive one after the other and are stored one after the other; then the next unit is sent.
        free_in = max(free_in, finished) + receive
        free_disk = max(free_disk, free_in) + plan.bytes_out / DISK
        now = free_disk
    count = plan.units + again
    shares = (
        max(send, receive) * count / now,
        plan.bytes_out / DISK * count / now,
        plan.scheduler_seconds * count / now,
    )
    return Simulated(now, computing / (now * plan.machines), *shares, again)


# ---------------------------------------------------------------------- a city block

# Of one flat, quality 'good' on two cores (180 s): core seconds of tracing and of training, seconds of the rest.
FLATS, TRACE, TRAIN, REST = 1000, 250.0, 95.0, 25.0
# Bytes of results of a flat: 262,144 points with 64 rays of 8 bytes, and of its scene.
FLAT_BYTES, SCENE_BYTES = 262_144 * 64 * BIN_BYTES, 30e6
# Price of a core for an hour, dollars.
PRICE = 0.04


def city_block(machines: int = 100, cores: int = 16) -> dict[str, float]:
    """Estimate hours, bytes and cost of 1,000 flats: one command after the other, and one command per machine."""
    trace = TRACE / (machines * cores)
    one = FLATS * (trace + TRAIN / cores + REST) / 3600
    each = FLATS * ((TRACE + TRAIN) / cores + REST) / machines / 3600
    sent = FLATS * (FLAT_BYTES + machines * SCENE_BYTES)
    return {
        "hours, one command on all machines": one,
        "hours, one command on each machine": each,
        "GB over the network, one command on all machines": sent / 1e9,
        "GB over the network, one command on each machine": FLATS * SCENE_BYTES / 1e9,
        "dollars, one command on all machines": one * machines * cores * PRICE,
        "dollars, one command on each machine": each * machines * cores * PRICE,
    }


def main() -> None:
    """Print the simulation and the estimate."""
    for name, plan in {
        "100 machines, 10 Gbit/s": Plan(),
        "100 machines, 1 Gbit/s": Plan(link=LINK / 10),
        "100 machines, points in place of bins": Plan(bytes_out=24 * UNIT_LANES / 64),
        "1,000 machines, 10 Gbit/s": Plan(machines=1000),
        "8 machines, 1 Gbit/s": Plan(units=8000, machines=8, link=LINK / 10),
    }.items():
        s = simulate(plan)
        print(
            f"{name:<40} {s.seconds / 60:8.1f} min  efficiency {s.efficiency:.2f}  link {s.link_share:.2f}  "
            f"disk {s.disk_share:.2f}  scheduler {s.scheduler_share:.3f}  computed again {s.again}"
        )
    for name, value in city_block().items():
        print(f"{name:<55} {value:10.2f}")


if __name__ == "__main__":
    main()
