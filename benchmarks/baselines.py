"""Baselines of the literature at equal time: relMSE of Mitsuba's ``path`` over theirs, on the given scenes.

    python benchmarks/baselines.py            every scene; writes results/baselines.json
    python benchmarks/baselines.py --quick    a smoke run on the built-in Cornell box; writes nothing

``path`` renders ``SPP`` samples; each of the others gets the wall time that this took: pictures of more and more
samples tell how many fit. Medians of ``REPEATS`` turns. References are those of radiance_cache.py.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from radiance_cache import PLAN, QUICK, cold, timed
from radiance_cache_truth import NAMES, Truth, path_tracer, scene_of, truth_of
from rows import Row, publish, without_bar

from lightwell.backend import mi
from lightwell.rendering import irradiance_cache, virtual_point_lights

METHODS = ("vpl", "irradiance-cache", "nrc")
# Pictures by which the number of samples is found, the first of which compiles, and by how much each may have more.
TRIES, GROWTH = 4, 8
QUIET = "needs a quiet machine and the given scenes"


def integrator_of(method: str, scene: Any, seconds: float) -> Any:
    """A new integrator of a method; the radiance cache takes its time by itself."""
    if method == "nrc":
        return cold({"mode": "still", "seconds": seconds}, scene)
    return mi.load_dict({"type": {"vpl": "lightwell_vpl", "irradiance-cache": "lightwell_irradiance_cache"}[method]})


def samples_in(method: str, scene: Any, sensor: Any, seconds: float) -> int:
    """Samples per pixel that a method renders in so much time."""
    if method == "nrc":
        return 1

    def took(spp: int) -> float:
        return timed(lambda: mi.render(scene, sensor=sensor, integrator=made, spp=spp, seed=9))[1]

    made, count = integrator_of(method, scene, 0), 1
    for _ in range(TRIES):
        count = int(np.clip(count * seconds / took(count), 1, GROWTH * count))
    return count


def compared(scene: Any, sensor: Any, truth: Truth, spp: int, repeats: int) -> dict[str, tuple[float, float]]:
    """Method to (relMSE of path over its own, wall time over path's), medians."""
    _, seconds = timed(lambda: mi.render(scene, sensor=sensor, integrator=path_tracer(), spp=spp, seed=1))
    found: dict[str, list[tuple[float, float]]] = {method: [] for method in METHODS}
    counts = {method: samples_in(method, scene, sensor, seconds) for method in METHODS}
    for seed in range(repeats):
        theirs, wall = timed(
            lambda seed=seed: mi.render(scene, sensor=sensor, integrator=path_tracer(), spp=spp, seed=200 + seed)
        )
        for method in METHODS:
            integrator = integrator_of(method, scene, wall)
            picture, took = timed(
                lambda integrator=integrator, method=method, seed=seed: mi.render(
                    scene, sensor=sensor, integrator=integrator, spp=counts[method], seed=100 + seed
                )
            )
            found[method].append((truth.error(theirs) / max(truth.error(picture), 1e-9), took / wall))
    return {m: (float(a), float(b)) for m, values in found.items() for a, b in [np.median(values, axis=0)]}


def rows(quick: bool) -> list[Row]:
    """Rows of all scenes; those that are not on this machine are unmeasured."""
    virtual_point_lights.register()
    irradiance_cache.register()
    plan, made = (QUICK if quick else PLAN), []
    for name in ("cornell",) if quick else NAMES:
        scene = _built_in(plan["size"]) if quick else scene_of(name, plan["size"])
        what = f"equal time: relMSE of path over that of {{}}, {name}"
        if scene is None:
            made += [without_bar(what.format(method), None, "ratio", QUIET) for method in METHODS]
            continue
        sensor = scene.sensors()[0]
        truth = _truth(scene, sensor, plan) if quick else truth_of(name, scene, sensor, plan["size"], plan["reference"])
        for method, (gain, time) in compared(scene, sensor, truth, plan["spp"], plan["repeats"]).items():
            made.append(without_bar(what.format(method), gain, "ratio", f"in {time:.2f} of the time of path"))
    return made


def _built_in(size: int) -> Any:
    """The Cornell box with a lamp."""
    from lightwell.cache.live_scene import LiveScene
    from lightwell.scenes import load

    return LiveScene(load("cornell"), size).scene


def _truth(scene: Any, sensor: Any, plan: dict[str, Any]) -> Truth:
    """A short reference that is not kept."""
    halves = [
        np.array(mi.render(scene, sensor=sensor, integrator=path_tracer(), spp=plan["reference"], seed=s))[..., :3]
        for s in (1, 2)
    ]
    return Truth(*halves, 2 * plan["reference"])


def main() -> None:
    """Measure and publish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a smoke run; writes nothing")
    arguments = parser.parse_args()
    publish("baselines", rows(arguments.quick), arguments.quick)


if __name__ == "__main__":
    main()
