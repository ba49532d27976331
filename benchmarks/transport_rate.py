"""Paths per second of ``indirect`` beside Mitsuba's ``path`` integrator, in one run and at one depth.

    python benchmarks/transport_rate.py [--rounds 5] [--csv rates.csv] [SCENE.xml ...]

Ours is the same estimator here (``connections=0``). What bakes use joins light rays to the paths; how much less
variance that leaves in the same time is measured beside it.

Each scene is measured with a light of its own per sample (ours) and one fixed point light (Mitsuba), alternating, so
that whatever else the machine does hits both; the figure is the ratio of the medians. The first round compiles and is
dropped.
"""

from __future__ import annotations

import argparse
import csv
import platform
import statistics
import sys
import time
from pathlib import Path

import numpy as np

from lightwell.backend import ACTIVE, dr, mi
from lightwell.scenes.load import load
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import PointLight
from lightwell.transport.camera import gbuffer
from lightwell.transport.radiance import indirect

# Paths per launch of both sides: 128 x 128 pixels or points, 64 paths each.
SIDE, PATHS = 128, 64
# Depth of both sides.
DEPTH = 16
# The light roams the inner half of the scene's box.
INNER = 0.5


def measure(scene: Scene, rounds: int = 5, seed: int = 0) -> dict:
    """Median paths per second of both, their ratio, and every round."""
    camera = scene.cameras[0]
    low, high = (scene.center + INNER / 2 * s * (scene.bounds[1] - scene.bounds[0]) for s in (-1, 1))
    variable = PointLight(tuple(map(float, low)), tuple(map(float, high)), 0.01 * scene.extent)
    points, mask, _ = gbuffer(scene, camera, SIDE, SIDE)
    seen = np.flatnonzero(mask)
    # The same surface points for both; pixels without a surface are filled with others, as their paths would be free.
    points = points[np.resize(seen, SIDE * SIDE)]
    light = np.random.default_rng(seed).uniform(low, high, (len(points), 3)).astype(np.float32)
    lit, integrator = _mitsuba_scene(scene, light.mean(axis=0)), mi.load_dict({"type": "path", "max_depth": DEPTH})
    ours, theirs, gains = [], [], []
    for number in range(rounds + 1):
        plain, joined = (
            _timed(lambda c=c, n=number: indirect(scene, points, light, variable, PATHS, n, max_depth=DEPTH, **c))
            for c in ({"connections": 0}, {})
        )
        ours.append(plain[0])
        gains.append(plain[0] * _variance(*plain[1]) / (joined[0] * _variance(*joined[1])))
        theirs.append(_timed(lambda n=number: dr.eval(mi.render(lit, integrator=integrator, spp=PATHS, seed=n)))[0])
    paths = SIDE * SIDE * PATHS
    ours, theirs = ([paths / t for t in times[1:]] for times in (ours, theirs))
    # Mitsuba's rays that leave at once cost next to nothing: only paths that start on a surface are compared.
    theirs = [rate * mask.mean() for rate in theirs]
    a, b = statistics.median(ours), statistics.median(theirs)
    return {
        "scene": f"{Path(scene.source).parent.name}/{scene.name}",
        "ours": a,
        "mitsuba": b,
        "ratio": a / b,
        "gain": statistics.median(gains[1:]),
        "ours_all": ours,
        "mitsuba_all": theirs,
    }


def _mitsuba_scene(scene: Scene, position: np.ndarray) -> mi.Scene:
    camera = scene.cameras[0]
    frame = mi.ScalarTransform4f().look_at(list(camera.position), list(camera.target), list(camera.up))
    sensor = {"type": "perspective", "fov": camera.fov_y, "fov_axis": "y", "to_world": frame}
    sensor["film"] = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}}
    shapes = {f"shape_{i}": s for i, s in enumerate(scene.mi.shapes()) if s.emitter() is None}
    light = {"type": "point", "position": [float(x) for x in position], "intensity": 1.0}
    return mi.load_dict({"type": "scene", "sensor": sensor, "light": light, **shapes}, optimize=False)


def _timed(work) -> tuple:
    """(seconds, result)."""
    dr.sync_thread()
    start = time.perf_counter()
    result = work()
    dr.sync_thread()
    return time.perf_counter() - start, result


def _variance(a: np.ndarray, b: np.ndarray) -> float:
    """Mean relative variance of two half means [N, 3]; ε is a fifth of the mean, as in the loss."""
    y = 0.5 * (a + b)
    return float(np.mean(np.square(a - b) / (np.square(y) + np.square(0.2 * y.mean()))))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=["cornell"])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--csv", default="")
    options = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, {ACTIVE.threads} threads, {ACTIVE.variant}")
    print(
        f"python {platform.python_version()}, mitsuba {mi.__version__}, drjit {dr.__version__}, seed 0, depth {DEPTH}"
    )
    rows = [measure(load(scene), options.rounds) for scene in options.scenes]
    for row in rows:
        spread = ", ".join(f"{r / 1e6:.2f}" for r in row["ours_all"])
        print(
            f"{row['scene']}: ours {row['ours'] / 1e6:.2f} M paths/s ({spread}), "
            f"mitsuba path {row['mitsuba'] / 1e6:.2f} M paths/s, ratio {row['ratio']:.2f}; "
            f"variance of plain paths over ours in the same time {row['gain']:.2f}"
        )
    if options.csv:
        with open(options.csv, "w", newline="") as file:
            writer = csv.DictWriter(file, ["scene", "ours", "mitsuba", "ratio", "gain"], extrasaction="ignore")
            writer.writeheader()
            writer.writerows(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
