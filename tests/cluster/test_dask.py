"""Schedulers and workers as processes: the same bytes, killed workers, a lost scheduler, refused workers."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from distributed import Client

from lightwell.cluster import worker as remote
from lightwell.cluster.executor import DaskExecutor
from lightwell.cluster.roster import Roster
from lightwell.cluster.worker import SceneSource
from lightwell.core.store import Store
from lightwell.scenes import load
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.variables import declare
from lightwell.transport import draw_surface, indirect

ROOT = Path(__file__).parents[2]
# Rows, paths of each, and paths of a unit: 40 units of work.
POINTS, PATHS, LANES = 320, 64, 512
pytestmark = pytest.mark.slow


class Processes:
    """A scheduler and workers as processes of their own."""

    def __init__(self, folder, count):
        self.folder, self.running = folder, []
        self.scheduler = self.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
                                    "--scheduler-file", str(folder / "scheduler.json"))  # fmt: skip
        while not (folder / "scheduler.json").exists():
            time.sleep(0.1)
        self.address = Client(scheduler_file=str(folder / "scheduler.json"), set_as_default=False).scheduler.address
        self.workers = [self.worker() for _ in range(count)]

    def start(self, kind, *words, **environment):
        argv = [sys.executable, "-m", "distributed.cli.dask_" + kind, *words]
        env = os.environ | {"PYTHONPATH": str(ROOT), "LIGHTWELL_THREADS": "1"} | environment
        process = subprocess.Popen(argv, cwd=self.folder, env=env, stderr=subprocess.DEVNULL)
        self.running.append(process)
        return process

    def worker(self, **environment):
        return self.start("worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host",
                          "127.0.0.1", "--death-timeout", "900", **environment)  # fmt: skip

    def end(self):
        for process in self.running:
            process.kill()


@contextlib.contextmanager
def cluster(folder, count):
    processes = Processes(folder, count)
    try:
        yield processes
    finally:
        processes.end()


def executor(processes, folder, said, **options):
    scene = load("cornell")
    connect = lambda: Client(processes.address, timeout=30, set_as_default=False)  # noqa: E731
    source = SceneSource("cornell", scene.digest)
    roster = Roster(connect(), source, remote.fingerprint(), said.append, **options)
    scene.executor = DaskExecutor(
        scene, roster, connect, Store(folder / "store"), said.append, unit_lanes=LANES, least_lanes=0
    )
    return scene


def trace(scene):
    variable = declare((), scene)
    lights = sample_lights(scene, variable, POINTS, 1)
    return indirect(scene, draw_surface(scene, POINTS, 1).points, lights, variable, PATHS, 3)


@pytest.fixture(scope="module")
def whole():
    return trace(load("cornell"))


def same(a, b):
    return all(x.tobytes() == y.tobytes() for x, y in zip(a, b))


@pytest.mark.parametrize("count", [1, 2, 8])
def test_any_number_of_workers_gives_the_same_bytes(tmp_path, whole, count):
    said = []
    with cluster(tmp_path, count) as processes:
        scene = executor(processes, tmp_path, said)
        assert same(trace(scene), whole)
        moved = scene.executor.moved
        assert moved.units == 40 and moved.from_store == 0
        # The same again is read from the store.
        assert same(trace(scene), whole) and scene.executor.moved.from_store == 40


def test_killed_workers_cost_no_byte(tmp_path, whole):
    said, killed, over = [], [], threading.Event()
    with cluster(tmp_path, 3) as processes:

        def kill():
            chance = random.Random(7)
            while not over.is_set() and len(killed) < 20:
                time.sleep(chance.uniform(0.5, 2.0))
                k = chance.randrange(len(processes.workers))
                processes.workers[k].send_signal(signal.SIGKILL)
                killed.append(k)
                processes.workers[k] = processes.worker()

        scene = executor(processes, tmp_path, said)
        scene.executor.roster.workers()
        killer = threading.Thread(target=kill)
        killer.start()
        found = trace(scene)
        over.set()
        killer.join()
        assert same(found, whole) and killed


def test_a_lost_scheduler_costs_what_was_on_its_way(tmp_path, whole):
    said = []
    with cluster(tmp_path, 2) as processes:
        scene = executor(processes, tmp_path, said)
        scene.executor.roster.workers()
        port = processes.address.rpartition(":")[2]

        def restart():
            time.sleep(1.0)
            processes.scheduler.kill()
            processes.scheduler.wait()
            processes.scheduler = processes.start("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
            time.sleep(1.0)
            processes.workers += [processes.worker(), processes.worker()]

        helper = threading.Thread(target=restart)
        helper.start()
        found = trace(scene)
        helper.join()
        assert same(found, whole)
