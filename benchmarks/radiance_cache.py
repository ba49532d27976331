"""The figures of the radiance cache, measured side by side on this machine.

    python benchmarks/radiance_cache.py                     all but the long ones; about 20 minutes on 2 quiet cores
    python benchmarks/radiance_cache.py --quick             a smoke run of the parts; writes nothing
    python benchmarks/radiance_cache.py --only equal,frame  some parts
    python benchmarks/radiance_cache.py --resume            take scenes that are measured already from out/figures
    python benchmarks/radiance_cache.py --only table --resume   16 scenes, see radiance_cache_table.py; an hour
    python benchmarks/radiance_cache.py --only denoise,blend,cold,warm --resume    denoised pictures, starts; an hour

References are made once, by radiance_cache_truth.py, and kept in out/references (another ten minutes). The ladder of
ingredients is radiance_cache_ladder.py.

Equal time: Mitsuba's ``path`` renders ``--spp`` samples; ours gets the wall time that this took, its training included
(``seconds=``). Kernels are compiled before the clock starts, on both sides. relMSE is mean((I - R)^2 / (R^2 + 0.01)).
Every scene has a process of its own: virtual calls reach the materials of all scenes that a process holds.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from radiance_cache_live import measure as live_figures
from radiance_cache_rows import (
    LIVE_SCENES,
    LIVE_SIZE,
    blend_rows,
    denoise_rows,
    drift_rows,
    equal_rows,
    frame_rows,
    gpu_rows,
    lag_rows,
    live_rows,
    parts_rows,
    unbiased_rows,
    write_page,
)
from radiance_cache_runs import cold, timed
from radiance_cache_starts import WARM_SCENES, cold_rows, cold_start, stays, warm, warm_rows
from radiance_cache_table import HALVES, errors, table, table_rows
from radiance_cache_truth import (
    EPSILON,
    NAMES,
    ROOT,
    Truth,
    path_tracer,
    scene_of,
    source_of,
    truth_of,
)
from rows import chosen, publish

from lightwell.backend import dr, mi
from lightwell.cache import NrcIntegrator, RadianceCache, settings_of

FIGURES = ROOT / "out" / "figures"
# Scenes whose error varies by a third from still to still: more repeats, so that the median stands.
REPEATS = {"veach-ajar": 11}
PLAN = {"spp": 128, "repeats": 5, "size": 256, "reference": 1024, "quick": 0}
QUICK = {"spp": 4, "repeats": 1, "size": 24, "reference": 64, "quick": 1}
STILL: dict[str, Any] = {"mode": "still"}
Figures = dict[str, Any]


def frozen(options: Figures, scene: Any, sensor: Any, frames: int) -> NrcIntegrator:
    """An integrator with a cache that has learned for so many large frames and learns no more."""
    nrc = cold({**options, "mode": "still", "warmup": frames}, scene)
    nrc.warm_up(scene, sensor, 1, 1)
    nrc.cache.freeze()
    nrc.settings = nrc.settings.changed(mode="frames")
    return nrc


def box_sensor(scene: Any, spp: int) -> Any:
    """The scene's sensor with a box filter, as the denoiser wants it."""
    film = scene.sensors()[0].film()
    width, height = (int(x) for x in film.size())
    pose = mi.ScalarTransform4f(np.array(scene.sensors()[0].world_transform().matrix).reshape(4, 4))
    return mi.load_dict({
        "type": "perspective", "to_world": pose,
        "fov": float(mi.traverse(scene.sensors()[0])["x_fov"][0]),
        "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
        "sampler": {"type": "independent", "sample_count": spp},
    })  # fmt: skip


# ------------------------------------------------------------------ figures of one scene, in a process of its own


def race(scene: Any, sensor: Any, options: Figures, plan: Figures, truth: Truth, after: Callable | None = None):
    """Medians of error and wall time of both sides, in turns; ``after`` works on theirs, in their time."""
    pt, spp = path_tracer(), plan["spp"]
    _, seconds = timed(lambda: mi.render(scene, sensor=sensor, integrator=pt, spp=spp, seed=1))
    ours = lambda seconds: cold({**STILL, **options, "seconds": seconds}, scene)  # noqa: E731
    # Twice: recordings are made in the first, kernels of all sizes by the second.
    for _ in range(2):
        mi.render(scene, sensor=sensor, integrator=ours(max(seconds, 0.2)), spp=1, seed=1)
    rows = []
    for seed in range(plan["repeats"]):
        theirs, wall_pt = timed(
            lambda seed=seed: mi.render(scene, sensor=sensor, integrator=pt, spp=spp, seed=200 + seed)
        )
        nrc = ours(wall_pt)
        picture, wall = timed(
            lambda nrc=nrc, seed=seed: mi.render(scene, sensor=sensor, integrator=nrc, spp=1, seed=100 + seed)
        )
        if after:
            start = time.perf_counter()
            theirs = after(nrc, theirs, seed)
            wall_pt += time.perf_counter() - start
        done, found, beside = nrc.last, errors(truth, picture), errors(truth, theirs)
        rows.append([
            truth.error(picture), wall, done.seconds["train"], done.rendered.samples, truth.error(theirs), wall_pt,
            found["FLIP"], beside["FLIP"],
        ])  # fmt: skip
    error, wall, train, samples, error_pt, wall_pt, flip, flip_pt = (float(x) for x in np.median(rows, axis=0))
    return {"error": error, "wall": wall, "train": train, "samples": samples, "error_pt": error_pt, "wall_pt": wall_pt,
            "gain": error_pt * wall_pt / (max(error, 1e-9) * wall), "repeats": len(rows), "flip": flip,
            "flip_pt": flip_pt}  # fmt: skip


def equal(name: str, scene: Any, plan: Figures) -> Figures:
    """Equal-time error of stills, cold start, training included."""
    sensor = scene.sensors()[0]
    if not plan["quick"]:
        plan = {**plan, "repeats": max(plan["repeats"], REPEATS.get(name, 0))}
    return race(scene, sensor, {}, plan, truth_of(name, scene, sensor, plan["size"], plan["reference"]))


def denoise(name: str, scene: Any, plan: Figures, **options: Any) -> Figures:
    """The same with Open Image Denoise on both sides (box filter, same guides, in the time of both)."""
    from lightwell.cache.views import guides
    from lightwell.core.denoise import denoise as denoised

    plan = {**plan, "repeats": min(plan["repeats"], 3), "spp": max(4, plan["spp"] // 2)}
    sensor = box_sensor(scene, plan["spp"])
    truth = truth_of(name, scene, sensor, plan["size"], plan["reference"] // 2, "-box")

    def after(nrc, picture, seed):
        return denoised(picture, *guides(scene, sensor, nrc.cache, seed))

    return race(scene, sensor, {"denoise": True, **options}, plan, truth, after)


def blend(name: str, scene: Any, plan: Figures) -> Figures:
    """The same with our side blended with the cache's view."""
    return denoise(name, scene, plan, denoise_cache=True)


# What a still does beside the network, changed one at a time.
CHANGES: dict[str, Figures] = {
    "as shipped": {}, "no local level": {"local_level": False}, "caustics whole": {"spike_cap": 0.0},
    "never a guide": {"guide": "never"}, "always a guide": {"guide": "always"},
}  # fmt: skip


def parts(name: str, scene: Any, plan: Figures) -> Figures:
    """Equal-time error of stills in half the time of ``equal``, with one thing changed."""
    plan = {**plan, "repeats": min(plan["repeats"], 3), "spp": max(4, plan["spp"] // 2)}
    sensor = scene.sensors()[0]
    truth = truth_of(name, scene, sensor, plan["size"], plan["reference"])
    return {change: race(scene, sensor, options, plan, truth) for change, options in CHANGES.items()}


def frame(name: str, scene: Any, plan: Figures) -> Figures:
    """Milliseconds of a warm one-sample frame, training included, and of a 1-spp frame of path."""
    nrc = cold({"mode": "frames", "budget": "low"}, scene)
    times = []
    for seed in range(3 if plan["quick"] else 40):
        _, wall = timed(lambda seed=seed: mi.render(scene, integrator=nrc, spp=1, seed=seed))
        _, wall_pt = timed(lambda seed=seed: mi.render(scene, integrator=path_tracer(), spp=1, seed=seed))
        times.append([1e3 * wall, 1e3 * wall_pt, 1e3 * nrc.last.seconds["train"]])
    wall, wall_pt, train = (float(x) for x in np.median(times[len(times) // 2 :], axis=0))
    triangles = sum(int(shape.primitive_count()) for shape in scene.shapes())
    return {"wall": wall, "wall_pt": wall_pt, "train": train, "triangles": triangles}


def unbiased(name: str, scene: Any, plan: Figures) -> Figures:
    """z of the mean against the path tracer's, and variance at equal time: stills by the clock with a cold guide, its
    training in their time."""
    sensor, spp = scene.sensors()[0], max(1, plan["spp"] // 2)
    pt, repeats = path_tracer(), 3 if plan["quick"] else 12
    theirs_at = lambda seed: timed(  # noqa: E731
        lambda: mi.render(scene, sensor=sensor, integrator=pt, spp=spp, seed=seed)
    )
    _, seconds = theirs_at(1)
    sides: list[list[np.ndarray]] = [[], []]
    rows = []
    for seed in range(-2, repeats):  # The first two make recordings and kernels.
        b, wall_pt = theirs_at(603 + seed)
        nrc = cold({**STILL, "estimator": "guided", "seconds": max(wall_pt if seed >= 0 else seconds, 0.1)}, scene)
        a, wall = timed(
            lambda nrc=nrc, seed=seed: mi.render(scene, sensor=sensor, integrator=nrc, spp=1, seed=303 + seed)
        )
        if seed >= 0:
            sides[0].append(a)
            sides[1].append(b)
            rows.append([wall, wall_pt, nrc.last.seconds["train"], nrc.last.rendered.samples, nrc.last.guiding])
    a, b = np.array(sides[0]), np.array(sides[1])
    means = a.mean(axis=(1, 2, 3)), b.mean(axis=(1, 2, 3))
    z = (means[0].mean() - means[1].mean()) / np.sqrt(sum(m.var(ddof=1) for m in means) / repeats)
    truth = truth_of(name, scene, sensor, plan["size"], plan["reference"]).mean
    variance = [float(np.mean(x.var(axis=0, ddof=1) / (truth**2 + EPSILON))) for x in (a, b)]
    wall, wall_pt, train, samples, guided = (float(x) for x in np.median(rows, axis=0))
    return {"z": abs(float(z)), "gain": variance[1] * wall_pt / (variance[0] * wall), "repeats": repeats, "spp": spp,
            "wall": wall, "wall_pt": wall_pt, "train": train, "samples": samples, "guided": guided}  # fmt: skip


def lag(name: str, scene: Any, plan: Figures) -> Figures:
    """Frames to 1.1 x the steady error from cold, of the picture at one sample and of the cache view; frames to regain
    90 % after a light switch."""
    from lightwell.cache.views import view

    frames, steady = (6, 2) if plan["quick"] else (100, 20)
    sensor = scene.sensors()[0]
    nrc = cold({"mode": "frames"}, scene)
    cache = nrc.cache
    truth = truth_of(name, scene, sensor, plan["size"], plan["reference"])

    def seen() -> np.ndarray:
        return view(scene, sensor, cache, "cache", 4, 5)

    errors = []
    for k in range(frames):  # mi.render trains once, then renders one sample
        picture, _ = timed(lambda k=k: mi.render(scene, sensor=sensor, integrator=nrc, spp=1, seed=k))
        with dr.suspend_grad():
            errors.append([truth.error(picture), truth.error(seen())])
    curve = np.array(errors)
    settled = np.median(curve[-steady:], axis=0)
    parameters = mi.traverse(scene)
    key = next(k for k in parameters.keys() if k.endswith("radiance.value"))
    parameters[key] = parameters[key] * 0.1
    parameters.update()
    level, gaps = float(truth.mean.mean()), []
    for _ in range(frames):
        with dr.suspend_grad():
            cache.train_frame(scene, sensor, 1)
            gaps.append(abs(float(seen().mean()) - 0.1 * level) / (0.9 * level))
    gap, eighth = np.array(gaps), min(7, frames - 1)
    found = {"t90": first(gap <= 0.1), "t50": first(gap <= 0.5), "changes": cache.changes}
    for j, what in enumerate(("picture", "view")):
        found |= {what: stays(curve[:, j] <= 1.1 * settled[j]), f"{what}_steady": float(settled[j]),
                  f"{what}_after8": float(curve[eighth, j])}  # fmt: skip
    return {**found, "curve": [[float(f"{x:.3g}") for x in row] for row in curve]}


def first(holds: np.ndarray) -> int:
    """Number, from 1, of the first frame for which it holds; one more than there are if for none."""
    return int(np.argmax(holds)) + 1 if holds.any() else len(holds) + 1


def drift(name: str, scene: Any, plan: Figures) -> Figures:
    """Mean of the cache view over many static frames."""
    from lightwell.cache.views import view

    scene = scene_of(name, min(plan["size"], 96))
    frames = 12 if plan["quick"] else 2000
    sensor = scene.sensors()[0]
    cache = RadianceCache(settings_of({"mode": "frames", "budget": "low"}))
    cache.prepare(scene)
    means = []
    for k in range(frames):
        with dr.suspend_grad():
            cache.train_frame(scene, sensor, 1)
            if k % max(frames // 100, 1) == 0:
                means.append(float(view(scene, sensor, cache, "cache", 4, 5).mean()))
    half = means[len(means) // 2 :]
    early, late = half[: len(half) // 2], half[len(half) // 2 :]
    return {"change": abs(float(np.mean(late) / np.mean(early)) - 1), "changes": cache.changes}


def live(name: str, scene: Any, plan: Figures) -> Figures:
    """Pictures per second of the live page, and its quality after the camera has stopped."""
    return live_figures(str(source_of(name)), LIVE_SIZE, bool(plan["quick"]))


# ------------------------------------------------------------------ rows


ONE = ("cornell-box",)
# Parts that load the scene by themselves: recordings of a process with two scenes are slower.
OWN_SCENES = ("warm", "live")
# Parts that take long: only where they are named.
LONG = ("table", "denoise", "blend", "cold", "warm")
# Part: (figures of a scene, rows, scenes).
PARTS: dict[str, tuple[Any, Any, tuple[str, ...]]] = {
    "equal": (equal, equal_rows, NAMES), "frame": (frame, frame_rows, NAMES),
    "unbiased": (unbiased, unbiased_rows, NAMES), "parts": (parts, parts_rows, ("veach-ajar", "veach-bidir")),
    "lag": (lag, lag_rows, ONE), "drift": (drift, drift_rows, ONE), "denoise": (denoise, denoise_rows, tuple(HALVES)),
    "blend": (blend, blend_rows, tuple(HALVES)), "cold": (cold_start, cold_rows, tuple(HALVES)),
    "warm": (warm, warm_rows, WARM_SCENES), "table": (table, table_rows, tuple(HALVES)),
    "live": (live, live_rows, LIVE_SCENES), "gpu": (None, gpu_rows, ()),
}  # fmt: skip


def kept_file(part: str, name: str) -> Path:
    """Where the figures of a scene are kept."""
    return FIGURES / f"radiance_cache-{part}-{name}.json"


def held(part: str, name: str, plan: Figures) -> Figures | None:
    """Figures of a scene that are kept; None where there are none, or those of another plan."""
    kept = kept_file(part, name)
    found = json.loads(kept.read_text()) if kept.exists() else {}
    return found["figures"] if found.get("plan") == plan else None


def measured(part: str, name: str, plan: Figures, resume: bool) -> Figures | None:
    """Figures of a scene from a process of its own, or those that are kept; None where the scene is not there."""
    if source_of(name) is None:
        return None
    if resume and (figures := held(part, name, plan)) is not None:
        return figures
    words = [sys.executable, __file__, "--child", part, "--scenes", name, "--plan", json.dumps(plan)]
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"radiance_cache: {part} of {name} ended with {done.returncode}; its message is above")
    figures = json.loads(done.stdout.strip().splitlines()[-1])
    if not plan["quick"]:
        kept, part_file = kept_file(part, name), kept_file(part, name).with_suffix(".part")
        kept.parent.mkdir(parents=True, exist_ok=True)
        part_file.write_text(json.dumps({"plan": plan, "figures": figures}))
        os.replace(part_file, kept)
    return figures


def measured_scenes(part: str, asked: list[str], plan: Figures, resume: bool) -> tuple[dict[str, Figures], int]:
    """Figures of a part by scene, and how many scenes failed; ``resume``: those kept of scenes not asked for, too."""
    scenes, failed, found = PARTS[part][2], 0, {}
    for name in ONE[: len(scenes)] if plan["quick"] else scenes:
        try:
            wanted = plan["quick"] or name in asked
            found[name] = measured(part, name, plan, resume) if wanted else held(part, name, plan) if resume else None
        except RuntimeError as error:  # The other scenes are measured all the same.
            failed += 1
            print(f"error: {error}", file=sys.stderr)
    return {name: figures for name, figures in found.items() if figures is not None}, failed


def main() -> None:
    """Measure the parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="smoke run; writes nothing")
    parser.add_argument("--only", default=",".join(p for p in PARTS if p not in LONG), help="parts, comma-separated")
    parser.add_argument("--scenes", default="", help="scenes, comma-separated (default: those of the part)")
    parser.add_argument("--resume", action="store_true", help="keep what is in out/figures")
    parser.add_argument("--spp", type=int, default=PLAN["spp"], help="samples of path that set the time")
    parser.add_argument("--repeats", type=int, default=PLAN["repeats"])
    parser.add_argument(
        "--size", type=int, default=PLAN["size"], help="edge of the pictures, pixels; another is only printed"
    )
    parser.add_argument("--reference", type=int, default=PLAN["reference"], help="samples per pixel of the truth")
    parser.add_argument("--child", default="", help=argparse.SUPPRESS)
    parser.add_argument("--plan", default="", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        plan = json.loads(arguments.plan)
        scene = None if arguments.child in OWN_SCENES else scene_of(arguments.scenes, plan["size"])
        print(json.dumps(PARTS[arguments.child][0](arguments.scenes, scene, plan)), flush=True)
        return
    plan = {**PLAN, "spp": arguments.spp, "repeats": arguments.repeats, "reference": arguments.reference,
            "size": arguments.size}  # fmt: skip
    if arguments.quick:
        plan = QUICK
    asked, failed = chosen("--scenes", arguments.scenes, HALVES), 0
    for part in chosen("--only", arguments.only, PARTS):
        found, missed = measured_scenes(part, asked, plan, arguments.resume)
        failed += missed
        publish("radiance_cache", PARTS[part][1](found, plan), only_printed := plan["size"] != PLAN["size"])
        if not only_printed:
            write_page()
    if failed:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
