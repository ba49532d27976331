# ruff: noqa: B023  (functions made in loops are called at once)
"""The figures of the radiance cache, measured side by side on this machine.

    python benchmarks/radiance_cache.py                     every figure; about two hours on 2 quiet cores
    python benchmarks/radiance_cache.py --quick             a smoke run of the parts; writes nothing
    python benchmarks/radiance_cache.py --only equal,frame  some parts
    python benchmarks/radiance_cache.py --scenes veach-ajar

Equal time: both sides render the same number of samples per pixel, the time of ours includes its training, and the gain
is error times time of Mitsuba's ``path`` over error times time of ours (the error of a path tracer falls as one over
time). Kernels are compiled before the clock starts, on both sides. relMSE is mean((I - R)^2 / (R^2 + 0.01)).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from rows import RESULTS, Row, at_least, at_most, publish, without_bar

from lightwell.backend import dr, mi
from lightwell.cache import NrcIntegrator, RadianceCache, settings_of

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT.parent / "shared" / "scenes" / "mitsuba"
NAMES = ("veach-ajar", "living-room-2", "staircase2", "veach-bidir", "cornell-box")
EPSILON = 0.01
# Samples per pixel of a comparison, repeats, edge of the pictures, and samples of a reference.
SPP, REPEATS, SIZE, REFERENCE = 64, 5, 256, 4096
QUICK = {"spp": 8, "repeats": 1, "size": 24, "reference": 64}
STILL = {"mode": "still"}
# Ladder of ingredients, each with what it changes.
LADDER: dict[str, dict[str, Any]] = {
    "PT, our sampling": {"termination_c": "inf"},
    "PT + ReSTIR": {"termination_c": "inf", "first_hit": "restir-di"},
    "+ NRC": {},
    "+ NRC + ReSTIR": {"first_hit": "restir-di"},
    "self-training off": {"unbiased_fraction": 1.0},
    "averaging off": {"ema_decay": 0.0},
    "frequency encoding": {"encoding": "frequency", "hidden": 64},
    "factorisation off": {"factorise": False},
}


def scene_of(name: str, size: int, box: bool = False) -> Any:
    """A given scene at about size^2 pixels; None where it is not on this machine."""
    path = SCENES / name / "scene_mi3.xml"
    if not path.exists():
        return None
    scene = mi.load_file(str(path))
    film = scene.sensors()[0].film()
    width, height = (int(x) for x in film.size())
    scale = size / np.sqrt(width * height)
    parameters = mi.traverse(scene.sensors()[0])
    parameters["film.size"] = [round(width * scale), round(height * scale)]
    parameters.update()
    return scene


def path_tracer() -> Any:
    """Mitsuba's own, unlimited depth."""
    return mi.load_dict({"type": "path", "max_depth": -1})


def reference(name: str, scene: Any, size: int, spp: int) -> np.ndarray:
    """A path-traced picture, kept in benchmarks/results/references (not in the repository)."""
    folder = RESULTS / "references"
    path = folder / f"{name}-{size}-{spp}.npy"
    if path.exists():
        return np.load(path)
    total, chunk = 0.0, 64
    for k in range(-(-spp // chunk)):
        total = total + pixels(mi.render(scene, integrator=path_tracer(), spp=chunk, seed=10_000 + k)).astype(float)
    picture = (total / -(-spp // chunk)).astype(np.float32)
    folder.mkdir(parents=True, exist_ok=True)
    np.save(path, picture)
    return picture


def pixels(image: Any) -> np.ndarray:
    """[H, W, 3]."""
    return np.array(image)[..., :3]


def rel_mse(picture: np.ndarray, truth: np.ndarray) -> float:
    """Relative mean squared error, all channels alike."""
    return float(np.mean((picture - truth) ** 2 / (truth**2 + EPSILON)))


def timed(run: Callable[[], Any]) -> tuple[np.ndarray, float, float]:
    """(picture, wall seconds, processor seconds)."""
    wall, cpu = time.perf_counter(), time.process_time()
    image = run()
    dr.eval(image)
    dr.sync_thread()
    return pixels(image), time.perf_counter() - wall, time.process_time() - cpu


def cold(options: dict[str, Any], scene: Any) -> NrcIntegrator:
    """A new integrator whose tables of the scene are ready and which has learned nothing."""
    nrc = NrcIntegrator(settings=settings_of(options))
    nrc.cache_of(scene)
    return nrc


def compare(name: str, options: dict[str, Any], plan: dict[str, int]) -> dict[str, float] | None:
    """Medians of error, wall and processor time of both sides, in turns."""
    scene = scene_of(name, plan["size"])
    if scene is None:
        return None
    truth = reference(name, scene, plan["size"], plan["reference"])
    spp = plan["spp"]
    mi.render(scene, integrator=path_tracer(), spp=spp, seed=1)
    mi.render(scene, integrator=cold(options, scene), spp=spp, seed=1)
    rows = []
    for seed in range(plan["repeats"]):
        nrc = cold(options, scene)
        ours, wall, cpu = timed(lambda nrc=nrc, seed=seed: mi.render(scene, integrator=nrc, spp=spp, seed=100 + seed))
        theirs, wall_pt, cpu_pt = timed(
            lambda seed=seed: mi.render(scene, integrator=path_tracer(), spp=spp, seed=200 + seed)
        )
        rows.append([rel_mse(ours, truth), wall, cpu, nrc.seconds["train"], rel_mse(theirs, truth), wall_pt, cpu_pt])
    error, wall, cpu, train, error_pt, wall_pt, cpu_pt = np.median(rows, axis=0)
    return {
        "error": error, "wall": wall, "cpu": cpu, "train": train, "error_pt": error_pt, "wall_pt": wall_pt,
        "gain": error_pt * wall_pt / (error * wall), "gain_cpu": error_pt * cpu_pt / (error * cpu),
    }  # fmt: skip


def _told(f: dict[str, float], plan: dict[str, int]) -> str:
    return (
        f"{plan['spp']} spp, {plan['size']}^2, {plan['repeats']} repeats: {f['error']:.3g} in {f['wall']:.2f} s "
        f"({f['train']:.2f} s training) against {f['error_pt']:.3g} in {f['wall_pt']:.2f} s; "
        f"by processor time {f['gain_cpu']:.2f}"
    )


def equal(names: list[str], plan: dict[str, int]) -> list[Row]:
    """Equal-time error of stills, cold start, training included."""
    rows, gains = [], {}
    for name in names:
        figures = compare(name, STILL, plan)
        if figures is None:
            continue
        gains[name] = figures["gain"]
        bar = 15 if name == "veach-ajar" else 0.9
        rows.append(at_least(f"equal time: relMSE of path over ours, {name}", bar, figures["gain"], "ratio",
                             _told(figures, plan)))  # fmt: skip
    whole = set(gains) == set(NAMES)
    mean = float(np.exp(np.mean(np.log(list(gains.values()))))) if whole else None
    rows.append(at_least("equal time: geometric mean of the five scenes", 5, mean, "ratio"))
    return rows


def frame(names: list[str], plan: dict[str, int]) -> list[Row]:
    """Milliseconds of a warm one-sample frame, training included, over a 1-spp frame of path."""
    rows = []
    for name in names:
        scene = scene_of(name, plan["size"])
        if scene is None:
            continue
        nrc = cold({"mode": "frames", "budget": "low"}, scene)
        for seed in range(4):
            mi.render(scene, integrator=nrc, spp=1, seed=seed)
            mi.render(scene, integrator=path_tracer(), spp=1, seed=seed)
        times = []
        for seed in range(3 if plan["repeats"] == 1 else 20):
            _, wall, cpu = timed(lambda seed=seed: mi.render(scene, integrator=nrc, spp=1, seed=seed))
            _, wall_pt, cpu_pt = timed(lambda seed=seed: mi.render(scene, integrator=path_tracer(), spp=1, seed=seed))
            times.append([wall, cpu, wall_pt, cpu_pt, nrc.seconds["train"]])
        wall, cpu, wall_pt, cpu_pt, train = 1e3 * np.median(times, axis=0)
        note = f"{wall:.0f} ms ({train:.0f} training) against {wall_pt:.0f}; by processor time {cpu / cpu_pt:.2f}"
        what = f"frame: time of a 1-sample frame over path's, {name}"
        large = name in ("veach-ajar", "living-room-2")  # >= 100 k triangles
        make = (
            (lambda w, v, n: at_most(w, 1.0, v, "ratio", n))
            if large
            else (lambda w, v, n: without_bar(w, v, "ratio", n))
        )
        rows.append(make(what, wall / wall_pt, note))
    return rows


def unbiased(names: list[str], plan: dict[str, int]) -> list[Row]:
    """z-test of the unbiased mode against the path tracer, and its equal-time variance."""
    rows = []
    options = {**STILL, "estimator": "residual", "residual_probability": 0.5}
    repeats = max(3, 3 * plan["repeats"])
    for name in names:
        scene = scene_of(name, plan["size"])
        if scene is None:
            continue
        nrc = cold(options, scene)
        spp = plan["spp"]
        mi.render(scene, integrator=nrc, spp=spp, seed=1)
        nrc.cache.freeze()
        nrc.settings = nrc.settings.changed(mode="frames")
        ours, theirs, times = [], [], []
        for seed in range(repeats):
            a, wall, _ = timed(lambda seed=seed: mi.render(scene, integrator=nrc, spp=spp, seed=300 + seed))
            b, wall_pt, _ = timed(
                lambda seed=seed: mi.render(scene, integrator=path_tracer(), spp=spp, seed=600 + seed)
            )
            ours.append(a)
            theirs.append(b)
            times.append([wall, wall_pt])
        a, b = np.array(ours), np.array(theirs)
        means = a.mean(axis=(1, 2, 3)), b.mean(axis=(1, 2, 3))
        z = (means[0].mean() - means[1].mean()) / np.sqrt(sum(m.var(ddof=1) for m in means) / repeats)
        truth = b.mean(axis=0)
        variance = [float(np.mean(x.var(axis=0, ddof=1) / (truth**2 + EPSILON))) for x in (a, b)]
        wall, wall_pt = np.median(times, axis=0)
        rows.append(at_most(f"unbiased: |z| of the mean against path, {name}", 2.576, abs(float(z)), "sigma",
                            f"{repeats} pictures of {spp} spp on both sides"))  # fmt: skip
        gain = variance[1] * wall_pt / (variance[0] * wall)
        rows.append(without_bar(f"unbiased: equal-time variance of path over ours, {name}", gain, "ratio",
                                "cache trained before; asked: >= 1.5 on two scenes"))  # fmt: skip
    return rows


def lag(names: list[str], plan: dict[str, int]) -> list[Row]:
    """Frames to 1.1 x the steady error of the cache from cold; frames to regain 90 % after a light switch; drift."""
    rows = []
    name = "cornell-box"
    scene = scene_of(name, plan["size"])
    if scene is None or name not in names:
        return rows
    frames, steady = (6, 2) if plan["repeats"] == 1 else (120, 20)
    from lightwell.cache.views import view

    sensor = scene.sensors()[0]
    cache = RadianceCache(settings_of({"mode": "frames"}))
    cache.prepare(scene)
    spp = max(1, plan["spp"] // 8)

    def errors(count: int) -> list[np.ndarray]:
        shown = []
        for _ in range(count):
            with dr.suspend_grad():
                cache.train_frame(scene, sensor, 1)
                shown.append(view(scene, sensor, cache, "cache", spp, 5))
        return shown

    first = errors(frames)
    truth = reference(name, scene, plan["size"], plan["reference"])
    curve = np.array([rel_mse(x, truth) for x in first])
    settled = np.median(curve[-steady:])
    cold_frames = int(np.argmax(curve <= 1.1 * settled)) + 1
    note = f"steady error {settled:.3g}, after 8 frames {curve[min(7, len(curve) - 1)]:.3g}"
    rows.append(
        at_most(
            "cold start: frames to 1.1 x the steady error of the cache view, Cornell box",
            8,
            cold_frames,
            "frames",
            note,
        )
    )
    parameters = mi.traverse(scene)
    key = next(k for k in parameters.keys() if k.endswith("radiance.value"))
    parameters[key] = parameters[key] * 0.1
    parameters.update()
    after = errors(frames)
    gap = np.array([abs(float(x.mean()) - 0.1 * float(truth.mean())) for x in after])
    start = 0.9 * float(truth.mean())
    t90 = int(np.argmax(gap <= 0.1 * start)) + 1
    rows.append(at_most("light switch: frames to regain 90 % of the gap (mean of the cache view), Cornell box", 8, t90,
                        "frames", f"lamp to a tenth; changes noticed: {cache.changes}"))  # fmt: skip
    return rows


def drift(names: list[str], plan: dict[str, int]) -> list[Row]:
    """Mean of the cache view over many static frames."""
    name = "cornell-box"
    scene = scene_of(name, min(plan["size"], 128))
    if scene is None or name not in names:
        return []
    from lightwell.cache.views import view

    frames = 12 if plan["repeats"] == 1 else 2000
    sensor = scene.sensors()[0]
    cache = RadianceCache(settings_of({"mode": "frames", "budget": "low"}))
    cache.prepare(scene)
    means = []
    for k in range(frames):
        with dr.suspend_grad():
            cache.train_frame(scene, sensor, 1)
            if k % max(frames // 40, 1) == 0:
                means.append(float(view(scene, sensor, cache, "cache", 4, 5).mean()))
    half = len(means) // 2
    change = abs(np.mean(means[-half // 2 :]) / np.mean(means[half : -half // 2 or None]) - 1)
    return [
        at_most("drift: change of the mean over the last half of 2,000 static frames", 0.02, float(change), "ratio")
    ]


def denoise(names: list[str], plan: dict[str, int]) -> list[Row]:
    """Equal-time error with Open Image Denoise on both sides (box filter, same guides)."""
    from lightwell.cache.denoising import denoised
    from lightwell.cache.views import guides

    rows, gains = [], []
    for name in names:
        scene = scene_of(name, plan["size"])
        if scene is None:
            continue
        film = scene.sensors()[0].film()
        width, height = (int(x) for x in film.size())
        fov = float(mi.traverse(scene.sensors()[0])["x_fov"][0])
        sensor = mi.load_dict({
            "type": "perspective", "to_world": scene.sensors()[0].world_transform(), "fov": fov,
            "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": plan["spp"]},
        })  # fmt: skip
        pt, spp = path_tracer(), max(4, plan["spp"] // 4)
        truth = np.mean([pixels(mi.render(scene, sensor=sensor, integrator=pt, spp=64, seed=900 + k))
                         for k in range(max(1, plan["reference"] // 256))], axis=0)  # fmt: skip
        mi.render(scene, sensor=sensor, integrator=cold(STILL, scene), spp=spp, seed=1)
        found = []
        for seed in range(plan["repeats"]):
            nrc = cold(STILL, scene)
            a, wall, _ = timed(lambda nrc=nrc: mi.render(scene, sensor=sensor, integrator=nrc, spp=spp, seed=seed))
            # The path tracer gets as many samples as fit into the same time.
            _, one, _ = timed(lambda: mi.render(scene, sensor=sensor, integrator=pt, spp=spp, seed=seed))
            more = max(1, round(spp * wall / one))
            b, _, _ = timed(lambda: mi.render(scene, sensor=sensor, integrator=pt, spp=more, seed=50 + seed))
            albedo, normal = guides(scene, sensor, nrc.cache, seed)
            found.append(rel_mse(denoised(b, albedo, normal), truth) / rel_mse(denoised(a, albedo, normal), truth))
        gains.append(float(np.median(found)))
        rows.append(without_bar(f"denoised: relMSE of path over ours at equal time, {name}", gains[-1], "ratio"))
    mean = float(np.exp(np.mean(np.log(gains)))) if len(gains) == len(NAMES) else None
    rows.append(at_least("denoised: geometric mean of the five scenes", 2, mean, "ratio"))
    return rows


def ladder(names: list[str], plan: dict[str, int]) -> list[Row]:
    """Error and time of each rung; written to results/radiance_cache_ladder.json for the table and plot in docs."""
    table = []
    for name in names:
        for rung, options in LADDER.items():
            figures = compare(name, {**STILL, **options}, {**plan, "repeats": min(plan["repeats"], 3)})
            if figures is None:
                continue
            table.append({"scene": name, "rung": rung, **{k: float(f"{v:.4g}") for k, v in figures.items()}})
            print(f"ladder {name:<14} {rung:<22} gain {figures['gain']:.2f}", flush=True)
    if table and plan is not QUICK:
        path = RESULTS / "radiance_cache_ladder.json"
        old = json.loads(path.read_text()) if path.exists() else []
        done = {(r["scene"], r["rung"]) for r in table}
        path.write_text(json.dumps([r for r in old if (r["scene"], r["rung"]) not in done] + table, indent=1) + "\n")
    return []


def gpu(names: list[str], plan: dict[str, int]) -> list[Row]:
    """Milliseconds of the cache per 1080p frame on a GPU; the published figure is 2.6 ms on an RTX 3090."""
    what = "GPU: cache overhead per 1080p frame (published: 2.6 ms, RTX 3090)"
    return [without_bar(what, None, "ms", "no GPU on this machine")]


PARTS = {"equal": equal, "frame": frame, "unbiased": unbiased, "lag": lag, "drift": drift, "denoise": denoise,
         "ladder": ladder, "gpu": gpu}  # fmt: skip


def main() -> None:
    """Measure the parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="smoke run; writes nothing")
    parser.add_argument("--only", default=",".join(PARTS), help="parts, comma-separated")
    parser.add_argument("--scenes", default=",".join(NAMES), help="scenes, comma-separated")
    parser.add_argument("--spp", type=int, default=SPP)
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument("--reference", type=int, default=REFERENCE, help="samples per pixel of the truth")
    arguments = parser.parse_args()
    plan = {"spp": arguments.spp, "repeats": arguments.repeats, "size": SIZE, "reference": arguments.reference}
    names = arguments.scenes.split(",")
    if arguments.quick:
        plan, names = QUICK, ["cornell-box"]
    for part in arguments.only.split(","):
        publish("radiance_cache", PARTS[part](names, plan), arguments.quick)


if __name__ == "__main__":
    main()
