"""The ladder of the radiance cache: what each ingredient does to the error in equal time.

    python benchmarks/radiance_cache_ladder.py            all rungs on three scenes; about 10 minutes on 2 quiet cores
    python benchmarks/radiance_cache_ladder.py --quick    a smoke run; writes nothing
    python benchmarks/radiance_cache_ladder.py --draw     only the plot and the page's table, from the figures there are

Every rung is kept in out/figures as soon as it is measured; ``--resume`` goes on from there. The table goes to
results/radiance_cache_ladder.json and docs/radiance-cache.md, the plot to docs/images/cache-ladder.png.

Mitsuba's ``path`` renders for about ``SECONDS``; every rung gets the wall time that this took, its training included,
with nothing learned before. Kernels are compiled before the clock starts. The rule that path traces pictures that are
too short for a cache is off: the ladder shows the cache.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from radiance_cache import FIGURES, cold, timed
from radiance_cache_truth import ROOT, SCENES, path_tracer, scene_of, truth_of
from rows import RESULTS, chosen, publish, without_bar

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator

NAMES = ("veach-ajar", "staircase2", "cornell-box")
FULL: dict[str, Any] = {"size": 128, "seconds": 2.0, "repeats": 3, "reference": 1024, "quick": 0}
QUICK: dict[str, Any] = {"size": 24, "seconds": 0.3, "repeats": 1, "reference": 64, "quick": 1}
PATH = "PT (Mitsuba's path)"
# The cache as in the paper: no level, no cap of caustics, no guide. What ships has them, and full training paths, but
# no reservoirs: ``SHIPPED`` is nothing but defaults.
PAPER = {"still_unbiased": 1 / 16, "local_level": False, "spike_cap": 0.0, "guide": "never"}
NRC = {**PAPER, "first_hit": "restir-di"}
SHIPPED: dict[str, Any] = {}
RUNGS: dict[str, dict[str, Any]] = {
    "PT, our sampling": {"termination_c": "inf"},
    "PT + ReSTIR": {"termination_c": "inf", "first_hit": "restir-di"},
    "PT + ReSTIR + NRC": NRC,
    "  self-training off": {**NRC, "still_unbiased": 1.0},
    "  averaging off": {**NRC, "ema_decay": 0.0},
    "  frequency, not hash": {**NRC, "encoding": "frequency", "hidden": 64},
    "  factorisation off": {**NRC, "factorise": False},
    "  c = 1.58, not 0.01": {**NRC, "termination_c": 1.58},
    "NRC as shipped": SHIPPED,
    "  level off": {"local_level": False},
    "  cap of caustics off": {"spike_cap": 0.0},
    "  guide off": {"guide": "never"},
}
QUICK_RUNGS = ("PT, our sampling", "PT + ReSTIR + NRC", "NRC as shipped")
TABLE = RESULTS / "radiance_cache_ladder.json"
PLOT, PAGE = ROOT / "docs" / "images" / "cache-ladder.png", ROOT / "docs" / "radiance-cache.md"
BEGIN, END = "<!-- ladder: written by benchmarks/radiance_cache_ladder.py -->", "<!-- end of the ladder -->"
PICTURE = "![Gains of the rungs by scene](images/cache-ladder.png)"
Figures = dict[str, Any]


def samples_for(seconds: float, scene: Any, sensor: Any) -> int:
    """Samples per pixel that ``path`` takes in so many seconds."""
    for _ in range(2):  # compiled by the first
        _, wall = timed(lambda: mi.render(scene, sensor=sensor, integrator=path_tracer(), spp=16, seed=1))
    return max(4, round(16 * seconds / wall))


def measure(name: str, plan: Figures, resume: bool) -> Figures:
    """{rung: {error, seconds, gain, samples, train}} of a scene; kept after every rung."""
    kept = FIGURES / f"ladder-{name}.json"
    found: Figures = {}
    if resume and kept.exists() and (held := json.loads(kept.read_text()))["plan"] == plan:
        found = held["rungs"]
    scene = scene_of(name, plan["size"])
    sensor = scene.sensors()[0]
    truth = truth_of(name, scene, sensor, plan["size"], plan["reference"])
    for rung in QUICK_RUNGS if plan["quick"] else RUNGS:
        if rung in found:
            continue
        # path beside every rung, so that a machine that slows down does so for both.
        spp = samples_for(plan["seconds"], scene, sensor)
        found[rung] = against_path(scene, sensor, RUNGS[rung], plan, truth, spp)
        print(f"{name}: {rung.strip()}: {found[rung]['gain']:.3g}", file=sys.stderr, flush=True)
        if not plan["quick"]:
            kept.parent.mkdir(parents=True, exist_ok=True)
            kept.write_text(json.dumps({"plan": plan, "rungs": found}))
    return found


def against_path(scene: Any, sensor: Any, options: Figures, plan: Figures, truth: Any, spp: int) -> Figures:
    """Medians of one rung and of ``path``, in turns."""

    def ours() -> NrcIntegrator:
        nrc = cold({"mode": "still", **options, "seconds": plan["seconds"]}, scene)
        nrc.worth = 0.0
        return nrc

    nrc = ours()
    mi.render(scene, sensor=sensor, integrator=nrc, spp=1, seed=1)
    rows = []
    for seed in range(plan["repeats"]):
        pt = path_tracer()
        theirs, wall_pt = timed(
            lambda seed=seed, pt=pt: mi.render(scene, sensor=sensor, integrator=pt, spp=spp, seed=200 + seed)
        )
        nrc = ours()
        nrc.settings = nrc.settings.changed(seconds=wall_pt)
        picture, wall = timed(
            lambda seed=seed, nrc=nrc: mi.render(scene, sensor=sensor, integrator=nrc, spp=1, seed=100 + seed)
        )
        done = nrc.last
        rows.append(
            [truth.error(picture), wall, done.seconds["train"], done.rendered.samples, truth.error(theirs), wall_pt]
        )
    error, wall, train, samples, error_pt, wall_pt = (float(x) for x in np.median(rows, axis=0))
    return {"error": error, "seconds": wall, "train": train, "samples": samples, "error_pt": error_pt,
            "gain": error_pt * wall_pt / (max(error, 1e-9) * wall)}  # fmt: skip


# ------------------------------------------------------------------ table and plot


def mean_gain(table: Figures, rung: str) -> float | None:
    """Geometric mean over the scenes, where all are there."""
    gains = [rungs[rung]["gain"] for rungs in table.values() if rung in rungs]
    return float(np.exp(np.mean(np.log(np.maximum(gains, 1e-9))))) if len(gains) == len(NAMES) else None


def markdown(table: Figures) -> str:
    """The table of the page: gains over ``path``."""
    names = [n for n in NAMES if n in table]
    lines = [f"| relMSE of `path` over ours, equal time | {' | '.join(names)} | geometric mean |",
             "|---|" + "---|" * (len(names) + 1), f"| {PATH} |" + " 1 |" * (len(names) + 1)]  # fmt: skip
    show = lambda x: "–" if x is None else f"{x:.3g}"  # noqa: E731
    for rung in RUNGS:
        cells = [show(table[n].get(rung, {}).get("gain")) for n in names]
        label = "… " + rung.strip() if rung.startswith(" ") else rung
        lines.append(f"| {label} | {' | '.join(cells)} | {show(mean_gain(table, rung))} |")
    return "\n".join(lines)


def write_page(table: Figures) -> None:
    """Put table and plot between their marks in the page."""
    text = PAGE.read_text()
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    PAGE.write_text(f"{before}{BEGIN}\n\n{markdown(table)}\n\n{PICTURE}\n\n{END}{after}")


COLOURS = ("#2f6690", "#e08a3c", "#5a9e6f")


def plot(table: Figures, path: Path) -> None:
    """Gains as horizontal bars on a logarithmic axis, drawn at twice the size and reduced; the thick line is path."""
    from PIL import Image, ImageDraw, ImageFont

    names = [n for n in NAMES if n in table]
    gains = [f["gain"] for rungs in table.values() for f in rungs.values()]
    low, high = np.floor(np.log10(min([*gains, 0.9]))), np.ceil(np.log10(max([*gains, 1.1])))
    bar, gap, left, right, top = 30, 26, 460, 150, 150
    row = len(names) * bar + gap
    width, height = 2000, top + row * len(RUNGS) + 90
    image = Image.new("RGB", (width, height), "white")
    draw, font, small = ImageDraw.Draw(image), ImageFont.load_default(32), ImageFont.load_default(26)
    x = lambda gain: left + (np.log10(max(gain, 1e-6)) - low) / (high - low) * (width - left - right)  # noqa: E731
    bottom = top + row * len(RUNGS)
    for power in range(int(low), int(high) + 1):
        for digit in (1, 2, 5):
            gain = digit * 10.0**power
            if gain <= 10**high:
                draw.line((x(gain), top, x(gain), bottom), "#c8c8c8" if digit == 1 else "#ececec", 2)
                draw.text((x(gain), bottom + 28), f"{gain:g}", "#444444", small, anchor="mm")
    for k, rung in enumerate(RUNGS):
        y = top + k * row + gap / 2
        draw.text((left - 20, y + (row - gap) / 2), rung.strip(), "black", font, anchor="rm")
        for j, name in enumerate(names):
            if (gain := table[name].get(rung, {}).get("gain")) is None:
                continue
            ends, at = sorted((x(gain), x(1.0))), y + j * bar
            draw.rectangle((ends[0], at + 2, ends[1], at + bar - 2), COLOURS[j])
            draw.text((ends[1] + 10, at + bar / 2), f"{gain:.3g}", "black", small, anchor="lm")
    draw.line((x(1), top, x(1), bottom), "black", 4)
    draw.text((30, 44), "relMSE of Mitsuba's path over ours, in the same wall time", "black", font, anchor="lm")
    at = 30
    for j, name in enumerate(names):
        draw.rectangle((at, 90, at + 28, 118), COLOURS[j])
        draw.text((at + 40, 104), name, "black", font, anchor="lm")
        at += 80 + int(draw.textlength(name, font))
    path.parent.mkdir(parents=True, exist_ok=True)
    image.resize((width // 2, height // 2), Image.Resampling.LANCZOS).save(path, optimize=True)


def write(table: Figures) -> None:
    """Table, plot, page and rows."""
    short = {n: {r: {k: float(f"{v:.4g}") for k, v in f.items()} for r, f in rungs.items()}
             for n, rungs in table.items()}  # fmt: skip
    TABLE.write_text(json.dumps(short, indent=1) + "\n")
    plot(short, PLOT)
    write_page(short)


def main() -> None:
    """Measure, or only draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="smoke run; writes nothing")
    parser.add_argument("--scenes", default="", help="scenes, comma-separated")
    parser.add_argument("--resume", action="store_true", help="keep the rungs that are in out/figures")
    parser.add_argument("--draw", action="store_true", help="only plot and table")
    parser.add_argument("--child", default="", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    plan = QUICK if arguments.quick else FULL
    if arguments.child:
        print(json.dumps(measure(arguments.child, plan, arguments.resume)), flush=True)
        return
    table: Figures = json.loads(TABLE.read_text()) if TABLE.exists() and not arguments.quick else {}
    names = chosen("--scenes", arguments.scenes, NAMES)
    for name in [] if arguments.draw else (["cornell-box"] if arguments.quick else names):
        if not (SCENES / name / "scene_mi3.xml").exists():
            continue
        flags = [flag for flag in ("--quick", "--resume") if getattr(arguments, flag[2:])]
        words = [sys.executable, __file__, "--child", name, *flags]
        done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"error: the ladder of {name} ended with {done.returncode}; its message is above")
        table[name] = json.loads(done.stdout.strip().splitlines()[-1])
    if not arguments.quick:
        write(table)
    what = "ladder: relMSE of path over ours at equal time, three scenes, geometric mean, "
    rows = [without_bar(what + rung.strip(), mean_gain(table, rung), "ratio") for rung in RUNGS]
    publish("radiance_cache", rows, arguments.quick)


if __name__ == "__main__":
    main()
