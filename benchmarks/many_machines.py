"""Many machines, small edits, first light: bytes, overhead, efficiency, and what an edit costs.

    python benchmarks/many_machines.py [--only bytes,kills,overhead,efficiency,moved,preview,edits,edit-errors,
                                       lightmaps,batch,model] [--quick]

Schedulers and workers are processes on this machine. With two cores eight workers cannot trace eight times as fast:
``efficiency`` therefore measures with workers that sleep for the time of a unit. ``model`` is a simulation with assumed
times (benchmarks/cluster_simulation.py), not a measurement. Run it on a quiet machine; ``--quick`` writes nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from cluster_simulation import Plan, city_block, simulate
from rows import Row, at_least, at_most, chosen, publish, without_bar

HERE = Path(__file__).parent
# A bake of fixed plan: one shard before the adaptive stage, few steps.
FIXED = "--steps 200 --shards 1 --no-static --views 1 --truth 5s --vary light.clearance=0.2".split()
# The same with four times the shards of a default bake, for times: starting workers takes about 3 s.
TIMED = [*FIXED[:2], "--shards", "96", *FIXED[4:]]
EDITS = ("recolour", "move", "delete", "add", "lamp")
KILLS, PATIENCE, REPEATS = 20, 3600.0, 3
# Units of the efficiency, and seconds that each sleeps.
SLEEPS, SLEEP = 160, 1.0


# What is asked, by name: words, bar, whether more is better, unit. A row that was never measured is null.
ASKED: dict[str, tuple[str, float, bool, str]] = {
    "bytes": ("clusters of 1, 2 and 8 workers that give the bytes of one process", 3, True, "of them"),
    "kills": ("bakes under 20 random kills and a restarted scheduler that give the same bytes, share", 1, True, ""),
    "overhead": ("local:2 over in-process: seconds of tracing, 96 shards", 1.10, False, "times"),
    "efficiency": ("efficiency of 8 workers (simulated kernels)", 0.85, True, ""),
    "moved": ("bytes to workers beyond the scene, per unit", 1000, False, "B"),
    "cold": ("--preview: the page can be shown, kernels cold", 15, False, "s"),
    "warm": ("--preview: the page can be shown, kernels warm", 5, False, "s"),
    "edit": ("an edit of a hundredth of a room, share of the bake's time, worst of five", 0.10, False, ""),
    "error": ("... error over a whole bake's, worst of five", 1.10, False, "times"),
    "lightmap": ("an edit with a light map, share of the bake's time", 0.05, False, ""),
    "kept": ("batch after kill -9: finished scenes that are baked again", 0, False, "scenes"),
    "ended": ("batch after kill -9: scenes that are baked in the end, of ten", 10, True, "scenes"),
}


def asked(name: str, measured: float | None, note: str = "", quick: bool = False) -> Row:
    """The row of a bar; small runs are not held against it."""
    what, bar, more, unit = ASKED[name]
    if quick:
        return without_bar(what, measured, unit, note)
    return (at_least if more else at_most)(what, bar, measured, unit, note)


def command(*words: str, **environment: str) -> list[str]:
    """A command line of lightwell."""
    return [sys.executable, "-m", "lightwell.cli", *words]


def run(*words: str, **options: Any) -> float:
    """Run a command; its wall seconds."""
    start = time.perf_counter()
    subprocess.run(command(*words), check=True, timeout=PATIENCE, stderr=subprocess.DEVNULL, **options)
    return time.perf_counter() - start


class Processes:
    """A scheduler and workers as processes."""

    def __init__(self, folder: Path, count: int, *preload: str) -> None:
        self.preload, self.running = preload, []
        self.port = "8799"
        self.scheduler = self.start("scheduler", "--host", "127.0.0.1", "--port", self.port, "--no-dashboard")
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.workers = [self.worker() for _ in range(count)]

    def start(self, kind: str, *words: str) -> subprocess.Popen[bytes]:
        """Start a process of Dask."""
        threads = {"LIGHTWELL_THREADS": "1", "PYTHONPATH": os.pathsep.join([str(HERE), *filter(None, sys.path)])}
        argv = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *words]
        process = subprocess.Popen(argv, env=os.environ | threads, stderr=subprocess.DEVNULL)
        self.running.append(process)
        return process

    def worker(self) -> subprocess.Popen[bytes]:
        """Start a worker."""
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1", *self.preload]
        return self.start("worker", self.address, *options)

    def restart_scheduler(self) -> None:
        """Kill the scheduler and start it again; its workers end, so that new ones are started."""
        self.scheduler.kill()
        self.scheduler.wait()
        count = len(self.workers)
        self.scheduler = self.start("scheduler", "--host", "127.0.0.1", "--port", self.port, "--no-dashboard")
        self.workers = [self.worker() for _ in range(count)]


@contextlib.contextmanager
def processes(folder: Path, count: int, *preload: str) -> Iterator[Processes]:
    """A cluster for the time of a block."""
    made = Processes(folder, count, *preload)
    try:
        yield made
    finally:
        for process in made.running:
            process.kill()


def baked(folder: Path, name: str, *words: str) -> bytes:
    """The asset of a bake of fixed plan; results of other bakes are not used."""
    out = folder / name
    run("bake", "cornell", "-o", str(out), *FIXED, "--store", str(folder / f"store-{name}"), *words)
    return (out / "scene.glb").read_bytes()


def equal_bytes(folder: Path, quick: bool) -> list[Row]:
    """The same asset from this process and from 1, 2 and 8 workers."""
    whole, same = baked(folder, "whole"), 0
    counts = (1,) if quick else (1, 2, 8)
    for count in counts:
        with processes(folder, count) as made:
            same += baked(folder, f"workers-{count}", "--cluster", made.address) == whole
    return [asked("bytes", same, quick=quick)]


def kills(folder: Path, quick: bool) -> list[Row]:
    """Workers killed at random moments, and the scheduler restarted once."""
    whole, killed, over = baked(folder, "whole"), [0], threading.Event()
    most = 2 if quick else KILLS
    with processes(folder, 3) as made:

        def kill() -> None:
            chance = random.Random(1)
            while killed[0] < most and not over.wait(chance.uniform(0.5, 3.0)):
                k = chance.randrange(len(made.workers))
                made.workers[k].send_signal(signal.SIGKILL)
                made.workers[k] = made.worker()
                killed[0] += 1
                if killed[0] == most // 2:
                    made.restart_scheduler()

        killer = threading.Thread(target=kill)
        killer.start()
        same, bakes = True, 0
        while killed[0] < most:
            same &= baked(folder, f"killed-{bakes}", "--cluster", made.address) == whole
            bakes += 1
        over.set()
        killer.join()
    note = f"{bakes} bakes of 3 workers, {killed[0]} kills, the scheduler restarted once"
    return [asked("kills", float(same), note, quick)]


def overhead(folder: Path, quick: bool) -> list[Row]:
    """Tracing on two local processes against tracing in this process, in turn; scoring takes the time it is given."""

    def traced(name: str, *words: str) -> float:
        run("bake", "cornell", "-o", str(folder / name), *(FIXED if quick else TIMED),
            "--store", str(folder / f"store-{name}"), *words)  # fmt: skip
        return float(json.loads((folder / name / "report.json").read_text())["seconds"]["trace"])

    times = [(traced(f"one-{k}"), traced(f"two-{k}", "--cluster", "local:2")) for k in range(1 if quick else REPEATS)]
    one, two = np.median(times, axis=0)
    ratios = ", ".join(f"{b / a:.3f}" for a, b in times)
    note = f"medians of {len(times)} bakes each in turn, {one:.1f} and {two:.1f} s; ratios of the pairs {ratios}"
    return [asked("overhead", two / one, note, quick)]


def efficiency(folder: Path, quick: bool) -> list[Row]:
    """Eight workers whose units sleep for the time of a kernel, through the executor itself."""
    import sleeping  # noqa: F401  registers the task that sleeps, here as on the workers
    from distributed import Client

    from lightwell.cluster.executor import DaskExecutor
    from lightwell.cluster.roster import Roster
    from lightwell.cluster.worker import SceneSource, fingerprint
    from lightwell.core.store import Store
    from lightwell.scenes import load

    count, units = 8, 16 if quick else SLEEPS
    scene = load("cornell")
    with processes(folder, count, "--preload", "sleeping") as made:
        connect: Callable[[], Any] = lambda: Client(made.address, timeout=60, set_as_default=False)  # noqa: E731
        roster = Roster(connect(), SceneSource("cornell", scene.digest), fingerprint(), print)
        while len(roster.workers()) < count:
            time.sleep(1)
        executor = DaskExecutor(scene, roster, connect, Store(folder / "sleeps"), print, unit_lanes=1, least_lanes=0)
        start = time.perf_counter()
        executor.rows("sleep", {"seconds": SLEEP}, {"row": np.arange(units, dtype=np.uint32)}, 1)
        took = time.perf_counter() - start
    note = f"{units} units of {SLEEP:g} s of sleep, not of tracing: two cores hold two real kernels"
    return [asked("efficiency", units * SLEEP / (count * took), note, quick)]


def moved(folder: Path, quick: bool) -> list[Row]:
    """Bytes that go to workers of a running scheduler, from the last line of a bake."""
    with processes(folder, 2) as made:
        words = command("bake", "cornell", "-o", str(folder / "moved"), *FIXED, "--store", str(folder / "s"),
                        "--cluster", made.address)  # fmt: skip
        done = subprocess.run(words, check=True, capture_output=True, text=True, timeout=PATIENCE)
    line = next(line for line in done.stderr.splitlines() if line.startswith("cluster: ") and "kB sent" in line)
    units, sent = int(line.split()[1]), float(line.split(";")[1].split()[0].replace(",", "")) * 1e3
    note = "units and arrays that each worker gets once; workers make the rows; a built-in scene has no file"
    return [asked("moved", sent / max(units, 1), note, quick)]


def preview(folder: Path, quick: bool) -> list[Row]:
    """Seconds until the page of --preview can be shown."""
    rows = []
    for kind in ("cold", "warm"):
        cache = folder / "kernels"
        if kind == "cold":
            shutil.rmtree(cache, ignore_errors=True)
        start = time.perf_counter()
        argv = command("bake", "cornell", "-o", str(folder / kind), "--preview", "--no-open", "--budget", "60s")
        with subprocess.Popen(
            argv, stderr=subprocess.PIPE, text=True, env=os.environ | {"HOME": str(cache)}
        ) as process:
            assert process.stderr is not None
            url = next(line for line in process.stderr if line.startswith("http://")).split("?")[0]
            with urllib.request.urlopen(url + "scene.glb") as answer:
                answer.read()
            seconds = time.perf_counter() - start
            while json.load(urllib.request.urlopen(url + "state.json"))["version"] < 2 and not quick:
                time.sleep(0.2)
            learned = time.perf_counter() - start
            process.kill()
        rows.append(asked(kind, seconds, quick=quick))
        rows.append(without_bar(f"--preview: first learned light, kernels {kind}", None if quick else learned, "s"))
    return rows


def edited_scenes(folder: Path) -> dict[str, Path]:
    """Five edits of a room that each touch about a hundredth of it."""
    from dataclasses import replace

    from lightwell.asset.records import FieldEntry
    from lightwell.asset.write import write_glb
    from lightwell.fields.features import open_builder
    from lightwell.scenes import load

    scene = load("cornell")
    *room, patch = scene.meshes
    lamp = replace(patch, name="lamp", emission=(8.0, 8.0, 8.0))
    block = next(mesh for mesh in room if mesh.name == "short_block")
    # A cube of 19 cm on the free part of the floor: 0.2 of the room's 26 square metres.
    foot = np.float32([block.positions[:, 0].mean(), 0, block.positions[:, 2].mean()])
    cube = replace(block, name="cube", positions=(block.positions - foot) * 0.25 + np.float32([-0.6, 0, 0.7]))
    materials = [*scene.materials, replace(scene.materials[cube.material], base_color=(0.9, 0.1, 0.1, 1.0))]

    def moved_by(mesh: Any, *way: float) -> Any:
        return replace(mesh, positions=mesh.positions + np.float32(way))

    variants = {
        "before": ([*room, cube, lamp], scene.materials),
        "recolour": ([*room, replace(cube, material=len(scene.materials)), lamp], materials),
        "move": ([*room, moved_by(cube, 0.1, 0, 0), lamp], scene.materials),
        "delete": ([*room, lamp], scene.materials),
        "add": ([*room, cube, lamp, moved_by(replace(cube, name="added"), 0.3, 0, 0)], scene.materials),
        "lamp": ([*room, cube, moved_by(lamp, 0.1, 0, 0)], scene.materials),
    }
    b = open_builder()
    # A file has a field; this one is black, and not read when the scene is loaded.
    black = FieldEntry("none", "static", b.build(radiance=b.scale("reflectance", 0.0)))
    for name, (found, used) in variants.items():
        write_glb(folder / f"{name}.glb", replace(scene, meshes=list(found), materials=list(used)), [black], [])
    return {name: folder / f"{name}.glb" for name in variants}


def edit_shares(folder: Path, names: tuple[str, ...], repeats: int, budget: str, *common: str) -> tuple[float, str]:
    """The largest share of a whole bake's time that edits take, medians, and a note with all."""
    paths, old, shares = edited_scenes(folder), folder / "before", {}
    whole = run("bake", str(paths["before"]), "-o", str(old), *common, "--budget", budget, "--views", "1", "--keep")
    for name in names:
        words = ("bake", str(paths[name]), *common, "--rebake", str(old), "-o")
        shares[name] = float(np.median([run(*words, str(folder / f"{name}-{k}")) for k in range(repeats)])) / whole
    return max(shares.values()), ", ".join(f"{n} {share:.3f}" for n, share in shares.items()) + f" of {whole:.0f} s"


def edits(folder: Path, quick: bool) -> list[Row]:
    """Time of incremental bakes of a field against a whole one."""
    how = (("recolour",), 1, "30s") if quick else (EDITS, REPEATS, "180s")
    return [asked("edit", *edit_shares(folder, *how), quick)]


def lightmaps(folder: Path, quick: bool) -> list[Row]:
    """Time of incremental bakes of a light map, for edits that keep its atlas."""
    how = (("recolour",), 1, "30s") if quick else (("recolour", "move", "lamp"), REPEATS, "180s")
    return [asked("lightmap", *edit_shares(folder, *how, "--field", "lightmap"), quick)]


def edit_errors(folder: Path, quick: bool) -> list[Row]:
    """Error of incremental bakes against whole ones."""
    paths, ratios = edited_scenes(folder), {}
    budget = ["--budget", "30s" if quick else "180s", "--views", "1"]
    run("bake", str(paths["before"]), "-o", str(folder / "before"), *budget, "--keep")
    for name in ("recolour",) if quick else EDITS:
        out, full = folder / f"edit-{name}", folder / f"full-{name}"
        run("bake", str(paths[name]), "-o", str(out), "--rebake", str(folder / "before"))
        run("bake", str(paths[name]), "-o", str(full), *budget)
        error = json.loads((full / "report.json").read_text())["training"][-1]["relative_error"]
        ratios[name] = json.loads((out / "rebake.json").read_text())["roles"]["indirect"]["error"] / error
    worst = max(ratios, key=ratios.__getitem__)
    return [asked("error", ratios[worst], f"{worst}; of the field of the moving light", quick)]


def batch(folder: Path, quick: bool) -> list[Row]:
    """Ten scenes, killed once: what was finished is not baked again."""
    count = 3 if quick else 10
    tables = "".join(f'[scenes.s{k}]\nscene = "cornell"\nseed = {k}\n' for k in range(count))
    common = "[bake]\nsteps = 20\nshards = 1\nviews = 1\nstatic = false\ntruth = '1s'\n"
    (folder / "flats.toml").write_text(common + tables)
    words = ("batch", str(folder / "flats.toml"), "-o", str(folder / "batch"))
    with subprocess.Popen(command(*words), stderr=subprocess.DEVNULL) as process:
        while not (folder / f"batch/s{count // 2}/.lightwell").exists():
            time.sleep(0.2)
        process.kill()
    done = {path: path.stat().st_mtime_ns for path in folder.glob("batch/*/report.json")}
    run(*words)
    kept = sum(path.stat().st_mtime_ns == time_ for path, time_ in done.items())
    states = [row["state"] for row in json.loads((folder / "batch/batch.json").read_text())["scenes"]]
    return [
        asked("kept", len(done) - kept, f"of {len(done)}", quick),
        asked("ended", states.count("done"), quick=quick),
    ]


def model(folder: Path, quick: bool) -> list[Row]:
    """The simulation of 100,000 units and the estimate of a city block."""
    note = "simulated with assumed times (benchmarks/cluster_simulation.py), not measured"
    units = 2000 if quick else 100_000
    rows = []
    for name, plan in {
        "bins, 10 Gbit/s": Plan(units=units),
        "points, 10 Gbit/s": Plan(units=units, bytes_out=Plan.bytes_in),
    }.items():
        found = simulate(plan)
        rows.append(without_bar(f"simulation, 100 machines, {name}: efficiency", found.efficiency, "", note))
        rows.append(without_bar(f"simulation, 100 machines, {name}: disk busy", found.disk_share, "", note))
    return rows + [without_bar(f"1,000 flats on 100 machines: {name}", v, "", note) for name, v in city_block().items()]


PARTS = {
    "bytes": equal_bytes,
    "kills": kills,
    "overhead": overhead,
    "efficiency": efficiency,
    "moved": moved,
    "preview": preview,
    "edits": edits,
    "edit-errors": edit_errors,
    "lightmaps": lightmaps,
    "batch": batch,
    "model": model,
}


def main() -> None:
    """Measure the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", help=f"some of {', '.join(PARTS)}")
    parser.add_argument("--quick", action="store_true", help="smaller, and nothing is written")
    parser.add_argument("--unmeasured", action="store_true", help="add rows of what was never measured, as null")
    arguments = parser.parse_args()
    if arguments.unmeasured:
        publish("many_machines", [asked(name, None, "not measured yet") for name in ASKED])
        return
    for name in chosen("--only", arguments.only, PARTS):
        with tempfile.TemporaryDirectory() as folder:
            publish("many_machines", PARTS[name](Path(folder), arguments.quick), arguments.quick)


if __name__ == "__main__":
    main()
