"""Share of points that lie close under other surfaces, which are neither learned nor scored.

    python benchmarks/buried.py [--publish] [SCENE ...]

By area: of the points that pass the other tests of ``transport/point_rejection.py``. In view: of the pixels of the
scene's own and of sampled cameras that show a surface. A rule that is too strict would show in the second figure.
``--publish`` writes ``results/buried.json``.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from rows import publish, without_bar
from zoo_scenes import SUBSET, present

from lightwell.scenes.load import load
from lightwell.scenes.placing import sample_cameras
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import declare
from lightwell.transport.camera import gbuffer
from lightwell.transport.point_rejection import Rejection, reject
from lightwell.transport.surface import sample_surface

POINTS, CAMERAS, SIZE = 1 << 14, 16, (96, 64)


def by_area(scene: Scene, seed: int = 0) -> float:
    """Measure the share of the surface that is buried, of what nothing else rejects."""
    report = Rejection()
    kept = sample_surface(scene, POINTS, seed, floor=1, report=report)
    return report.buried / (report.buried + len(kept))


def in_view(scene: Scene, seed: int = 0) -> float:
    """Measure the share of buried points among the pixels of cameras that show a surface."""
    report, shown = Rejection(), 0
    for camera in sample_cameras(scene, declare((), scene), CAMERAS, seed, authored=True):
        points, mask, _ = gbuffer(scene, camera, *SIZE)
        points = points[np.flatnonzero(mask)]
        shown += len(points)
        reject(scene, points, report=report, walks=False)
    return report.buried / max(shown, 1)


def main(argv: list[str]) -> int:
    """Print a table, and write the rows where it is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", help="names of the zoo (default: eight of them)")
    parser.add_argument("--publish", action="store_true", help="write the rows")
    arguments = parser.parse_args(argv)
    rows = []
    print(f"{'scene':24} {'by area':>8} {'in view':>8}")
    for name, path in present(arguments.scenes or SUBSET):
        scene = load(path)
        area, view = 100 * by_area(scene), 100 * in_view(scene)
        print(f"{name:24} {area:7.2f}% {view:7.2f}%", flush=True)
        rows += [without_bar(f"{name}: buried by area", area, "%"), without_bar(f"{name}: buried in view", view, "%")]
    if arguments.publish:
        publish("buried", rows)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
