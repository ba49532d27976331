"""The figures of the lens, measured side by side on this machine.

    python benchmarks/lens.py                 every figure; writes results/lens.json (about 15 minutes on 2 cores)
    python benchmarks/lens.py --quick         a smoke run; writes nothing
    python benchmarks/lens.py --only speed,hd

Blender's rows need a Python that has bpy: LIGHTWELL_BPY=/path/to/venv/bin/python (pip install bpy "numpy<2"), the
Numba twin one that has numba: LIGHTWELL_NUMBA; the C twin needs gcc. All are skipped where they are absent. Pictures go
to docs/images with --pictures.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import lens_scenes
from lens_measure import all_pixels, clipped_psnr, median_seconds, processor_seconds, turn_about
from lens_physical import blender, physical, samples
from lens_recipes import bokeh, recipes
from lens_twins import twin
from rows import Row, at_least, at_most, chosen, of_gpu, publish, without_bar

from lightwell.lens import families, psf, solve
from lightwell.lens.aperture import DISC
from lightwell.lens.bake import bake_node
from lightwell.lens.camera import LensCamera
from lightwell.lens.layers import Layer
from lightwell.lens.library import load
from lightwell.lens.library_cache import STANDARD
from lightwell.lens.pipeline import Lens
from lightwell.lens.recipes import Recipe, primal
from lightwell.lens.report import Report
from lightwell.lens.settings import LensSettings
from lightwell.lens.splat import Frame, Points, guard_for, splat

RADII = (8, 16, 32, 64)


def dense(rgba: np.ndarray, s: np.ndarray, motion: np.ndarray | None = None, steps: int = 64) -> np.ndarray:
    """Brute force with kernels of every pixel's own radius (to 1/steps px): the reference of the same input."""
    key = np.rint(np.abs(s) * steps).astype(np.int64)
    radii, which = np.unique(key, return_inverse=True)
    kernels = [primal(psf.capsule(k / steps)) if k / steps >= 0.5 else primal(np.ones((1, 1))) for k in radii]
    points = Points.of(kernels)
    frame = Frame(*s.shape, guard_for(points, False))
    return frame.crop(splat(frame, points, all_pixels(rgba, which)).picture.transpose(2, 0, 1)).transpose(1, 2, 0)


# ---------------------------------------------------------------------- same model


def psnr(quick: bool) -> list[Row]:
    """The ramp of the specification against brute force with each pixel's own radius."""
    rows = []
    for name, highlights in (("without highlights", 0.0), ("with 40 highlights of value 40", 40.0)):
        rgba, s = lens_scenes.ramp(128 if quick else 384, 24.0, highlights)
        exact, report = dense(rgba, s), Report()
        lens = Lens(LensSettings(edges="dark", layers=1))
        made = lens.blur(Layer(rgba, s, None), report)
        share = 100 * report.points / (np.pi * (np.abs(s) + 0.5) ** 2).mean()
        note = f"{report.points:.0f} points a pixel, {share:.1f} % of dense, {report.fine} pixels lossless"
        rows.append(at_least(f"PSNR against dense, ramp 0-24 px {name}", 50, clipped_psnr(made, exact), "dB", note))
        rows.append(at_most(f"points over dense, ramp 0-24 px {name}", 20, share, "%"))
        for solver in ("7/5", "5/3"):
            pyramid = Lens(LensSettings(edges="dark", layers=1, solver=solver)).blur(Layer(rgba, s, None), Report())
            what = f"PSNR against dense, ramp {name}, through the pyramid {solver}"
            rows.append(without_bar(what, clipped_psnr(pyramid, exact), "dB"))
    rows += _moving(quick)
    return rows


def _moving(quick: bool) -> list[Row]:
    """Blur and motion together, at every angle, against dense capsules turned in the frame."""
    size = 96 if quick else 192
    rgba, _ = lens_scenes.ramp(size, 12, 0)
    s = np.full((size, size), 8.0, np.float32)
    angle = np.deg2rad(30)
    motion = np.zeros((size, size, 2), np.float32)
    motion[:] = 24 * np.array([np.cos(angle), np.sin(angle)])
    from scipy.signal import fftconvolve

    from lightwell.lens.aperture import DISC

    kernel = psf.shaped(DISC, 8.0, 24.0, angle)
    exact = np.stack([fftconvolve(rgba[..., c].astype(float), kernel, mode="same") for c in range(4)], -1)
    report = Report()
    made = Lens(LensSettings(edges="dark", layers=1)).blur(Layer(rgba, s, motion), report)
    share = 100 * report.points / np.count_nonzero(kernel)
    note = f"8 px, motion 24 px at 30°, {share:.0f} % of the points, four writes each"
    return [at_least("PSNR against dense, depth and motion together", 50, clipped_psnr(made, exact), "dB", note)]


def speed(quick: bool) -> list[Row]:
    """Constant radius, 512² RGBA: dense scatter over sparse scatter and solve, the same loop."""
    size, rounds = (128, 1) if quick else (512, 5)
    rgba = np.random.default_rng(0).random((size, size, 4)).astype(np.float32)
    rows, ours = [], {}
    for radius in (8, 32) if quick else RADII:
        family = families.depth(float(radius))
        node = family.size - 1
        made = dict(bake_node(family, node, Recipe()))[0]
        few, many = Points.of([made]), Points.of([primal(family.kernel(node))])
        sources = all_pixels(rgba, np.zeros((size, size)))
        sparse_frame, dense_frame = (Frame(size, size, guard_for(p, False)) for p in (few, many))

        def sparse(frame=sparse_frame, points=few, sources=sources):
            charges = splat(frame, points, sources).charges
            return frame.crop(solve.dst(np.ascontiguousarray(charges.transpose(2, 0, 1))))

        def brute(frame=dense_frame, points=many, sources=sources):
            return splat(frame, points, sources).picture

        ours[radius], theirs = turn_about(sparse, brute, rounds)
        error = clipped_psnr(
            sparse().transpose(1, 2, 0), dense_frame.crop(brute().transpose(2, 0, 1)).transpose(1, 2, 0)
        )
        counts = f"{len(made)} points against {many.count[0]}"
        work = [processor_seconds(run, 1 if quick or (run is brute and radius == 64) else 5) for run in (brute, sparse)]
        times = (
            f"{1e3 * ours[radius]:.0f} against {1e3 * theirs:.0f} ms; {work[0] / work[1]:.1f} times in processor time"
        )
        note = f"{counts}, {times}, {error:.1f} dB, leak {made.score.leak:.4f}"
        bar = {32: 20, 64: 60}.get(radius)
        what = f"speed over dense at radius {radius} px, 512² RGBA, solve included"
        ratio = theirs / ours[radius]
        rows.append(at_least(what, bar, ratio, "times", note) if bar else without_bar(what, ratio, "times", note))
    first, last = min(ours), max(ours)
    what = "time at radius 64 px over radius 8 px" if not quick else "time at radius 32 px over radius 8 px"
    rows.append(at_most(what, 4, ours[last] / ours[first], "times", "dense: 54 times the points"))
    return rows


def whole_frame(width: int, height: int, radius: float) -> tuple[np.ndarray, np.ndarray, LensCamera]:
    """A chequered slope and a disc before it: colours [H, W, 3], depth [H, W], camera that blurs up to a radius."""
    y, x = np.mgrid[:height, :width]
    rgb = 0.2 + 0.6 * (((x // 40) + (y // 40)) % 2)[..., None] * np.array([1, 0.8, 0.6])
    camera = LensCamera(focus=2.0, fstop=1.0, focal=0.05)
    depth = 2.0 + 8.0 * x / width
    depth[(x - width / 2) ** 2 + (y - height / 2) ** 2 < (height / 4) ** 2] = 1.2
    largest = np.abs(camera.confusion(depth, width)).max()
    return rgb, depth, replace(camera, fstop=float(largest / radius))


def uhd(quick: bool) -> list[Row]:
    """Whole 3840×2160 frames, two layers, each in a process of its own, whose memory is read at its end."""
    rows = []
    for radius in (32, 64):
        words = [sys.executable, __file__, "--uhd", str(radius), *(["--quick"] if quick else [])]
        done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True)
        found = json.loads(done.stdout.strip().splitlines()[-1])
        what = f"3840x2160 RGB, radius up to {radius} px, 2 layers"
        note = f"in bands; the frame itself is {found['frame']:.2f} GB"
        rows.append(at_most(f"{what}: time", 6, found["seconds"], "s", note))
        rows.append(at_most(f"{what}: peak memory of the process", 3, found["memory"], "GB", note))
    return rows


def uhd_child(radius: int, quick: bool) -> None:
    """Blur the frame, and print seconds and the largest resident memory of the process."""
    import resource

    rgb, depth, camera = whole_frame(*((384, 216) if quick else (3840, 2160)), radius)
    lens = Lens(LensSettings(layers=2))
    seconds = median_seconds(lambda: lens.apply(rgb, depth, None, camera), 1 if quick else 3)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    print(json.dumps({"seconds": seconds, "memory": memory, "frame": (rgb.nbytes + depth.nbytes) / 1e9}), flush=True)


def hd(quick: bool) -> list[Row]:
    """A whole 1920×1080 frame, radius up to 32 px."""
    rgb, depth, camera = whole_frame(*((192, 108) if quick else (1920, 1080)), 32)
    rows = []
    for layers in (1, 2):
        lens = Lens(LensSettings(layers=layers))
        reports = []

        def run(lens=lens, reports=reports):
            reports.append(lens.apply(rgb, depth, None, camera)[1])

        rounds = 1 if quick else 3
        seconds = median_seconds(run, rounds)
        start = time.process_time()
        run()
        processor = time.process_time() - start
        parts = ", ".join(f"{k} {v:.2f}" for k, v in reports[-1].seconds.items())
        what = f"1920x1080 RGB, radius up to 32 px, {layers} layer{'s' if layers > 1 else ''}"
        note = f"{processor:.2f} s of processor time; {reports[-1].points:.0f} points a pixel; {parts} s"
        rows.append(at_most(what, 2.5, seconds, "s", note))
    return rows


def energy(quick: bool) -> list[Row]:
    """Energy of sources inside the guard band, and the leak of every sparse node of the standard library."""
    rng = np.random.default_rng(1)
    rgba = np.zeros((256, 256, 4), np.float32)
    rgba[64:192, 64:192] = rng.random((128, 128, 4))
    s = np.zeros((256, 256), np.float32)
    s[:] = np.linspace(0, 40, 256)[:, None]
    made = Lens(LensSettings(edges="dark", layers=1)).blur(Layer(rgba, s, None), Report())
    wrong = float(np.abs(made.sum((0, 1), dtype=np.float64) / rgba.sum((0, 1), dtype=np.float64) - 1).max())
    motion = np.zeros((256, 256, 2), np.float32)
    motion[..., 0], motion[..., 1] = 20, 9
    options = LensSettings(edges="dark", layers=1)
    joint = Lens(options).blur(Layer(rgba, np.full_like(s, 7.0), motion), Report())
    moved = float(np.abs(joint.sum((0, 1), dtype=np.float64) / rgba.sum((0, 1), dtype=np.float64) - 1).max())
    libraries = [load(path, DISC) for path in sorted(STANDARD.glob("*.lwsp"))]
    sparse = [
        s for library in libraries for (_, tier), s in library.nodes.items() if tier == 0 and s.recipe == "sparse"
    ]
    note = f"all {len(sparse)} sparse nodes of the {len(libraries)} standard libraries, to 64 px, motion to 32 px"
    return [
        at_most("energy: |sum out / sum in - 1|, radius 0 to 40 px", 1e-3, wrong, ""),
        at_most("energy: the same with motion of 22 px", 1e-3, moved, ""),
        at_most("leak outside supports, worst node", 0.02, max(s.score.leak for s in sparse), "of the mass", note),
        without_bar("relative L2 of the worst sparse node", max(s.score.error for s in sparse), "", note),
    ]


def spill(quick: bool) -> list[Row]:
    """A blurred half-plane before a sharp background, and a sharp disc before a bright blurred one."""
    width, r = 240, 24.0
    unit = LensCamera(focus=2.0, fstop=1.0, focal=0.05)
    camera = replace(unit, fstop=float(unit.confusion(1.0, width) / -r))
    depth = np.where(np.arange(width) < 120, 1.0, 2.0) * np.ones((96, 1))
    rgba = np.zeros((96, width, 4))
    rgba[..., 3] = 1
    rgba[:, :120, 0], rgba[:, 120:, 1] = 1, 1
    out, _ = Lens().apply(rgba, depth, None, camera)
    d = np.clip((np.arange(width) + 0.5 - 120) / r, -1, 1)
    alpha = (np.arccos(d) - d * np.sqrt(1 - d * d)) / np.pi
    profile = float(np.abs(out[48, :, 0] - alpha).max())
    y, x = np.mgrid[:160, :160]
    disc = (x - 80) ** 2 + (y - 80) ** 2 < 40**2
    bright = np.zeros((160, 160, 4))
    bright[..., 3] = 1
    bright[~disc, :3] = 10
    camera = replace(unit, fstop=float(unit.confusion(50.0, 160) / 16))
    made, _ = Lens().apply(bright, np.where(disc, 2.0, 50.0), None, camera)
    inside = (x - 80) ** 2 + (y - 80) ** 2 < 38**2
    bleed = float(made[inside][:, :3].max() / 10)
    return [
        at_most("foreground spill: largest distance from the closed form, 24 px", 0.01, profile, "of full"),
        at_most("background light on a sharp foreground, largest", 1e-3, bleed, "of the background"),
    ]


def gpu(quick: bool) -> list[Row]:
    """1024², two layers: the browser's lens, which benchmarks/gpu.py runs on a GPU."""
    figure = "GPU: the browser's lens at 1024x1024, two layers, radius up to 32 px"
    return [of_gpu("GPU: 1024x1024, two layers, radius up to 32 px", figure)]


PARTS = {
    "bokeh": bokeh,
    "psnr": psnr,
    "speed": speed,
    "hd": hd,
    "uhd": uhd,
    "energy": energy,
    "spill": spill,
    "physical": physical,
    "blender": blender,
    "recipes": recipes,
    "samples": samples,
    "twin": twin,
    "gpu": gpu,
}
WITH_PICTURES = ("bokeh", "physical", "recipes", "samples")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="smoke run, writes nothing")
    parser.add_argument("--only", help=f"parts, of {', '.join(PARTS)}")
    parser.add_argument("--pictures", action="store_true", help="write the pictures of docs/lens.md")
    parser.add_argument("--uhd", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.uhd:
        return uhd_child(arguments.uhd, arguments.quick)
    for part in chosen("--only", arguments.only, PARTS):
        extra = (arguments.pictures,) if part in WITH_PICTURES else ()
        publish("lens", PARTS[part](arguments.quick, *extra), arguments.quick)


if __name__ == "__main__":
    main()
