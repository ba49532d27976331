"""The figures of learned light probes, measured side by side on this machine.

python benchmarks/light_probes.py                    every figure; writes results/light_probes.json (half an hour); goes
                                                     on where it was stopped (trials are kept in out/light_probes)
python benchmarks/light_probes.py --quick            a smoke run; writes nothing
python benchmarks/light_probes.py --only s1-5,time   parts: scenes of tools/leak_scenes.py (s1-5-lamps: the
                                                     light straight from the lamps counts, too), two-rooms, zdm2,
                                                     godot-room, veach-ajar, memory, time, browser, weights, rebake
python benchmarks/light_probes.py --offsets 2        fewer lattice offsets (8 by default)
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
from dataclasses import asdict, fields, replace
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from leak_scenes import SCENES, LeakScene
from probe_trial import BUDGET, Queries, mean, queries, trial
from rows import Row, at_least, at_most, chosen, of_gpu, publish, without_bar
from zoo_scenes import scenes as zoo_scenes

from lightwell.probes.metrics import Scores, score
from lightwell.probes.samples import ProbeSampling

ROOT = Path(__file__).resolve().parents[1]
# Scenes of files whose leaks are measured: spacing in metres.
FILES = {"zdm2": 4.0, "godot-room": 1.5, "veach-ajar": 1.0}
OFFSETS, SEED = 8, 1
# Trials that were run, by what they depend on: a benchmark that is stopped goes on where it was.
TRIALS = ROOT / "out/light_probes"
# Offsets on which the network without a lattice is trained, and its steps.
NET_OFFSETS, NET_STEPS = 1, 1500
LAMPS = "-lamps"
# Scenes in which the feature volume is compared with probes, and the end of the names of these parts. Scenes of files
# have their probes as far apart as a bake's.
OF_FILES = (
    "bevy-cornell",
    "drake-living-room",
    "godot-living-room",
    "godot-room",
    "kenney-fps-level",
    "living-room-2",
    "pyraxia-hallway",
    "recast-dungeon",
    "staircase2",
    "veach-ajar",
    "zdm2",
)
COMPARED, VOLUME = ("s1-5", "s2", "s3", "s5", "two-rooms", *OF_FILES), "-volume"
# Modules that no trial asks.
UNASKED = ("generator", "file", "keep", "page", "lower", "code", "mlp", "product", "refine")


def _leak_scene(name: str) -> tuple[LeakScene, bool] | None:
    """A scene of the protocol by name, and whether light straight from its emitters counts: that of lamps is the
    renderer's, as in every bake of a declared light. None where its file is absent."""
    base = name.removesuffix(LAMPS)
    if base in SCENES:
        made = SCENES[base]()
        counted = name != base or base == "s6"
        return (replace(made, name=f"{made.name}, lamps counted") if name != base else made), counted
    from lightwell.scenes import load
    from lightwell.scenes.default_light import under_sky, with_lamp
    from lightwell.scenes.free_air import free_air
    from lightwell.scenes.placing import initial_light
    from lightwell.scenes.variables import declare
    from lightwell.transport.point_rejection import _escape_share

    source = "two-rooms"
    if name != source:
        source = zoo_scenes().get(name, "")
        if not source:
            return None
    scene, direct = load(source), True
    if not scene.has_static_light:
        if name == "two-rooms":
            scene, direct = with_lamp(scene, (-1.6, 2.0, 0.0)), False
        elif _escape_share(scene) > 0.005:
            scene = under_sky(scene)
        else:
            variable = declare((), scene)
            scene, direct = with_lamp(scene, initial_light(scene, variable, scene.cameras[0])), False
    free_air(scene)
    side = (lambda x: (x[:, 0] > 0).astype(int)) if name == "two-rooms" else (lambda x: np.zeros(len(x), int))
    return LeakScene(name, scene, side, tuple(scene.core)), direct


def scene_rows(name: str, quick: bool, offsets: int) -> list[Row]:
    """Errors and leaks of one scene over the lattice offsets."""
    found = _leak_scene(name)
    if found is None:
        return [at_most(f"{name}: sMAPE over trilinear's", 0.5, None, "ratio", "the scene is not on this machine")]
    made, direct = found
    spacing, large = FILES[name] if name in FILES else 1.0, name in FILES
    # The reference is the dearest part: its noise must stay well below what is told apart. Scenes from files are
    # larger: fewer paths and bricks.
    asked = _queries(name, made, 200 if quick else 3000, 64 if quick else 4096 if large else 8192, direct, quick)
    effort = ProbeSampling(32, 256, 2048, direct)
    if quick or large:
        effort = ProbeSampling(8, 16, 32, direct, 1) if quick else ProbeSampling(24, 64, 512, direct, 8)
    rng, budget = np.random.default_rng(SEED), 2.0 if large else BUDGET
    trials = []
    for k in range(offsets):
        net = (2 if quick else NET_STEPS) if k < NET_OFFSETS and not large else 0
        trials.append(_trial(name, made, asked, spacing, rng.random(3), effort, k, budget, net, quick))
    floor = score(asked.truth, asked.again, np.where(asked.near < 0.5 * spacing, asked.region, -1))
    rows = [row for method in ("ours", "relu-field") for row in _compared(made.name, method, trials, asked, floor)]
    return rows + _against_network(made.name, trials)


def _queries(name: str, made: LeakScene, count: int, paths: int, direct: bool, quick: bool = False) -> Queries:
    """The queries of a scene with their reference, or what is kept of them."""
    parts = [(ROOT / path).read_bytes() for path in ("benchmarks/probe_trial.py", "lightwell/probes/trace.py")]
    parts.append(repr((made.scene.digest, count, paths, direct)).encode())
    path = TRIALS / f"{name}-{hashlib.sha256(b''.join(parts)).hexdigest()[:16]}.npz"
    if path.is_file():
        with np.load(path, allow_pickle=False) as kept:
            return Queries(**kept)
    asked = queries(made, count, paths, direct=direct)
    if quick:
        return asked
    TRIALS.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{field.name: getattr(asked, field.name) for field in fields(asked)})
    return asked


def _trial(name, made, asked, spacing, offset, effort, seed, budget, net, quick) -> dict:
    """One trial, or what is kept of it."""
    sources = sorted((ROOT / "lightwell/probes").rglob("*.py"))
    parts = [path.read_bytes() for path in sources if not path.name.startswith(UNASKED)]
    parts += [
        (ROOT / "benchmarks/probe_trial.py").read_bytes(),
        repr((asked.truth.sum(), effort, budget, net)).encode(),
    ]
    path = TRIALS / f"{name}-{seed}-{hashlib.sha256(b''.join(parts)).hexdigest()[:16]}.json"
    if not quick and path.is_file():
        kept = json.loads(path.read_text())
        return {k: v if k == "cost" else Scores(**v) for k, v in kept.items()}
    found = trial(made, asked, spacing, offset, ("relu-field",), effort, seed, budget, net)
    if not quick:
        TRIALS.mkdir(parents=True, exist_ok=True)
        plain = {k: v if k == "cost" else asdict(v) for k, v in found.items()}
        path.write_text(json.dumps(plain, default=float))
        print(f"{name}: offset {seed}", file=sys.stderr)
    return found


def _against_network(label: str, trials: list[dict]) -> list[Row]:
    """Ours over a small network of as many bytes, where one was trained."""
    both = [(t["ours"], t["network"]) for t in trials if "network" in t]
    if not both:
        return []
    ours, net = zip(*both)
    note = f"sMAPE {mean(ours, 'smape'):.4f}, network {mean(net, 'smape'):.4f}"
    note += f"; bright leak {mean(ours, 'bright_worst'):.4f}, network {mean(net, 'bright_worst'):.4f}"
    note += f"; {NET_STEPS} steps, {len(both)} offset"
    gain = mean(ours, "log_psnr") - mean(net, "log_psnr")
    what = f"{label}, relu-field with bricks: log-PSNR over a network (x, n) → E of as many bytes"
    return [at_least(what, 0, gain, "dB", note)]


NAMES = {"ours": "relu-field with bricks", "relu-field": "relu-field, no bricks"}


def _compared(label: str, method: str, trials: list[dict], asked, floor: Scores) -> list[Row]:
    of = lambda name: [t[name] for t in trials]  # noqa: E731
    ours, plain, moments, sight = of(method), of("trilinear"), of("ddgi"), of("line of sight")
    what = f"{label}, {NAMES[method]}"
    each = lambda name, measure: mean(of(name), measure)  # noqa: E731
    note = f"{len(trials)} lattice offsets, {len(asked.place)} queries, worst region, mean over offsets"
    leak = [mean(s, "bright_worst") for s in (ours, plain, moments, sight)]
    dark = [mean(s, "dark_worst") for s in (ours, sight, plain, moments)]
    names = ("trilinear", "validity", "facing", "warped", "ddgi", "line of sight")
    listed = ", ".join(f"{name} {each(name, 'smape'):.4f}" for name in (method, *names))
    bricks = np.mean([t["cost"]["bricks"] for t in trials])
    rows = [
        at_most(
            f"{what}: bright leak over trilinear's",
            0.1,
            leak[0] / max(leak[1], 1e-9),
            "ratio",
            f"{note}: {leak[0]:.4f}, trilinear {leak[1]:.4f}, line of sight {leak[3]:.4f}, "
            f"noise {floor.bright_worst:.4f}",
        ),
        at_most(f"{what}: bright leak over DDGI's", 1.0, leak[0] / max(leak[2], 1e-9), "ratio", f"DDGI {leak[2]:.4f}"),
        at_most(
            f"{what}: dark leak over line of sight's",
            0.5,
            dark[0] / max(dark[1], 1e-9),
            "ratio",
            f"{dark[0]:.4f}, line of sight {dark[1]:.4f}, trilinear {dark[2]:.4f}, DDGI {dark[3]:.4f}, "
            f"noise {floor.dark_worst:.4f}",
        ),
        at_most(
            f"{what}: sMAPE over trilinear's, equal spacing",
            0.5,
            mean(ours, "smape") / max(mean(plain, "smape"), 1e-9),
            "ratio",
            f"{listed}, noise {floor.smape:.4f}",
        ),
    ]
    if method == "ours":
        size = [
            np.mean([t["cost"][k] if k != "ours" else t["cost"]["bytes"][k] for t in trials])
            for k in ("ours", "dense bytes")
        ]
        note = f"{mean(ours, 'log_psnr'):.2f} dB of {size[0]:.0f} B ({bricks:.1f} bricks), denser of {size[1]:.0f} B"
        for dense, called in (("dense trilinear", "trilinear's"), ("dense validity", "trilinear + validity's")):
            gain, told = mean(ours, "log_psnr") - each(dense, "log_psnr"), f"{note}: {each(dense, 'log_psnr'):.2f} dB"
            rows.append(at_least(f"{what}: log-PSNR over {called}, equal memory", 3, gain, "dB", told))
    return rows


def query_time(quick: bool) -> list[Row]:
    """Time of a query over that of the baselines, one run, medians."""
    from probe_time import measure

    figures = measure(1 << 14 if quick else 400_000, 2 if quick else 25)
    note = ", ".join(f"{k} {v:.0f}" for k, v in figures.items()) + " ns per query, same harmonics for all, LLVM"
    return [
        at_most(f"query time over DDGI's, {name}", 0.75, figures[name] / figures["ddgi"], "ratio", note)
        for name in ("relu-field", "product-field", "mlp")
    ] + [
        at_most(f"query time over trilinear's, {name}", 3.0, figures[name] / figures["trilinear"], "ratio", note)
        for name in ("relu-field", "mlp")
    ]


def memory(quick: bool) -> list[Row]:
    """Bytes of a probe's record over those of the baseline."""
    from lightwell.probes import ddgi
    from lightwell.probes.volume import LIGHT_BYTES
    from lightwell.probes.weights import FUNCTIONS

    rows = []
    for name in ("relu-field", "relu-field-5", "mlp"):
        size = FUNCTIONS[name].stored + 8 + LIGHT_BYTES["zh3"]
        note = f"{FUNCTIONS[name].stored} B weights + 8 B mask + {LIGHT_BYTES['zh3']} B ZH3; DDGI {ddgi.BYTES} B"
        rows.append(at_most(f"payload over DDGI's bytes, {name}", 0.25, size / ddgi.BYTES, "ratio", note))
    from lightwell.probes.bake import bake_geometry

    parts = bake_geometry(SCENES["s2"]().scene, 1.0, "relu-field").volume.bytes_per_probe()
    size = sum(value for name, value in parts.items() if name != "record")
    note = ", ".join(f"{k} {v:.0f} B" for k, v in parts.items()) + " per live probe of S2"
    rows.append(at_most("payload over DDGI's bytes, every table counted", 0.25, size / ddgi.BYTES, "ratio", note))
    return rows


def weight_time(quick: bool) -> list[Row]:
    """Rays, trust and fit of the weights, scaled to 1,000 live probes; path tracing excluded."""
    from lightwell.probes.bake import bake_geometry

    scene, spacing = SCENES["s2"]().scene, 1.0 if quick else 0.4
    bake_geometry(scene, 1.0, "relu-field")  # compiles the kernels
    wall, busy = perf_counter(), process_time()
    made = bake_geometry(scene, spacing, "relu-field")
    wall, busy = perf_counter() - wall, process_time() - busy
    live = int(made.volume.alive.sum())
    parts = ", ".join(f"{k} {v:.2f} s" for k, v in made.seconds.items())
    note = f"{live} live of {len(made.volume.lattice)} nodes; {parts}; {busy:.2f} s of processor time; convex fit"
    rows = [at_most("weights of 1,000 probes without a generator", 60, wall / live * 1000, "s", note)]
    return rows + _generated(scene, spacing, made)


def _generated(scene, spacing: float, made) -> list[Row]:
    """The same with the generator, a network per probe; and what it loses against fits from scratch."""
    from lightwell.probes.assemble import close_points
    from lightwell.probes.bake import bake_geometry
    from lightwell.probes.generator import fit_with, load
    from lightwell.probes.pattern import pattern
    from lightwell.probes.sheets import cut_off
    from lightwell.probes.support import cube_valid
    from lightwell.probes.weights import FUNCTIONS, error, point_weight, trusted

    generator = load()
    what = "weights of 1,000 probes with the generator (mlp)"
    if generator is None:
        return [at_most(what, 10, None, "s", "the package holds no generator")]
    wall = perf_counter()
    again = bake_geometry(scene, spacing, "mlp", fit=fit_with("mlp"))
    wall = perf_counter() - wall
    live = int(again.volume.alive.sum())
    parts = ", ".join(f"{k} {v:.2f} s" for k, v in again.seconds.items())
    rows = [at_most(what, 10, wall / live * 1000, "s", f"{live} live, {len(again.volume.params)} records; {parts}")]
    level, layout, f = made.levels[0], pattern(), FUNCTIONS["mlp"]
    chosen = np.flatnonzero(made.volume.row[: len(level.nodes)] >= 0)[:16]
    target, valid = made.target[chosen].astype(np.float32), cube_valid(level.support, chosen)
    off = cut_off(level.sheets, level.support, chosen)[:, : level.points]
    weight, close = point_weight(target, layout.hat, valid, off), close_points(level, chosen)
    fits = {"generator": fit_with("mlp"), "scratch": f.fit}
    if len(chosen):
        clock, found = {}, {}
        for name, fit in fits.items():
            start = perf_counter()
            params = fit(target, weight, layout, close)
            clock[name] = 1000 * (perf_counter() - start) / len(chosen)
            rho = trusted(f.values(f.quantised(params), layout.u)[0])
            found[name] = float(error(target, rho, layout.hat, valid & ~off).mean())
        note = ", ".join(f"{n} {found[n]:.4f} in {clock[n]:.1f} ms" for n in fits) + f", {len(chosen)} probes of S2"
        rows.append(
            at_most(
                "mlp: RMSE from the generator over 2,500 steps from scratch",
                1.1,
                found["generator"] / found["scratch"],
                "ratio",
                note,
            )
        )
    return rows


def browser(quick: bool) -> list[Row]:
    """Query time in the browser (headless, a software rasteriser here), learned weights over trilinear ones."""
    import shutil
    import subprocess

    what, gpu = "query time in the browser over trilinear's", "query time over DDGI's on a GPU"
    rows = [of_gpu(gpu, "GPU: query time of probes (mlp) over DDGI's")]
    npx, web = shutil.which("npx"), ROOT / "web"
    if not npx or not (web / "node_modules").is_dir():
        return [at_most(what, 3.0, None, "ratio", "no Node packages on this machine"), *rows]
    result = web / "test-results/probes.json"
    result.unlink(missing_ok=True)
    command = [npx, "vitest", "run", "test/probes.test.ts", "-t", "takes"]
    measure = {**os.environ, "LIGHTWELL_MEASURE": "1"}
    subprocess.run(command, cwd=web, check=False, capture_output=True, timeout=300, env=measure)
    if not result.is_file():
        return [at_most(what, 3.0, None, "ratio", "the browser test gave no times"), *rows]
    found = json.loads(result.read_text())
    clock = found["nanoseconds"]
    note = ", ".join(f"{k} {v:.0f} ns" for k, v in clock.items()) + f" per query, {found['renderer']}"
    rows.append(at_most(what, 3.0, clock["learned"] / clock["trilinear"], "ratio", note))
    for name in ("relu-field", "product-field", "mlp"):
        ratio = clock[f"made up, {name}"] / clock["made up, DDGI"]
        rows.append(without_bar(f"query time in the browser over DDGI's, {name}", ratio, "ratio", note))
    return rows


def rebake_time(quick: bool) -> list[Row]:
    """An edit of one per cent of the volume over the whole bake, weights and light."""
    from lightwell.probes.bake import bake_geometry
    from lightwell.probes.light import light_volume, relit

    scene, spacing = SCENES["s2"]().scene, 1.0 if quick else 0.2
    effort = ProbeSampling(4, 8, 8) if quick else ProbeSampling(16, 64, 128)
    low, high = scene.bounds
    side = 0.01 ** (1 / 3) * (high - low)
    box = np.stack([low + 0.3 * (high - low), low + 0.3 * (high - low) + side])
    # A small bake and re-bake compile the kernels.
    relit(scene, light_volume(scene, bake_geometry(scene, 1.0, "relu-field"), effort, 1), box)
    clock = perf_counter()
    before = light_volume(scene, bake_geometry(scene, spacing, "relu-field"), effort, 1)
    whole, clock = perf_counter() - clock, perf_counter()
    after, _ = relit(scene, before, box)
    part = perf_counter() - clock
    old, new = before.volume, after.volume
    names = ("state", "row", "params", "octant", "fallback", "light")
    same = all(np.array_equal(getattr(old, name), getattr(new, name)) for name in names)
    shut, clock = SCENES["s2-shut"]().scene, perf_counter()
    _, moved = relit(shut, before, np.array([[-0.03, 0, 0.95], [0.03, 2.05, 1.95]]))
    door = perf_counter() - clock
    note = f"{len(old.lattice)} nodes, {part:.2f} of {whole:.2f} s; nothing had changed: same bytes {same}"
    more = f"{door:.2f} s, {len(moved)} probes solved again"
    return [
        at_most("re-bake of 1 % of the volume over the full bake", 0.05, part / whole, "ratio", note),
        at_most("re-bake of a shut door over the full bake", 0.2, door / whole, "ratio", more),
    ]


def volume_rows(name: str, quick: bool, offsets: int) -> list[Row]:
    """The feature volume against probes with bricks in one scene."""
    from probe_volume import SPACING, rows_of

    from lightwell.fields.probes.fit import ALONG
    from lightwell.probes.lattice import default_spacing

    base = name.removesuffix(VOLUME)
    found = _leak_scene(base)
    if found is None:
        return []
    made, direct = found
    spacing = default_spacing(made.scene.core, ALONG) if base in OF_FILES else SPACING
    return rows_of(made.name, made, direct, spacing, quick, min(offsets, 1 if base in OF_FILES else 2))


PARTS = {"browser": browser, "time": query_time, "memory": memory, "weights": weight_time, "rebake": rebake_time}


def main() -> None:
    """Measure the chosen parts and publish their rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a smoke run; writes nothing")
    parser.add_argument("--only", help="comma-separated parts")
    parser.add_argument("--offsets", type=int, default=OFFSETS, help="lattice offsets (default: %(default)s)")
    arguments = parser.parse_args()
    scenes = ["s1-5", "s2", "s3", "s4", "s5", "two-rooms", "s1-5-lamps", "godot-room", "veach-ajar", "zdm2"]
    volumes = [name + VOLUME for name in COMPARED]
    everything = ["memory", "weights", "rebake", "time", "browser", *scenes, *volumes]
    known = [*PARTS, *volumes, *SCENES, *(f"{name}{LAMPS}" for name in SCENES), "two-rooms", *FILES]
    asked = chosen("--only", arguments.only, known) if arguments.only else everything
    names = ["memory", "s1-5"] if arguments.quick and not arguments.only else asked
    for name in names:
        offsets = 1 if arguments.quick else arguments.offsets
        of_scene = volume_rows if name.endswith(VOLUME) else scene_rows
        rows = PARTS[name](arguments.quick) if name in PARTS else of_scene(name, arguments.quick, offsets)
        publish("light_probes", rows, arguments.quick)


if __name__ == "__main__":
    main()
