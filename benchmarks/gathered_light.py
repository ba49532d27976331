"""Light of the samples that the default field learns from, over that of full paths, lamp by lamp.

    python benchmarks/gathered_light.py [--publish] [SCENE ...]

Samples lie where people look, under lamps of the default ranges, as those of a bake: once reflected light is traced,
the rest is gathered from bins of surface. Energy: mean light of all samples. Spread: the middle 80 % of the lamps, of
what a sample has of its lamp's light. Error: median over samples, of the mean under the same lamp where they are dark.
``--publish`` writes ``results/gathered_light.json``.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import numpy as np
from rows import publish, without_bar
from zoo_scenes import SUBSET, present

from lightwell.scenes.load import load
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import declare
from lightwell.transport import SurfacePoints, indirect
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings

SHARDS, LAMPS, POINTS_PER_LAMP, TRUE_PATHS = 16, 64, 128, 2048
# Lamps that light less than this share of what lamps usually do are left out: the noise of the truth decides them. The
# same share of a lamp's mean light is added to what errors are relative to.
FAINT, LEVEL = 0.05, 0.1
OTHERS = ("bakedgi-building", "bevy-volumetric-fog", "kenney-fps-level", "godot-truck-town")


@dataclass(frozen=True)
class Light:
    """Figures of one scene."""

    energy: float
    low: float
    high: float
    error: float


def measure(scene: Scene, seed: int = 0) -> Light:
    """Compare samples of one scene with full paths."""
    variable = declare((), scene)
    settings = ShardSettings(paths=16, seed=seed, lights=LAMPS, points_per_light=POINTS_PER_LAMP)
    shards = GatheredShards(scene, variable, settings, GatherSize.of(SHARDS, ShardSettings(paths=16)))
    columns = shards(scene, variable, None, settings, 0)[0]
    points = SurfacePoints(*(columns[name] for name in ("shape", "triangle", "barycentric", "view")))
    truth = np.mean(indirect(scene, points, columns["light"], variable, TRUE_PATHS, seed + 1)[:2], axis=0)
    found = 0.5 * (columns["half_a"] + columns["half_b"])
    valid = np.isfinite(found + truth).all(axis=1)
    found, truth = (np.where(valid, x.mean(axis=1), 0).reshape(LAMPS, POINTS_PER_LAMP) for x in (found, truth))
    mean = truth.mean(axis=1)
    bright = mean > FAINT * np.median(mean)
    low, high = np.quantile(found.mean(axis=1)[bright] / mean[bright], (0.1, 0.9))
    error = np.abs(found - truth)[bright] / (truth + LEVEL * mean[:, None])[bright]
    return Light(float(found.mean() / truth.mean()), float(low), float(high), float(np.median(error)))


def main(argv: list[str]) -> int:
    """Print a table, and write the rows where it is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", help="names of the zoo (default: 12 of them)")
    parser.add_argument("--publish", action="store_true", help="write the rows")
    arguments = parser.parse_args(argv)
    rows, energies = [], []
    print(f"{'scene':24} {'energy':>7} {'lamps, middle 80 %':>19} {'error':>6}")
    for name, path in present(arguments.scenes or [*SUBSET, *OTHERS]):
        light = measure(load(path))
        energies.append(light.energy)
        print(f"{name:24} {light.energy:7.3f} {light.low:9.3f} {light.high:9.3f} {light.error:6.3f}", flush=True)
        note = (
            f"middle 80 % of the lamps: {light.low:.3f} to {light.high:.3f}; median error of a sample {light.error:.3f}"
        )
        rows.append(without_bar(f"{name}: light of samples over that of full paths", light.energy, "of 1", note))
    if energies:
        rows.append(without_bar("median: light of samples over that of full paths", float(np.median(energies)), "of 1"))
    if arguments.publish:
        publish("gathered_light", rows)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
