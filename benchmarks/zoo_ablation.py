"""What each choice of the field is worth: variants at equal steps, scored against one reference; for benchmarks/zoo.py.

Samples are made once for each way of making them; every variant trains for the same number of batches. The figures of
each scene lie in FOLDER/NAME.json from the moment that a variant is scored: a run that was stopped goes on there.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from rows import Row, without_bar
from zoo_score import BUDGET, SIZE, VIEWS

from lightwell.baking.evaluate import views_and_lights
from lightwell.baking.quality import score_quality, trace_quality
from lightwell.fields.baked import Baked
from lightwell.fields.base import FieldSetup, around_samples, radiance_unit
from lightwell.fields.surface.factored import PRESETS, FactoredFit, FactoredPreset
from lightwell.files import write_atomically
from lightwell.networks.hashgrid import HashGrid
from lightwell.scenes import load
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable, declare
from lightwell.transport import Samples, draw_surface, make_query
from lightwell.transport.collect import collect
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.samples import Query
from lightwell.transport.seen import draw_seen
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings, default_lights

# Path-traced shards, gathered shards (made in about the same time), steps, and samples kept for early stopping.
TRACED, GATHERED, STEPS, HELD = 4, 24, 1000, 8192
SETTINGS = ShardSettings(paths=16)
THREE_LEVELS = HashGrid(levels=3, base=8, growth=2, entries_log2=13)
FIGURES = ("psnr_db", "flip", "mottle", "leak", "relative_error")


def path_traced(scene: Scene, variable: Variable, seen: bool) -> Samples:
    """Samples by whole paths, by area or where people look."""
    count = TRACED * SETTINGS.size
    draw = (
        draw_seen(scene, variable, count, 1, floor=64, shown=True)
        if seen
        else draw_surface(scene, count, 1, floor=64, shown=True)
    )
    lights = default_lights(scene, variable)(TRACED * SETTINGS.lights, 2).repeat(SETTINGS.points_per_light, axis=0)
    return collect(scene, variable, draw.points, lights, SETTINGS.paths, 3, weight=draw.weight)


def gathered(scene: Scene, variable: Variable, traced: bool) -> Samples:
    """Samples from bins alone, or as a bake makes them: with once reflected light ``traced``."""
    size = GatherSize.of(GATHERED, SETTINGS)
    make = GatheredShards(scene, variable, SETTINGS, size if traced else replace(size, paths=0))
    parts = [make(scene, variable, None, SETTINGS, k)[0] for k in range(GATHERED)]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    query = Query(**{name: columns[name] for name in Query.__dataclass_fields__ if name in columns})
    return Samples(query, *(columns[name] for name in ("half_a", "half_b", "weight", "shape")))


def variants() -> dict[str, tuple[str, FactoredPreset]]:
    """Name → (kind of samples, preset); each adds one thing to the one before."""
    default = PRESETS["default"]
    squared = replace(default, training=replace(default.training, loss="relative2"))
    adam = replace(squared, training=replace(squared.training, optimiser="adam"))
    matte = replace(adam, mirror=None, glossy_hidden=None)
    plain = replace(matte, grid=THREE_LEVELS, hidden=(24, 14))
    decayed = replace(plain, grid=replace(THREE_LEVELS, decay=(0.0, 0.1, 1.0)))
    return {
        "by area": ("area", plain),
        "where people look": ("seen", plain),
        "gathered": ("gathered", plain),
        "decay": ("gathered", decayed),
        "four levels": ("gathered", matte),
        "mirrored ray": ("gathered", adam),
        "Adam for hash grids": ("gathered", squared),
        "loss with the power 1.5": ("gathered", default),
        "once reflected light traced (default)": ("traced", default),
    }


def train(scene: Scene, variable: Variable, samples: Samples, preset: FactoredPreset) -> Baked:
    """A field trained for STEPS batches, as it ships."""
    training, held = samples[: len(samples) - HELD], samples[len(samples) - HELD :]
    setup = FieldSetup.of(scene, radiance_unit(training), variable.kind, variable)
    fit = FactoredFit(around_samples(setup, training), preset, 0)
    fit.learn_from(training)
    fit.validate_on(held)
    fit.train(STEPS, STEPS)
    return Baked(fit.lower())


def of_scene(name: str, source: str, out: Path) -> dict[str, dict]:
    """Variant → figures on one scene, those of an earlier run included."""
    path = out / f"{name}.json"
    found: dict[str, dict] = json.loads(path.read_text()) if path.exists() else {}
    missing = {variant: what for variant, what in variants().items() if variant not in found}
    if not missing:
        return found
    scene = load(source)
    variable = declare((), scene)
    truth = trace_quality(scene, variable, views_and_lights(scene, variable, VIEWS, 0), SIZE, BUDGET, 0)
    make: dict[str, Callable[[], Samples]] = {
        "area": lambda: path_traced(scene, variable, False),
        "seen": lambda: path_traced(scene, variable, True),
        "gathered": lambda: gathered(scene, variable, False),
        "traced": lambda: gathered(scene, variable, True),
    }
    made: dict[str, Samples] = {}
    for variant, (kind, preset) in missing.items():
        if kind not in made:
            made = {kind: make[kind]()}
        baked = train(scene, variable, made[kind], preset)
        quality = score_quality(truth, lambda p, l, b=baked: b(make_query(scene, p, l)))
        found[variant] = {figure: getattr(quality, figure) for figure in FIGURES}
        write_atomically(path, json.dumps(found))
        print(f"{name} {variant}: {quality.psnr_db:.2f} dB, mottle {quality.mottle}", flush=True)
    return found


def middle(values: list[float | None]) -> float | None:
    """The median of the values that there are."""
    there = [value for value in values if value is not None]
    return float(np.median(there)) if there else None


def ablation(chosen: dict[str, str], out: Path) -> list[Row]:
    """Medians over scenes of every figure of every variant, and of what each adds to the PSNR of the one before.

    Args:
        chosen: Name of a scene → what ``lightwell.load`` takes.
        out: Folder of the figures of each scene.

    Returns:
        Rows without bars.
    """
    scenes = [of_scene(name, source, out) for name, source in chosen.items()]
    names, note, rows = list(variants()), ", ".join(chosen), []
    for name in names:
        for figure in FIGURES:
            unit = "dB" if figure == "psnr_db" else ""
            value = middle([scene[name][figure] for scene in scenes])
            rows.append(without_bar(f"{name}: median {figure}", value, unit, note))
    for before, name in pairwise(names):
        pairs = [(scene[name]["psnr_db"], scene[before]["psnr_db"]) for scene in scenes]
        gain = middle([None if a is None or b is None else a - b for a, b in pairs])
        rows.append(without_bar(f"{name}: median gain over '{before}'", gain, "dB", note))
    return rows
