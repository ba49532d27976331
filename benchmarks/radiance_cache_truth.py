"""References for the figures of the radiance cache: path-traced pictures, in two independent halves, kept and extended.

With halves A and B of the truth T, mean((I - A) (I - B) / (R^2 + eps)) has the expectation of mean((I - T)^2 / ...):
the noise of the reference does not count. R is the mean of all halves.

    python benchmarks/radiance_cache_truth.py --spp 2048 --scenes veach-ajar,cornell-box    make or extend them
"""

from __future__ import annotations

import argparse
import math
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from zoo_scenes import scenes

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, settings_of
from lightwell.cache.live_scene import Lamp, LiveScene
from lightwell.cache.scene_region import bounds_of
from lightwell.scenes import load
from lightwell.scenes.placing import initial_light, sample_cameras
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import declare

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT.parent / "shared" / "scenes" / "mitsuba"
NAMES = ("veach-ajar", "living-room-2", "staircase2", "veach-bidir", "cornell-box")
EPSILON = 0.01
# Emitters from which on references are traced by ours.
MANY_EMITTERS = 16
# Samples of one launch of a reference; seeds of references begin here, those of comparisons stay below.
CHUNK, FIRST_SEED = 32, 100_000
# Ignored by git.
FOLDER = ROOT / "out" / "references"


@dataclass(frozen=True)
class Truth:
    """A picture that is known twice, independently."""

    a: np.ndarray
    """[H, W, 3]."""
    b: np.ndarray
    spp: int
    """Samples per pixel of both together."""

    @property
    def mean(self) -> np.ndarray:
        """The best that is known."""
        return 0.5 * (self.a + self.b)

    def error(self, picture: np.ndarray) -> float:
        """relMSE of a picture [H, W, 3], without the noise of the reference; may come out below zero near it."""
        p = picture.astype(np.float64)
        return float(np.mean((p - self.a) * (p - self.b) / (self.mean.astype(np.float64) ** 2 + EPSILON)))


def path_tracer() -> Any:
    """Mitsuba's own, unlimited depth."""
    return mi.load_dict({"type": "path", "max_depth": -1})


def reference_tracer(scene: Any) -> Any:
    """What references are traced with: Mitsuba's ``path``; of many emitters ours, which has the same mean (tests hold
    it to ``path``) and chooses emitters by the light that they bring: with uniform choice, pictures of thousands of
    samples are dark with white specks."""
    if len(scene.emitters()) <= MANY_EMITTERS:
        return path_tracer()
    tracer = NrcIntegrator(settings=settings_of({"termination_c": math.inf, "mode": "frames"}))
    tracer.cache_of(scene)
    return tracer


def source_of(name: str) -> str | None:
    """The file of a given scene, or of one of the zoo; None where it is not on this machine."""
    return scenes().get(name)


def zoo_live(source: str, size: int) -> tuple[Scene, LiveScene]:
    """A loaded scene, and it at size^2 pixels, from its first camera or one in free air; with a lamp if it has no
    light."""
    loaded = load(source)
    variable = declare((), loaded)
    camera = loaded.cameras[0] if loaded.cameras else sample_cameras(loaded, variable, 1, 0)[0]
    lamp = None
    if not loaded.mi.emitters():
        low, high = bounds_of(loaded.mi)
        lamp = Lamp(initial_light(loaded, variable, camera), float((high - low).max()) ** 2)
    return loaded, LiveScene(loaded, size, camera, lamp)


def scene_of(name: str, size: int) -> Any:
    """A scene at about size^2 pixels; None where it is not on this machine."""
    source = source_of(name)
    if source is None:
        return None
    if not source.endswith("scene_mi3.xml"):
        return zoo_live(source, size)[1].scene
    scene = mi.load_file(source)
    film = scene.sensors()[0].film()
    width, height = (int(x) for x in film.size())
    scale = size / np.sqrt(width * height)
    parameters = mi.traverse(scene.sensors()[0])
    parameters["film.size"] = [round(width * scale), round(height * scale)]
    parameters.update()
    return scene


def pixels(image: Any) -> np.ndarray:
    """[H, W, 3]."""
    return np.array(image)[..., :3]


def truth_of(name: str, scene: Any, sensor: Any, size: int, spp: int, kind: str = "") -> Truth:
    """The reference with ``spp`` samples at least; what is there is extended, and kept after every chunk."""
    path = FOLDER / f"{name}-{size}{kind}.npz"
    shape = tuple(int(x) for x in sensor.film().crop_size())[::-1]
    sums, chunks = np.zeros((2, *shape, 3)), 0
    if path.exists():
        with np.load(path) as held:
            if held["sums"].shape == sums.shape:
                sums, chunks = held["sums"].astype(np.float64), int(held["chunks"])
    wanted = 2 * -(-spp // (2 * CHUNK))
    saved, tracer = time.monotonic(), reference_tracer(scene)
    while chunks < wanted:
        seed = FIRST_SEED + chunks
        image = mi.render(scene, sensor=sensor, integrator=tracer, spp=CHUNK, seed=seed)
        sums[chunks % 2] += pixels(image)
        chunks += 1
        if chunks % 2 == 0 and (time.monotonic() - saved > 10 or chunks >= wanted):
            _keep(path, sums, chunks)
            saved = time.monotonic()
    halves = sums / (chunks / 2)
    return Truth(halves[0], halves[1], chunks * CHUNK)


def _keep(path: Path, sums: np.ndarray, chunks: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}.part.npz")
    np.savez(part, sums=sums, chunks=chunks)
    os.replace(part, path)


def main() -> None:
    """Make or extend the references."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--spp", type=int, default=1024)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--scenes", default=",".join(NAMES))
    arguments = parser.parse_args()
    for name in arguments.scenes.split(","):
        scene = scene_of(name, arguments.size)
        if scene is None:
            print(f"{name}: not on this machine")
            continue
        start = time.perf_counter()
        truth = truth_of(name, scene, scene.sensors()[0], arguments.size, arguments.spp)
        print(f"{name}: {truth.spp} spp, {time.perf_counter() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
