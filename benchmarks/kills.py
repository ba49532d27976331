"""Kill −9 at random moments: what is resumed afterwards ends with the bytes of an uninterrupted run.

    python benchmarks/kills.py [--kills 8] [--only bake,sequence] [--seed N] [--quick]

Five kinds of work, each small: a bake, a light map, light probes, a sequence with the radiance cache, a library of the
lens. A process is killed at a moment drawn evenly from the time that the uninterrupted run takes (without its start),
resumed, killed again, up to four times, and then runs to its end. A kill counts as survived when the files at the end
are those of the uninterrupted run, byte for byte, and no temporary file is left.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rows import RESULTS, Row, at_least, chosen, publish

# Kills of one folder before it may finish.
IN_A_ROW = 4
# No run takes longer, seconds.
PATIENCE = 1200
WHAT = "kill -9, {}: ends with the bytes of the uninterrupted run"


def _small(out: Path, **changes):
    from lightwell.baking.settings import BakeSettings
    from lightwell.fields.budget import Budget

    common = {"views": 1, "view_size": (24, 16), "paths": 4, "shards": 1, "resume": (out / ".lightwell").exists()}
    return BakeSettings("cornell", out, budget=Budget(1.0), **(common | changes))


def bake_field(out: Path) -> None:
    """Three shards, one of them adaptive, and 400 steps with a checkpoint every 200."""
    from lightwell.baking.pipeline import bake

    bake(_small(out, shards=2, steps=400, lights_per_shard=32))


def bake_lightmap(out: Path) -> None:
    """An atlas of 64 x 64 texels and a network of 60 steps."""
    from lightwell.baking.pipeline import bake

    bake(_small(out, field="lightmap", options={"size": 64, "mips": 0}, steps=60))


def bake_probes(out: Path) -> None:
    """Probes at a distance of one metre."""
    from lightwell.baking.pipeline import bake

    bake(_small(out, field="probes", options={"spacing": 1.0}, steps=200, lights_per_shard=32))


def render_sequence(out: Path) -> None:
    """Twelve frames of 24 x 16 pixels with a radiance cache of two levels."""
    from lightwell.cache.settings import parse_options
    from lightwell.rendering.sequence import render_sequence
    from lightwell.rendering.settings import RenderSettings

    options = ["levels=2", "entries_log2=8", "batch=512", "steps=1", "train_fraction_max=1", "max_vertices=4"]
    own = {"frames": 12, "format": "png", "resume": (out / "animation.json").exists()}
    asked = RenderSettings("cornell", out, (24, 16), 2, integrator="nrc", options=own)
    render_sequence(asked, parse_options(options), degrees=60.0)


def bake_library(out: Path) -> None:
    """A library of discs up to eight pixels, three nodes at a time, and its use from the store."""
    os.environ["LIGHTWELL_STORE"] = str(out)
    from lightwell.lens.families import depth
    from lightwell.lens.library_cache import LibraryCache
    from lightwell.lens.recipes import Recipe

    family, libraries = depth(8.0, noise=0.004), LibraryCache()
    library = libraries.library(family, Recipe())
    for first in range(0, family.size, 3):
        libraries.ensure(library, list(range(first, min(first + 3, family.size))))


@dataclass(frozen=True)
class Kind:
    """A kind of work: what runs, and which of its files are the result."""

    run: Callable[[Path], None]
    result: tuple[str, ...]


KINDS = {
    "bake": Kind(bake_field, ("scene.glb",)),
    "lightmap": Kind(bake_lightmap, ("scene.glb",)),
    "probes": Kind(bake_probes, ("scene.glb", "probes-*.lwp")),
    "sequence": Kind(render_sequence, ("frame-*.png", "radiance-cache.npz", "exposure.txt")),
    "library": Kind(bake_library, ("**/*.lwsp", "**/*.npz")),
}


def _digests(folder: Path, kind: Kind) -> dict[str, str]:
    """Hash of every file of the result, and the names of what should not be there."""
    found = {p.relative_to(folder).as_posix(): p for pattern in kind.result for p in folder.glob(pattern)}
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in sorted(found.items())}


def _start(name: str, folder: Path) -> subprocess.Popen:
    """A process that has loaded its modules and begins to work."""
    command = [sys.executable, __file__, "--child", name, str(folder)]
    log = open(folder.with_suffix(".log"), "ab")
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log)
    log.close()
    assert child.stdout is not None
    if child.stdout.readline() != b"begun\n":
        raise SystemExit(f"error: {name} did not start; see {folder.with_suffix('.log')}")
    return child


def _finish(name: str, folder: Path) -> float:
    """Run to the end; returns the seconds."""
    child, start = _start(name, folder), time.monotonic()
    if child.wait(PATIENCE):
        text = folder.with_suffix(".log").read_text()[-2000:]
        raise SystemExit(f"error: {name} failed after a kill\n{text}")
    return time.monotonic() - start


def measure(name: str, kills: int, rng: random.Random, folder: Path) -> int:
    """Kill one kind of work so many times; returns how many kills were survived."""
    kind = KINDS[name]
    seconds = _finish(name, folder / "whole")
    wanted = _digests(folder / "whole", kind)
    if not wanted:
        raise SystemExit(f"error: {name} wrote nothing")
    done = survived = 0
    while done < kills:
        out = folder / f"killed-{done}"
        killed = _chain(name, out, min(IN_A_ROW, kills - done), seconds, rng)
        equal = _digests(out, kind) == wanted and not list(out.rglob(".*.lock"))
        done += killed
        survived += killed if equal else 0
        print(f"{name}: {killed} kills, {'equal' if equal else 'DIFFERENT: ' + str(out)}", flush=True)
        if equal:
            shutil.rmtree(out)
    return survived


def _chain(name: str, out: Path, most: int, seconds: float, rng: random.Random) -> int:
    """Kill and resume until the work is done; returns how many kills there were."""
    for killed in range(most):
        child = _start(name, out)
        try:
            child.wait(rng.uniform(0, seconds))
            return killed
        except subprocess.TimeoutExpired:
            child.send_signal(signal.SIGKILL)
            child.wait()
    _finish(name, out)
    return most


def _rows(results: dict[str, int], kills: int, seed: int) -> list[Row]:
    note = f"seed {seed}"
    return [at_least(WHAT.format(name), kills, survived, f"of {kills}", note) for name, survived in results.items()]


def _total() -> list[Row]:
    """The sum over all kinds, once each has a published row."""
    path = RESULTS / "reliability.json"
    published = {row["what"]: row for row in json.loads(path.read_text())} if path.exists() else {}
    rows = [published.get(WHAT.format(name)) for name in KINDS]
    if None in rows:
        return []
    asked = sum(int(row["asked"].split()[-1]) for row in rows)
    survived = sum(row["measured"] for row in rows)
    return [at_least("kill -9, all kinds of work: equal bytes", asked, survived, f"of {asked}")]


def main(argv: list[str]) -> int:
    """Measure and publish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=8, help="kills of each kind (default: 8)")
    parser.add_argument("--only", help=f"some of {','.join(KINDS)}")
    parser.add_argument("--seed", type=int, help="of the moments (default: another each time)")
    parser.add_argument("--quick", action="store_true", help="two kills of the sequence; writes nothing")
    parser.add_argument("--child", nargs=2, metavar=("KIND", "FOLDER"), help=argparse.SUPPRESS)
    arguments = parser.parse_args(argv)
    if arguments.child:
        return _child(*arguments.child)
    names = chosen("--only", arguments.only or ("sequence" if arguments.quick else None), KINDS)
    seed = random.SystemRandom().randrange(1 << 31) if arguments.seed is None else arguments.seed
    kills = 2 if arguments.quick else arguments.kills
    print(f"seed {seed}")
    with tempfile.TemporaryDirectory(prefix="lightwell-kills-") as folder:
        results = {}
        for name in names:
            own = Path(folder) / name
            own.mkdir()
            results[name] = measure(name, kills, random.Random(f"{seed} {name}"), own)
            # Published one by one: a run of all kinds takes long.
            publish("reliability", _rows(results, kills, seed), arguments.quick)
    if not arguments.quick:
        publish("reliability", _total(), False)
    return 0


def _child(name: str, folder: str) -> int:

    print("begun", flush=True)
    KINDS[name].run(Path(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
