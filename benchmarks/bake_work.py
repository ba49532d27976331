"""Seconds of the work of a bake that is neither tracing nor training; medians of five, after one that compiles.

    python benchmarks/bake_work.py [--scene SCENE]

Inputs of points, geometry of points, samples that a field takes up, its shading graph under many lights and in one
frame, and shards, of which the paths are traced.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections.abc import Callable
from time import perf_counter

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.fields.surface.factored import PRESETS, FactoredFit
from lightwell.fields.tabulate import Tabulated
from lightwell.scenes import load
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import declare
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.queries import frames, make_query
from lightwell.transport.samples import Query, Samples
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings, generate
from lightwell.transport.surface import draw_surface

POINTS, ROUNDS, SHARDS = 1 << 18, 5, 6
# Samples that a field takes up: lights, and rows of each.
LIGHTS, RUN = 2048, 1024
SETUP = FieldSetup((0.0, 1.0, 0.0), 1.0, 0.5, "point", (2.0, 2.0, 2.0), False)


def seconds(work: Callable[[], object]) -> tuple[float, float]:
    """Time of the first call, and median of the further ones."""
    times = []
    for _ in range(ROUNDS + 1):
        begin = perf_counter()
        work()
        times.append(perf_counter() - begin)
    return times[0], statistics.median(times[1:])


def made_up(lights: int, run: int) -> Query:
    """Queries of random places, in runs that share a light."""
    rng, rows = np.random.default_rng(0), lights * run
    draw = lambda count: rng.random((count, 3), np.float32)  # noqa: E731
    unit = lambda v: v / np.linalg.norm(v, axis=1, keepdims=True)  # noqa: E731
    light = draw(lights).repeat(run, axis=0)
    rest = np.full((rows, 1), 0.5, np.float32), np.zeros((rows, 1), np.float32)
    return Query(draw(rows), unit(draw(rows) - 0.5), unit(draw(rows) - 0.5), light, 0.1 + draw(rows), *rest)


def shards_of(scene: Scene) -> float:
    """Median seconds per shard after the first one, of a light that the scene suggests."""
    variable, settings, ends = declare((), scene), ShardSettings(paths=16), []
    make = GatheredShards(scene, variable, settings, GatherSize.of(1, settings, 64))
    note = lambda done, of: ends.append(perf_counter())  # noqa: E731
    with tempfile.TemporaryDirectory() as folder:
        generate(scene, variable, None, folder, SHARDS + 1, 16, 0, note, settings=settings, make=make)
    return statistics.median(np.diff(ends))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="courtyard", help="what `lightwell bake` is given (default: courtyard)")
    scene = load(parser.parse_args().scene)
    points = draw_surface(scene, POINTS, 1).points
    print(f"inputs of {POINTS:,} points: {seconds(lambda: make_query(scene, points, np.zeros(3)))[1]:.3f} s")
    print(f"geometry of {POINTS:,} points: {seconds(lambda: frames(scene, points))[1]:.3f} s")
    fit, query = FactoredFit(SETUP, PRESETS["default"], 0), made_up(LIGHTS, RUN)
    radiance = np.ones((len(query), 3), np.float32)
    samples = Samples(query, radiance, radiance, np.ones(len(query), np.float32), np.zeros(len(query), np.uint32))
    print(f"taking up {len(query):,} samples: {seconds(lambda: fit.learn_from(samples))[1]:.3f} s")
    table, many, one = Tabulated(fit.lower()), made_up(4096, 1), made_up(1, POINTS)
    for what, asked in ((f"{len(many):,} lights", many), (f"one frame of {len(one):,} pixels", one)):
        first, again = seconds(lambda asked=asked: table(asked, "radiance"))
        print(f"shading graph, {what}: {again:.3f} s, the first time {first:.2f} s")
    print(f"a shard of {ShardSettings().size:,} samples: {shards_of(scene):.2f} s")


if __name__ == "__main__":
    main()
