"""Light of the scene's own lamps in the samples that the default field learns from, over that of full paths.

    python benchmarks/own_light.py [--publish] [SCENE ...]

Samples lie where people look, as those of a bake. Energy: mean light of all samples, without the largest hundredth of
either side, which is noise where lamps shine through curved glass. Noise: mean difference of the two halves of a
sample, over the mean light. ``--publish`` writes ``results/own_light.json``.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from rows import publish, without_bar
from zoo_scenes import present

from lightwell.scenes.load import load
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import declare
from lightwell.transport import SurfacePoints, static
from lightwell.transport.own_light_shards import OwnLightShards
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings

SHARDS, LIGHTS, POINTS, TRUE_PATHS = 8, 64, 128, 1024
# What a mean is taken over: all but so large a share of the brightest samples.
BRIGHTEST = 0.01
# Scenes with lamps of their own, and with glass or holes.
CHOSEN = ("bevy-barn-lamp", "living-room-2", "staircase2", "veach-bidir", "room-soft-shadows")


def measure(scene: Scene, seed: int = 0) -> tuple[float, float]:
    """Measure energy and noise of the samples of one scene."""
    settings = ShardSettings(paths=16, seed=seed, lights=LIGHTS, points_per_light=POINTS)
    variable = declare((), scene)
    shards = OwnLightShards(scene, variable, settings, GatherSize.of(SHARDS, settings))
    columns = shards(scene, variable, None, settings, 0)[0]
    points = SurfacePoints(*(columns[name] for name in ("shape", "triangle", "barycentric", "view")))
    truth = np.mean(static(scene, points, TRUE_PATHS, seed + 1)[:2], axis=0)
    a, b = (columns[name].mean(axis=1) for name in ("half_a", "half_b"))
    return _most(0.5 * (a + b)) / _most(truth.mean(axis=1)), float(np.abs(a - b).mean() / (0.5 * (a + b)).mean())


def _most(light: np.ndarray) -> float:
    """Mean of all but the brightest samples."""
    return float(np.sort(light[np.isfinite(light)])[: int((1 - BRIGHTEST) * len(light))].mean())


def main(argv: list[str]) -> int:
    """Print a table, and write the rows where it is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", help="names of the zoo (default: five with lamps of their own)")
    parser.add_argument("--publish", action="store_true", help="write the rows")
    arguments = parser.parse_args(argv)
    rows = []
    print(f"{'scene':24} {'energy':>8} {'noise':>8}")
    for name, path in present(arguments.scenes or CHOSEN):
        scene = load(path)
        if not scene.has_static_light:
            print(f"{name:24} no light of its own")
            continue
        energy, noise = measure(scene)
        print(f"{name:24} {energy:8.3f} {noise:8.3f}", flush=True)
        rows += [without_bar(f"{name}: light of samples over that of paths", energy, "of 1")]
        rows += [without_bar(f"{name}: difference of the halves of samples over their mean", noise, "of 1")]
    if arguments.publish:
        publish("own_light", rows)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
