"""Training and validation samples of a bake."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.core.progress import ProgressStage
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.variables import Variable
from lightwell.transport import PathReport, Samples, indirect, static
from lightwell.transport.collect import collect
from lightwell.transport.lit_points import LitPoints
from lightwell.transport.shards import Make, ShardSettings, generate, load_samples
from lightwell.transport.surface import SurfaceDraw

# Stream of the validation set of early stopping; never shared with training or evaluation.
VALIDATION_SEED = 0xA11D
# The validation set: enough points that a difference of a few per cent shows, paths that keep its own noise below it.
VALIDATION_POINTS, VALIDATION_LIGHTS, VALIDATION_PATHS = 4096, 64, 256
# Points per visible object at least.
VALIDATION_FLOOR = 8
VALIDATION_DRAW = Derived[SurfaceDraw]("fields.validation_draw")

# Points that the rate of the path tracer is measured on, paths of each that compile it first, those of a short launch,
# and how much longer a long launch is than a short one.
TIMED_POINTS, FIRST_PATHS, TIMED_PATHS, LONGER = 4096, 2, 16, 8

# A shard that took fewer seconds than this was there already.
ON_DISK = 0.01


@dataclass(frozen=True)
class TracedShards:
    """Samples of a folder of shards."""

    samples: Samples
    report: PathReport
    """Path counts of all shards."""
    seconds_per_shard: float
    """Least seconds of a shard but the first, which pays for what is traced before it; about 0 when one was on disk."""


def trace_shards(
    scene: Scene,
    variable: Variable,
    shards: ShardSettings,
    folder: Path,
    count: int,
    make: Make | None,
    stage: ProgressStage,
) -> TracedShards:
    """Write the shards that a folder lacks, and read all of them.

    Args:
        scene: The scene.
        variable: Ranges of the light.
        shards: Size, paths and seed of the shards.
        folder: Folder of the shards.
        count: Number of shards.
        make: Makes a shard, as in ``generate``; None: area-uniform points.
        stage: Progress of the stage.

    Returns:
        The samples and their cost.
    """
    last, costs = perf_counter(), list[float]()

    def ready(index: int, total: int) -> None:
        nonlocal last
        now = perf_counter()
        cost, last = now - last, now
        costs.append(cost)
        rate = shards.size * shards.paths / max(cost, 1e-9) / 1e6
        stage.move_to(index, "on disk" if cost < ON_DISK else f"{rate:.2f} M paths/s")

    report = generate(
        scene, variable, None, folder, count, shards.paths, shards.seed, ready, settings=shards, make=make
    )
    return TracedShards(load_samples(folder, scene, shards=count), report, min(costs[1:] or costs, default=0.0))


def validation_samples(
    scene: Scene,
    variable: Variable,
    seed: int,
    own_light: bool = False,
    points: int = VALIDATION_POINTS,
    lights: int = VALIDATION_LIGHTS,
    looked: Variable | None = None,
) -> Samples:
    """Trace the held-out samples of early stopping.

    Args:
        scene: The scene.
        variable: Ranges of the light.
        seed: Seed of the bake.
        own_light: Whether the light is that of the scene's own emitters.
        points: Number of points, a multiple of ``lights``.
        lights: Number of lights.
        looked: People look where this light may be; None: where that of ``variable`` may be.

    Returns:
        The samples.

    Raises:
        ValueError: There is no free air for the light, and it is not that of the scene's own emitters.
    """
    seed += VALIDATION_SEED
    lit = LitPoints(variable, points, seed, VALIDATION_FLOOR, seen=True, **_training_lights(lights, seed, points))
    # All parts of the light have the same points.
    drawn = replace(lit, variable=looked or variable)
    draw = scene.cache.get(VALIDATION_DRAW, partial(drawn.draw, scene), (drawn.variable, points, seed))
    recipe = lit.recipe(not own_light) if drawn == lit else None
    try:
        light = lit.light_of(scene, points)
    except ValueError:
        # The scene's own light needs no place for another one.
        if not own_light:
            raise
        light, recipe = np.zeros((points, 3), np.float32), None
    options = {"weight": draw.weight, "own_light": own_light, "recipe": recipe}
    return collect(scene, variable, draw.points, light, VALIDATION_PATHS, seed, **options)


def _training_lights(count: int, seed: int, rows: int) -> dict[str, Any]:
    """Options of ``LitPoints``: so many training lights, each for as many rows that follow each other."""
    return {"lights": count, "light_seed": seed, "held_out": False, "run": rows // count}


@dataclass(frozen=True)
class PathRate:
    """Light paths that are traced in a second, compilation excluded."""

    short: float
    """In launches of few paths, of which most is spent before the first path is traced."""
    sustained: float
    """In long launches."""


def path_rate(
    scene: Scene,
    variable: Variable | None,
    seed: int,
    own_light: bool = False,
    sustained: bool = False,
) -> PathRate:
    """Measure how many light paths are traced in a second.

    Args:
        scene: The scene.
        variable: Ranges of the light; None: ``own_light``.
        seed: Seed of the bake.
        own_light: Whether the light is that of the scene's own emitters.
        sustained: Measure long launches too, in about a second; otherwise their rate is that of short ones.

    Returns:
        The rates.
    """
    lights = {} if variable is None else _training_lights(TIMED_POINTS, seed, TIMED_POINTS)
    lit = LitPoints(variable, TIMED_POINTS, seed + VALIDATION_SEED, 1, **lights)
    points = lit.draw(scene).points
    light, own = lit.light_of(scene, TIMED_POINTS), own_light or variable is None

    def seconds(count: int) -> float:
        start = perf_counter()
        if own:
            static(scene, points, count, seed, recipe=lit.recipe(lit=False))
        else:
            indirect(scene, points, light, variable, count, seed, recipe=lit.recipe())
        return max(perf_counter() - start, 1e-6)

    seconds(FIRST_PATHS)
    few = seconds(TIMED_PATHS)
    short = TIMED_POINTS * TIMED_PATHS / few
    if not sustained:
        return PathRate(short, short)
    more = seconds(LONGER * TIMED_PATHS)
    return PathRate(short, max(TIMED_POINTS * (LONGER - 1) * TIMED_PATHS / max(more - few, 1e-6), short))
