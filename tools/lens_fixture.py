"""Frames of the lens for the web's tests, made by the Python reference: python tools/lens_fixture.py

Writes web/test/fixtures/lens.json.gz: integer images, solved pictures, a whole frame of one to three layers, and the
libraries that they were made with, so that a library that is baked anew does not touch them.
"""

from __future__ import annotations

import base64
import gzip
import json
from pathlib import Path

import numpy as np

from lightwell.lens import fixed
from lightwell.lens.camera import LensCamera
from lightwell.lens.choose import uniform
from lightwell.lens.engine import TOLERANCE, Engine
from lightwell.lens.layers import Layer
from lightwell.lens.library import Library, load
from lightwell.lens.pipeline import Lens
from lightwell.lens.report import Report
from lightwell.lens.settings import LensSettings
from lightwell.lens.splat import Frame, guard_for

ROOT = Path(__file__).resolve().parents[1]
FIXTURES = ROOT / "web/test/fixtures"
DISC = ROOT / "lightwell/lens/standard/disc-32.lwsp"
JOINT = ROOT / "lightwell/lens/standard/disc-16-speed-32.lwsp"
# Values this near to where a rounding or a choice of node flips are drawn again: single precision may flip them.
CLEAR = 0.02


class Given:
    """A shelf with whole libraries: nothing is baked."""

    def __init__(self, library: Library) -> None:
        self._library = library

    def library(self, *_) -> Library:
        return self._library

    def ensure(self, *_) -> int:
        return 0


def engine(library: Library, solver: str = "fft") -> Engine:
    # Where a node has no finer tier, Python makes a dense kernel for bright pixels and the browser does not.
    tolerance = TOLERANCE if any(tier for _, tier in library.nodes) else np.inf
    return Engine(library.family, library.recipe, Given(library), solver, tolerance=tolerance)


class WithDisc(Lens):
    """The whole pipeline on one library."""

    def _engine(self, *_) -> Engine:
        return engine(load(DISC), solver="dst")


def packed(array: np.ndarray) -> dict:
    kind = {"f": "f4", "i": "i4"}[array.dtype.kind]
    data = np.ascontiguousarray(array).astype(f"<{kind}")
    return {"shape": list(array.shape), "type": kind, "data": base64.b64encode(data.tobytes()).decode()}


def clear_of(values: np.ndarray, edge: float) -> np.ndarray:
    return np.abs(values - np.floor(values) - edge) > CLEAR


def still(rng) -> dict:
    """Pixels at rest, one layer: integers, bit for bit, and the solved picture."""
    height, width = 30, 40
    library = load(DISC)
    _, x = np.mgrid[:height, :width]
    s = ((x - 20) * 0.45 + 0.1 * rng.random((height, width))).astype(np.float32)
    light = rng.integers(1, 64, (height, width, 4)).astype(np.float32) / 64
    light[..., 3] = 1
    light[rng.random((height, width)) < 0.01, :3] *= 512
    light[5:9, 5:20] = 0
    radii = np.asarray(library.family.radius.values)
    for _ in range(50):
        position = np.interp(np.abs(s), radii, np.arange(len(radii)))
        vague = ~clear_of(position, 0.5)
        plan = engine(library).plan(Layer(light, s, None), Report())
        scale = plan.points.scale[plan.sources.record].astype(np.float64)
        u = plan.sources.rgba.astype(np.float64) * scale[:, None] * 65536
        _, exponent = np.frexp(np.abs(u).max(1))
        m = u * np.exp2(np.clip(15 - exponent, 0, 29))[:, None]
        torn = np.zeros((height, width), bool)
        torn[plan.sources.y, plan.sources.x] = ~clear_of(m, 0.5).all(1)
        if not vague.any() and not torn.any():
            break
        s[vague] += 0.004
        light[torn, :3] = np.round(light[torn, :3] * 64 + rng.integers(1, 3)) / 64
        light[torn, 3] = rng.integers(32, 64, int(torn.sum())) / 64
    else:
        raise SystemExit("lens_fixture: no clear values found; use another seed")
    guard = guard_for(plan.points, False)
    frame = Frame(height, width, guard)
    planes = fixed.scatter(frame, plan.points, plan.sources)
    picture = engine(library).integrate(frame, fixed.splat(frame, plan.points, plan.sources))
    return {
        "light": packed(light), "s": packed(s), "guard": guard, "picture": packed(picture),
        "primal": packed(planes.picture[: height + 2 * guard, : width + 2 * guard]),
        "charges": packed(planes.charges[: height + 2 * guard, : width + 2 * guard]),
    }  # fmt: skip


def moving(rng, library: Library) -> dict:
    """Pixels in motion: depth and speed by dither, turned."""
    height, width, number = 24, 32, 3
    y, x = np.mgrid[:height, :width]
    s = (rng.random((height, width)) * 18 - 9).astype(np.float32)
    angle = (x / 5 + y / 7).astype(np.float64)
    length = 1 + 13 * rng.random((height, width))
    light = rng.integers(1, 64, (height, width, 4)).astype(np.float32) / 64
    for _ in range(200):
        motion = (length[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1)).astype(np.float32)
        vague = np.zeros((height, width), bool)
        for number_of, (axis, value) in enumerate(
            ((library.family.radius, np.abs(s)), (library.family.length, np.hypot(motion[..., 0], motion[..., 1])))
        ):
            _, fraction, _ = axis.locate(value)
            vague |= np.abs(fraction - uniform(x, y, 16 * number, number_of)) < 1e-3
        turns = motion.astype(np.float64) / np.hypot(motion[..., 0], motion[..., 1])[..., None] * 16384
        torn = ~clear_of(turns, 0.5).all(-1)
        plan = engine(library).plan(Layer(light, s, motion), Report(), 16 * number)
        scale = plan.points.scale[plan.sources.record].astype(np.float64)
        u = plan.sources.rgba.astype(np.float64) * scale[:, None] * 65536
        _, exponent = np.frexp(np.abs(u).max(1))
        m = (u * np.exp2(np.clip(15 - exponent, 0, 29))[:, None]).reshape(height, width, 4)
        dull = ~clear_of(m, 0.5).all(-1)
        if not (vague | torn | dull).any():
            break
        s[vague] += 0.013
        length[vague] += 0.017
        angle[torn] += 0.0123
        light[dull] = rng.integers(1, 64, (int(dull.sum()), 4)) / 64
    else:
        raise SystemExit("lens_fixture: no clear values found for motion; use another seed")
    guard = guard_for(plan.points, True)
    frame = Frame(height, width, guard)
    planes = fixed.scatter(frame, plan.points, plan.sources)
    picture = engine(library).integrate(frame, fixed.splat(frame, plan.points, plan.sources))
    cropped = {
        name: packed(plane[: height + 2 * guard, : width + 2 * guard])
        for name, plane in (("primal", planes.picture), ("charges", planes.charges))
        if plane is not None
    }
    return {
        "light": packed(light), "s": packed(s), "motion": packed(motion), "guard": guard, "number": number,
        "picture": packed(picture), **cropped,
    }  # fmt: skip


def frame_of_layers() -> dict:
    """Bars before a wall in focus with a bright lamp and a far window: the whole pipeline, borders extended."""
    height, width = 60, 80
    y, x = np.mgrid[:height, :width]
    light = np.ones((height, width, 4), np.float32)
    light[..., :3] = (0.2 + 0.6 * (((x // 6) + (y // 6)) % 2))[..., None] * [0.9, 0.8, 0.6]
    depth = np.full((height, width), 2.0, np.float32)
    far = (x > 56) & (y < 34)
    light[far, :3], depth[far] = [0.5, 0.7, 1.0], np.inf
    bars = ((x + y // 4) % 24) < 5
    light[bars, :3], depth[bars] = [0.8, 0.2, 0.1], 1.1
    light[40:42, 60:62, :3] = 60
    camera = LensCamera(focus=2.0, fstop=1.0, focal=0.05)
    camera = LensCamera(focus=2.0, focal=0.05, fstop=float(camera.confusion(1.1, width) / -7))
    out, _ = WithDisc(LensSettings(layers=2)).apply(light, depth, None, camera)
    three, report = WithDisc(LensSettings(layers=3)).apply(light, depth, None, camera)
    assert report.layers == 3, report.layers
    one, _ = WithDisc(LensSettings(layers=1, edges="renormalise")).apply(light, depth, None, camera)
    return {
        "light": packed(light), "depth": packed(depth), "out": packed(out), "one": packed(one),
        "three": packed(three),
        "camera": {"focus": camera.focus, "fstop": camera.fstop, "focal": camera.focal, "sensor": camera.sensor},
    }  # fmt: skip


def main() -> None:
    rng = np.random.default_rng(6)
    cases = {"still": still(rng), "moving": moving(rng, load(JOINT)), "frame": frame_of_layers()}
    cases |= {
        "disc": base64.b64encode(DISC.read_bytes()).decode(),
        "joint": base64.b64encode(JOINT.read_bytes()).decode(),
    }
    with gzip.GzipFile(FIXTURES / "lens.json.gz", "wb", mtime=0) as file:
        file.write(json.dumps(cases).encode())
    print(*cases, (FIXTURES / "lens.json.gz").stat().st_size)


if __name__ == "__main__":
    main()
