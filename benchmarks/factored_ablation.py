"""What each choice of the default field is worth: variants of it on the same samples of the Cornell box.

    python benchmarks/factored_ablation.py [--shards 96] [--steps 4000]     about 10 minutes on 2 cores
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

from lightwell.bake.evaluate import Baked
from lightwell.fields import FieldSetup, radiance_unit
from lightwell.fields.factored import PRESETS, FactoredFit, FactoredPreset
from lightwell.networks.hashgrid import HashGrid
from lightwell.scenes import load
from lightwell.scenes.placing import held_out_lights
from lightwell.scenes.variables import declare
from lightwell.transport import draw_surface, generate, load_samples
from lightwell.transport.collect import collect

CORNELL = Path(__file__).resolve().parents[2] / "shared/scenes/mitsuba/cornell-box/scene.xml"
CLEARANCE = ("light.clearance=0.2",)
# Paths per training sample.
PATHS = 16


def variants() -> dict[str, FactoredPreset]:
    """Name → preset; each differs from the default in one thing."""
    default = PRESETS["default"]
    trained = lambda **changes: replace(default, training=replace(default.training, **changes))  # noqa: E731
    return {
        "default": default,
        "rate 1e-2 instead of 2e-2": trained(rate=1e-2),
        "batches of 16,384 instead of 8,192": trained(batch=1 << 14),
        "three levels (8 to 32 cells), more entries": replace(default, grid=HashGrid(3, 8, 2, 13)),
        "head 20-20 instead of 24-14": replace(default, hidden=(20, 20)),
        "head 32-16": replace(default, hidden=(32, 16)),
        "light network 32-32 instead of 64-64": replace(default, light_hidden=(32, 32)),
        "small": PRESETS["small"],
        "large": PRESETS["large"],
    }


def measure(shards: int, steps: int, points: int, paths: int, seed: int = 0) -> list[Row]:
    """Train every variant on the same samples; one row each."""
    scene = load(str(CORNELL) if CORNELL.exists() else "cornell")
    variable = declare(CLEARANCE, scene)
    with tempfile.TemporaryDirectory() as folder:
        generate(scene, variable, None, folder, shards, PATHS, seed)
        samples = load_samples(folder, scene)
    draw = draw_surface(scene, points, seed + 1)
    lights = held_out_lights(scene, variable, 64, seed + 2).repeat(points // 64, axis=0)
    truth = collect(scene, variable, draw.points, lights, paths, seed + 3, weight=draw.weight)
    unit = radiance_unit(samples)
    y = truth.radiance / unit
    floor = np.abs(truth.half_a - truth.half_b) / 2 / unit / (y + 0.01)
    rows = []
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
        rows.append(without_bar(f"factored, {name}: error", float((error.mean(axis=1) * weight).mean()), "of 1", note))
    return rows


def main() -> None:
    """Measure and publish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a smoke run; writes nothing")
    parser.add_argument("--shards", type=int, default=96, help="shards of 65,536 samples (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=4000, help="steps of the default (default: %(default)s)")
    arguments = parser.parse_args()
    if arguments.quick:
        publish("factored_ablation", measure(2, 20, 256, 16), True)
    else:
        publish("factored_ablation", measure(arguments.shards, arguments.steps, 4096, 4096), False)


if __name__ == "__main__":
    main()
