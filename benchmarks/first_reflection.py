"""Noise of once reflected light with light rays that samples share, over that with light rays of their own.

    python benchmarks/first_reflection.py [--publish] [SCENE ...]

Samples lie where people look, under lamps of the default ranges, as those of a bake. The squared error is that of what
the network learns (the light over the reflectance, by the default loss), with the noise of the truth taken off; a few
samples in 500 hold most of it, so that it is printed without these, too. Times are of the second of two runs each.
``--publish`` writes ``results/first_reflection.json``.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from rows import publish, without_bar
from zoo_scenes import SUBSET, scenes

from lightwell.networks.losses import EPSILON_BETWEEN
from lightwell.scenes.load import load
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import declare
from lightwell.transport.light_vertices import SharedLamps
from lightwell.transport.queries import make_query
from lightwell.transport.radiance import begin_first_reflection
from lightwell.transport.seen import draw_seen

LAMPS, POINTS_PER_LAMP, PATHS, TRUE_PATHS = 128, 64, 32, 4096
# Samples that hold most of the error, left out of the second figure; quantile of the light that is its unit.
LEFT_OUT, UNIT = 0.002, 0.9
LEAST_REFLECTANCE = 0.05
OTHERS = ("littlest-tokyo", "bevy-dof", "gaggle-city", "living-room-2")


@dataclass(frozen=True)
class Noise:
    """Figures of one scene, shared over own light rays."""

    all: float
    rest: float
    """Without the samples that hold most."""
    time: float


def measure(scene: Scene, seed: int = 0) -> Noise:
    """Compare both estimates on one scene."""
    variable = declare((), scene)
    lamps = sample_lights(scene, variable, LAMPS, seed)
    index = np.arange(LAMPS, dtype=np.uint32).repeat(POINTS_PER_LAMP)
    points = draw_seen(scene, variable, len(index), seed, floor=1).points
    points = points[np.random.default_rng(seed).permutation(len(points))[: len(index)]]
    index = index[: len(points)]
    reflectance = make_query(scene, points, np.zeros(3, np.float32)).reflectance
    scale = np.maximum(reflectance, LEAST_REFLECTANCE)
    traced = lambda paths, seed, shared=None: np.stack(  # noqa: E731
        begin_first_reflection(scene, points, lamps[index], variable, paths, seed, shared)()
    )
    a, b = traced(TRUE_PATHS, 1) / scale
    light = np.maximum((0.5 * (a + b)).mean(axis=1), 0)
    unit = max(float(np.nanquantile(light, UNIT)), 1e-3 * float(np.nanmean(light)))
    weight = (1 / (light / unit + EPSILON_BETWEEN) ** 1.5)[:, None]

    def error(shared: SharedLamps | None) -> tuple[np.ndarray, float]:
        traced(PATHS, 2, shared)
        start = perf_counter()
        mean = traced(PATHS, 3, shared).mean(axis=0) / scale
        seconds = perf_counter() - start
        return (weight * (mean - a) * (mean - b)).mean(axis=1), seconds

    (own, own_time), (shared, shared_time) = error(None), error(SharedLamps(lamps, index, seed))
    kept = np.isfinite(own) & np.isfinite(shared)
    own, shared = own[kept], shared[kept]
    few = slice(None, int(len(own) * (1 - LEFT_OUT)))
    rest = np.sort(shared)[few].mean() / np.sort(own)[few].mean()
    return Noise(float(shared.mean() / own.mean()), float(rest), shared_time / own_time)


def main(argv: list[str]) -> int:
    """Print a table, and write the rows where it is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", help="names of the zoo (default: 12 of them)")
    parser.add_argument("--publish", action="store_true", help="write the rows")
    arguments = parser.parse_args(argv)
    found, table = scenes(), {}
    print(f"{'scene':24} {'noise':>6} {'rest':>6} {'time':>6}")
    for name in arguments.scenes or [*SUBSET, *OTHERS]:
        if name not in found:
            print(f"{name:24} not on this machine")
            continue
        table[name] = noise = measure(load(found[name]))
        print(f"{name:24} {noise.all:6.2f} {noise.rest:6.2f} {noise.time:6.2f}", flush=True)
    medians = {part: float(np.median([getattr(n, part) for n in table.values()])) for part in ("all", "rest", "time")}
    print("median " + " ".join(f"{part} {value:.2f}" for part, value in medians.items()))
    if arguments.publish:
        words = {
            "all": "squared noise of once reflected light, shared over own light rays, median",
            "rest": "the same without the 0.2 % of samples that hold most",
            "time": "time of the same, shared over own light rays, median",
        }
        note = f"{len(table)} scenes"
        publish("first_reflection", [without_bar(words[part], medians[part], "of 1", note) for part in words])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
