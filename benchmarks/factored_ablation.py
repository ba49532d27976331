"""What each choice of the default field is worth: variants of it on the same samples of the Cornell box.

    python benchmarks/factored_ablation.py [--shards 96] [--steps 4000]     20 minutes on 2 cores, 7 at 32 and 1500
    python benchmarks/factored_ablation.py --quick                          a smoke run; writes nothing

Every variant takes the same number of training samples: halved batches have twice the steps. Errors are at 4,096 points
and 64 lights that training never saw, at least a tenth of the box from every surface; --steps counts batches of 8,192.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from rows import Row, publish, without_bar

from lightwell.fields.baked import Baked
from lightwell.fields.base import FieldSetup, radiance_unit
from lightwell.fields.surface.factored import PRESETS, FactoredFit, FactoredPreset
from lightwell.networks.hashgrid import HashGrid
from lightwell.report.charts import ChartAxis
from lightwell.report.scatter import ScatterPoint, scatter_chart
from lightwell.scenes import load
from lightwell.scenes.placing import held_out_lights
from lightwell.scenes.variables import declare
from lightwell.transport import draw_surface, generate, load_samples
from lightwell.transport.collect import collect

CORNELL = Path(__file__).resolve().parents[2] / "shared/scenes/mitsuba/cornell-box/scene.xml"
CLEARANCE = ("light.clearance=0.2",)
# Variants that are about training, not size: rows, but no points of the charts.
TRAINING = ("rate 1e-2", "batches of 16,384", "light network 32-32", "light code of 16", "all int8")
STYLE = """
body { margin: 0; background: #fff; font: 12px system-ui, sans-serif; } main { display: flex; gap: 8px; width: 1160px; }
svg { width: 576px; } text { fill: #444; font-size: 10px; } .title { font-size: 11px; fill: #000; }
.grid { stroke: #e4e4e4; } .axis { stroke: #999; } .front { fill: none; stroke: #999; } .tone-0 { fill: #c8501e; }
.tone-1 { fill: #3a6ea5; }
"""
# Paths per training sample.
PATHS = 16


def variants() -> dict[str, FactoredPreset]:
    """Name → preset; each of the first group differs from the default in one thing, the rest are a ladder of sizes."""
    default = PRESETS["default"]
    trained = lambda **changes: replace(default, training=replace(default.training, **changes))  # noqa: E731
    quantised = replace(default, storage="int8")
    return {
        "default": default,
        "all int8": quantised,
        "rate 1e-2": trained(rate=1e-2),
        "batches of 16,384": trained(batch=1 << 14),
        "light network 32-32": replace(default, light_hidden=(32, 32)),
        "light code of 16": replace(default, light_hidden=(64, 16)),
        "head 16-12": replace(quantised, hidden=(16, 12)),
        "head 32-16": replace(quantised, hidden=(32, 16)),
        "head 64-32": replace(quantised, hidden=(64, 32)),
        "table 2^9": replace(quantised, grid=HashGrid(3, 8, 2, 9)),
        "table 2^11": replace(quantised, grid=HashGrid(3, 8, 2, 11)),
        "table 2^15": replace(quantised, grid=HashGrid(4, 8, 2, 15)),
        "8 channels": replace(quantised, grid=HashGrid(3, 8, 2, 13, channels=8)),
        "small, finer table": replace(PRESETS["small"], grid=HashGrid(3, 4, 2, 10)),
        "small": PRESETS["small"],
        "large": PRESETS["large"],
    }


def measure(shards: int, steps: int, points: int, paths: int, seed: int = 0) -> tuple[list[Row], list]:
    """Train every variant on the same samples; a row of each, and (name, bytes, multiply-adds, error)."""
    scene = load(str(CORNELL) if CORNELL.exists() else "cornell")
    variable = declare(CLEARANCE, scene)
    with tempfile.TemporaryDirectory() as folder:
        generate(scene, variable, None, folder, shards, PATHS, seed)
        samples = load_samples(folder, scene)
    draw = draw_surface(scene, points, seed + 1, shown=True)
    lights = held_out_lights(scene, variable, 64, seed + 2).repeat(points // 64, axis=0)
    truth = collect(scene, variable, draw.points, lights, paths, seed + 3, weight=draw.weight)
    unit = radiance_unit(samples)
    y = truth.radiance / unit
    floor = np.abs(truth.half_a - truth.half_b) / 2 / unit / (y + 0.01)
    rows, points = [], []
    for name, preset in variants().items():
        fit = FactoredFit(FieldSetup.of(scene, unit, variable.kind), preset, seed)
        fit.learn_from(samples)
        fit.validate_on(truth)
        own = steps * PRESETS["default"].training.batch // preset.training.batch
        start = perf_counter()
        fit.train(own, own)
        seconds, graph = perf_counter() - start, fit.lower()
        error = np.abs(Baked(graph)(truth.query) / unit - y) / (y + 0.01)
        note = (
            f"median {np.median(error):.2%}, noise {floor.mean():.2%}, {graph.nbytes / 1e3:.0f} kB, {graph.macs} MAC, "
            f"{own} steps in {seconds:.0f} s"
        )
        weight = truth.weight / truth.weight.mean()
        mean = float((error.mean(axis=1) * weight).mean())
        rows.append(without_bar(f"factored, {name}: error", mean, "of 1", note))
        points.append((name, graph.nbytes, graph.macs, mean))
    return rows, points


def draw(points: list[tuple[str, int, int, float]]) -> str:
    """A page of two charts: error over bytes and over multiply-adds."""
    points = [p for p in points if p[0] not in TRAINING]
    y = ChartAxis("relative error", lambda v: f"{v:.0%}")
    charts = []
    for k, label, title in (
        (1, "bytes as stored", "Error over bytes"),
        (2, "multiply-adds per pixel", "Error over work"),
    ):
        marked = [ScatterPoint(p[0], p[k], p[3], "tone-0" if p[0] in PRESETS else "tone-1") for p in points]
        x = ChartAxis(label, lambda v: f"{v / 1e3:g} k" if v >= 1e3 else f"{v:g}", log=True)
        charts.append(scatter_chart(marked, x, y, title))
    return f"<!doctype html><meta charset=utf-8><style>{STYLE}</style><main>{''.join(charts)}</main>"


def main() -> None:
    """Measure and publish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a smoke run; writes nothing")
    parser.add_argument("--shards", type=int, default=96, help="shards of 65,536 samples (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=4000, help="steps of the default (default: %(default)s)")
    parser.add_argument("--plot", type=Path, help="write a page of error over bytes and over multiply-adds here")
    arguments = parser.parse_args()
    size = (2, 20, 256, 16) if arguments.quick else (arguments.shards, arguments.steps, 4096, 4096)
    rows, points = measure(*size)
    publish("factored_ablation", rows, arguments.quick)
    if arguments.plot:
        arguments.plot.write_text(draw(points))


if __name__ == "__main__":
    main()
