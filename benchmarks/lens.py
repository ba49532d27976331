"""The figures of the lens, measured side by side on this machine.

    python benchmarks/lens.py                 every figure; writes results/lens.json (about 15 minutes on 2 cores)
    python benchmarks/lens.py --quick         a smoke run; writes nothing
    python benchmarks/lens.py --only speed,hd

Blender's rows need a Python that has bpy: LIGHTWELL_BPY=/path/to/venv/bin/python (pip install bpy "numpy<2"). The C
twin needs gcc. Both are skipped where they are absent. Pictures go to docs/images with --pictures.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import lens_scenes
from rows import Row, at_least, at_most, publish, without_bar

from lightwell.lens import families, psf, solve
from lightwell.lens.bake import bake_node
from lightwell.lens.cache import Shelf
from lightwell.lens.camera import Camera
from lightwell.lens.engine import Engine
from lightwell.lens.layers import Layer
from lightwell.lens.pipeline import Lens, Settings
from lightwell.lens.recipes import Recipe, primal
from lightwell.lens.report import Report
from lightwell.lens.splat import Frame, Points, Sources, guard_for, splat
from lightwell.report.metrics import flip, ssim

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "images"
RADII = (8, 16, 32, 64)


def median_seconds(run, rounds: int) -> float:
    """Median wall time after one warm-up."""
    run()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def turn_about(ours, theirs, rounds: int, each: int = 3) -> tuple[float, float]:
    """Median wall times of two runs that take turns, after one warm-up: ours ``each`` times, then theirs once."""
    ours(), theirs()
    times = ([], [])
    for _ in range(rounds):
        for kept, run, count in ((times[0], ours, each), (times[1], theirs, 1)):
            for _ in range(count):
                start = time.perf_counter()
                run()
                kept.append(time.perf_counter() - start)
    return float(np.median(times[0])), float(np.median(times[1]))


def processor_seconds(run, rounds: int) -> float:
    """Least processor time of all threads: what the work costs when others use the machine too."""
    times = []
    for _ in range(rounds):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def clipped_psnr(a: np.ndarray, b: np.ndarray) -> float:
    """Decibels of two pictures clipped to [0, 1], RGB."""
    error = np.mean((np.clip(a[..., :3], 0, 1).astype(float) - np.clip(b[..., :3], 0, 1)) ** 2)
    return float(-10 * np.log10(max(error, 1e-20)))


def _all_pixels(rgba: np.ndarray, record: np.ndarray) -> Sources:
    """Every pixel as a source."""
    y, x = (v.ravel().astype(np.int32) for v in np.mgrid[: rgba.shape[0], : rgba.shape[1]])
    ones = np.ones(x.size, np.float32)
    return Sources(x, y, rgba.reshape(-1, 4), record.ravel().astype(np.uint32), ones, None)


def dense(rgba: np.ndarray, s: np.ndarray, motion: np.ndarray | None = None, steps: int = 64) -> np.ndarray:
    """Brute force with kernels of every pixel's own radius (to 1/steps px): the reference of the same input."""
    key = np.rint(np.abs(s) * steps).astype(np.int64)
    radii, which = np.unique(key, return_inverse=True)
    kernels = [primal(psf.capsule(k / steps)) if k / steps >= 0.5 else primal(np.ones((1, 1))) for k in radii]
    points = Points.of(kernels)
    frame = Frame(*s.shape, guard_for(points, False))
    return frame.crop(splat(frame, points, _all_pixels(rgba, which)).picture.transpose(2, 0, 1)).transpose(1, 2, 0)


# ---------------------------------------------------------------------- same model


def psnr(quick: bool) -> list[Row]:
    """The ramp of the specification against brute force with each pixel's own radius."""
    rows = []
    for name, highlights in (("without highlights", 0.0), ("with 40 highlights of value 40", 40.0)):
        rgba, s = lens_scenes.ramp(128 if quick else 384, 24.0, highlights)
        exact, report = dense(rgba, s), Report()
        lens = Lens(Settings(edges="dark", layers=1))
        made = lens.blur(Layer(rgba, s, None), report)
        share = 100 * report.points / (np.pi * (np.abs(s) + 0.5) ** 2).mean()
        note = f"{report.points:.0f} points a pixel, {share:.1f} % of dense, {report.fine} pixels lossless"
        rows.append(at_least(f"PSNR against dense, ramp 0-24 px {name}", 50, clipped_psnr(made, exact), "dB", note))
        rows.append(at_most(f"points over dense, ramp 0-24 px {name}", 20, share, "%"))
        for solver in ("7/5", "5/3"):
            pyramid = Lens(Settings(edges="dark", layers=1, solver=solver)).blur(Layer(rgba, s, None), Report())
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
    made = Lens(Settings(edges="dark", layers=1)).blur(Layer(rgba, s, motion), report)
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
        sources = _all_pixels(rgba, np.zeros((size, size)))
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


def hd(quick: bool) -> list[Row]:
    """A whole 1920×1080 frame, radius up to 32 px."""
    height, width = (108, 192) if quick else (1080, 1920)
    y, x = np.mgrid[:height, :width]
    rgb = 0.2 + 0.6 * (((x // 40) + (y // 40)) % 2)[..., None] * np.array([1, 0.8, 0.6])
    camera = Camera(focus=2.0, fstop=1.0, focal=0.05)
    depth = 2.0 + 8.0 * x / width
    depth[(x - width / 2) ** 2 + (y - height / 2) ** 2 < (height / 4) ** 2] = 1.2
    largest = np.abs(camera.confusion(depth, width)).max()
    camera = replace(camera, fstop=float(largest / 32))
    rows = []
    for layers in (1, 2):
        lens = Lens(Settings(layers=layers))
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
    made = Lens(Settings(edges="dark", layers=1)).blur(Layer(rgba, s, None), Report())
    wrong = float(np.abs(made.sum((0, 1), dtype=np.float64) / rgba.sum((0, 1), dtype=np.float64) - 1).max())
    motion = np.zeros((256, 256, 2), np.float32)
    motion[..., 0], motion[..., 1] = 20, 9
    options = Settings(edges="dark", layers=1)
    joint = Lens(options).blur(Layer(rgba, np.full_like(s, 7.0), motion), Report())
    moved = float(np.abs(joint.sum((0, 1), dtype=np.float64) / rgba.sum((0, 1), dtype=np.float64) - 1).max())
    library = Shelf(keep=False).library(families.depth(64), Settings().recipe())
    sparse = [s for (_, tier), s in library.nodes.items() if tier == 0 and s.recipe == "sparse"]
    note = f"all {len(sparse)} sparse nodes of the standard library, radius 5 to 64 px"
    return [
        at_most("energy: |sum out / sum in - 1|, radius 0 to 40 px", 1e-3, wrong, ""),
        at_most("energy: the same with motion of 22 px", 1e-3, moved, ""),
        at_most("leak outside supports, worst node", 0.02, max(s.score.leak for s in sparse), "of the mass", note),
        without_bar("relative L2 of the worst sparse node", max(s.score.error for s in sparse), "", note),
    ]


def spill(quick: bool) -> list[Row]:
    """A blurred half-plane before a sharp background, and a sharp disc before a bright blurred one."""
    width, r = 240, 24.0
    unit = Camera(focus=2.0, fstop=1.0, focal=0.05)
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


# ---------------------------------------------------------------------- physical


def physical(quick: bool, pictures: bool = False) -> list[Row]:
    """Averaged thin-lens and shutter renders, against the lens, either order of two passes, and Blender's Defocus."""
    rows = []
    size = (96, 60) if quick else (320, 200)
    times, spp = (4, 4) if quick else (64, 48)
    for make in (lens_scenes.fence, lens_scenes.cubes):
        case = make(*size)
        truth, noise = lens_scenes.reference(case, times, spp)
        rgb, depth, motion = lens_scenes.inputs(case, 16 if quick else 256)
        motion = motion if case.motions else None
        second = lens_scenes.peel(case, 4 if quick else 64)
        best = None
        for layers, behind in ((2, None), (4, None), (2, second), (4, second)):
            out, report = Lens(Settings(layers=layers)).apply(rgb, depth, motion, case.seen.camera, peel=behind)
            out = out[..., :3]
            known = ", second surfaces given" if behind is not None else ""
            note = f"noise of the reference {noise:.4f}; FLIP {flip(out, truth):.4f}; {report.line()}"
            what = f"physical: SSIM, {case.name}, {layers} layers{known}"
            rows.append(at_least(what, 0.97, ssim(out, truth), "", note))
            best = out if layers == 2 and behind is None else best
        sharp = ssim(rgb, truth)
        rows.append(without_bar(f"physical: SSIM of the sharp picture, {case.name}", sharp, ""))
        panels = [rgb, best, truth, 0.5 + 5 * (best - truth)]
        if not case.motions:
            theirs = _blender_picture(rgb, np.abs(case.seen.camera.confusion(depth, size[0])))
            what = f"physical: FLIP of ours over Blender's Defocus, {case.name}"
            if theirs is None:
                rows.append(Row(what, "< 1", None, "ratio", None, "", "bpy is not here"))
            else:
                ratio = flip(best, truth) / flip(theirs, truth)
                note = f"ours {flip(best, truth):.4f}, theirs {flip(theirs, truth):.4f}; SSIM {ssim(theirs, truth):.4f}"
                rows.append(at_most(what, 0.999, ratio, "ratio", note))
                panels.insert(2, theirs)
        else:
            rows += _orders(case, rgb, depth, motion, best, truth)
        if pictures:
            _save(np.concatenate(panels, 1), f"lens-{case.name}.png")
    return rows


def _orders(case, rgb, depth, motion, joint, truth) -> list[Row]:
    """Two passes in either order, with the same lens: blur first, or motion first."""
    camera = case.seen.camera
    still = replace(camera, fstop=np.inf)
    lens = Lens()
    first = lens.apply(lens.apply(rgb, depth, None, camera)[0], depth, motion, still)[0]
    second = lens.apply(lens.apply(rgb, depth, motion, still)[0], depth, None, camera)[0]
    values = {n: flip(v[..., :3], truth) for n, v in (("blur, then motion", first), ("motion, then blur", second))}
    ours = flip(joint, truth)
    note = f"joint {ours:.4f}, " + ", ".join(f"{k} {v:.4f}" for k, v in values.items())
    return [
        at_most(
            "order: FLIP of one joint pass over the better of two passes",
            0.999,
            ours / min(values.values()),
            "ratio",
            note,
        )
    ]


def _save(image: np.ndarray, name: str) -> None:
    from PIL import Image

    PICTURES.mkdir(exist_ok=True)
    shown = (np.clip(image, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
    Image.fromarray(shown).save(PICTURES / name, optimize=True)


# ---------------------------------------------------------------------- Blender

BLENDER = Path(__file__).parent / "lens_blender.py"


def _run_blender(rgb: np.ndarray, radius: np.ndarray, largest: float) -> tuple[np.ndarray, float, float] | None:
    """Defocus of a picture by a map of radii: (picture, seconds with it, seconds without), or None."""
    python = os.environ.get("LIGHTWELL_BPY")
    if not python or not Path(python).exists():
        return None
    from lightwell.lens import exr

    with tempfile.TemporaryDirectory() as folder:
        names = [str(Path(folder) / n) for n in ("rgb.exr", "radius.exr", "out.exr")]
        ones = np.ones((*radius.shape, 1))
        exr.write(names[0], np.concatenate([rgb[..., :3], ones], -1).astype(np.float32))
        exr.write(names[1], np.concatenate([np.repeat(radius[..., None], 3, -1), ones], -1).astype(np.float32))
        done = subprocess.run([python, str(BLENDER), *names, str(largest)], capture_output=True, text=True, timeout=900)
        line = next((text for text in done.stdout.splitlines() if text.startswith("SECONDS")), None)
        if line is None:
            raise RuntimeError(f"benchmark: Blender failed: {done.stderr[-500:]}")
        base, full = (float(v) for v in line.split()[1:])
        names = exr.read(names[2]).names
        return np.stack([names[c] for c in "RGB"], -1), full, base


def _blender_picture(rgb, radius) -> np.ndarray | None:
    made = _run_blender(rgb, radius, float(radius.max()) + 1)
    return None if made is None else made[0]


def blender(quick: bool) -> list[Row]:
    """Time against Blender's Defocus at 512², and both spill profiles."""
    rows = []
    rgba, _ = lens_scenes.ramp(512, 24, 0)
    for r in (24.0, 48.0):
        what = f"speed over Blender's Defocus, 512², {r:g} px"
        made = None if quick else _run_blender(rgba, np.full((512, 512), r), r)
        if made is None:
            rows.append(at_least(what, 10, None, "times", "needs LIGHTWELL_BPY"))
            continue
        camera = Camera(focus=2.0, fstop=1.0, focal=0.05)
        camera = replace(camera, fstop=float(camera.confusion(4.0, 512) / r))
        lens, depth = Lens(), np.full((512, 512), 4.0)
        ours = median_seconds(lambda c=camera, d=depth, n=lens: n.apply(rgba, d, None, c), 5)
        theirs = made[1] - made[2]
        note = f"{1e3 * ours:.0f} ms against {theirs:.1f} s (its render without the node, {made[2]:.2f} s, taken off)"
        rows.append(at_least(what, 10, theirs / ours, "times", note))
    if not quick and os.environ.get("LIGHTWELL_BPY"):
        rows.append(_blender_spill())
    return rows


def _blender_spill() -> Row:
    rgb = np.zeros((96, 240, 3))
    rgb[:, :120, 0], rgb[:, 120:, 1] = 1, 1
    made, _, _ = _run_blender(rgb, np.where(np.arange(240) < 120, 24.0, 0.0) * np.ones((96, 1)), 24.0)
    d = np.clip((np.arange(240) + 0.5 - 120) / 24, -1, 1)
    alpha = (np.arccos(d) - d * np.sqrt(1 - d * d)) / np.pi
    distance = float(np.abs(made[48, :, 0] - alpha).max())
    return without_bar(
        "foreground spill of Blender's Defocus: distance from the closed form, 24 px", distance, "of full"
    )


# ---------------------------------------------------------------------- recipes, samples, twins


def recipes(quick: bool, pictures: bool = False) -> list[Row]:
    """Kernel errors along the ladder of recipes, and both annealing schedules."""
    from lightwell.lens import anneal, points, voronoi
    from lightwell.lens.lsq import solve_values
    from lightwell.lens.recipes import rings
    from lightwell.lens.score import integrate, plane_of, score

    rows, curves = [], {}
    cases = {"disc 24 px": psf.capsule(24.0), "capsule 12 px, 48 px": psf.capsule(12.0, 48.0)}
    for name, kernel in cases.items() if not quick else [("disc 6 px", psf.capsule(6.0))]:
        f, rng = psf.charges(kernel), np.random.default_rng(4)
        density, budget = points.density(f), round(0.093 * np.count_nonzero(kernel))
        start = points.poisson_with_budget(density, budget, 0.5, rng)
        ladder = {}
        px, py = points.rounded(start)
        ladder["Poisson, Voronoi"] = px, py, voronoi.integrate_cells(f, np.stack([px, py], 1).astype(float))
        px, py = points.rounded(points.lloyd(density, start))
        values = voronoi.integrate_cells(f, np.stack([px, py], 1).astype(float))
        ladder["+ 50 Lloyd iterations"] = px, py, values
        bad = anneal.published(kernel, px, py, steps=20 if quick else anneal.STEPS)
        good = anneal.working(kernel, px, py, values, visits=2 if quick else anneal.VISITS)
        ladder["+ annealing as published"] = bad.x, bad.y, bad.values
        ladder["+ annealing, working schedule"] = good.x, good.y, good.values
        ladder["Lloyd, least squares"] = px, py, solve_values(kernel, px, py, mass=False, centroid=False)[0]
        ladder["Lloyd, least squares, mass and centroid"] = px, py, solve_values(kernel, px, py)[0]
        if kernel.shape[0] == kernel.shape[1]:
            qx, qy = points.rounded(rings(kernel.shape[0] / 2 - 1, budget))
            ladder["two rings, least squares, mass and centroid"] = qx, qy, solve_values(kernel, qx, qy)[0]
        for step, (x, y, v) in ladder.items():
            s = score(kernel, integrate(x, y, v, plane_of(kernel)))
            note = f"{len(x)} points, leak {s.leak:.3f}, mass {s.mass:+.1e}"
            rows.append(without_bar(f"kernel error (relative L2), {name}: {step}", s.error, "", note))
        gain = good.curve.min() / good.curve[0]
        rows.append(at_most(f"annealing: cost after the working schedule over before, {name}", 0.999, gain, "ratio"))
        curves[name] = bad.curve, good.curve
    if pictures:
        _curves(curves)
    return rows


def _curves(curves: dict) -> None:
    """Cost over the initial one against the share of the schedule done: red as published, green the working one."""
    from PIL import Image, ImageDraw

    width, height, margin = 420, 240, 34
    image = Image.new("RGB", (width * len(curves), height), "white")
    draw = ImageDraw.Draw(image)
    for i, (name, (bad, good)) in enumerate(curves.items()):
        x0, top = i * width + margin, max((bad / bad[0]).max(), 1.05)
        for level in np.arange(0, top, 0.25):
            y = height - margin - level / top * (height - 2 * margin)
            draw.line([(x0, y), (x0 + width - 2 * margin, y)], fill=(225, 225, 225))
            draw.text((x0 - 28, y - 6), f"{level:.2f}", fill=(90, 90, 90))
        for curve, colour in ((bad, (200, 60, 50)), (good, (40, 140, 70))):
            t = np.linspace(0, 1, len(curve))
            xs, ys = x0 + t * (width - 2 * margin), height - margin - curve / curve[0] / top * (height - 2 * margin)
            draw.line(list(zip(xs.tolist(), ys.tolist())), fill=colour, width=2)
        draw.text((x0, 8), f"{name}: cost over the initial one", fill=(20, 20, 20))
        draw.text((x0, height - 22), "schedule done, 0 to 1; red: as published, green: working", fill=(60, 60, 60))
    PICTURES.mkdir(exist_ok=True)
    image.save(PICTURES / "lens-annealing.png", optimize=True)


def samples(quick: bool, pictures: bool = False) -> list[Row]:
    """Few thin-lens samples per pixel: reconstruction over plain averaging, and over the spp that averaging needs."""
    from lightwell.lens.samples import reconstruct
    from lightwell.lens.thin_lens import trace

    case = lens_scenes.cubes(96, 60, False) if quick else lens_scenes.cubes(moving=False)
    truth, _ = lens_scenes.reference(case, 2 if quick else 16, 16 if quick else 64, moving=False)
    width, height, rows, panels = case.seen.width, case.seen.height, [], []
    for spp in (1, 4) if quick else (1, 4, 16):
        rays = trace(case.scene, spp, seed=2)
        plain = np.zeros((height * width, 3))
        where = np.minimum(rays.y.astype(int), height - 1) * width + np.minimum(rays.x.astype(int), width - 1)
        np.add.at(plain, where, rays.rgb / spp)
        plain = plain.reshape(height, width, 3)
        made = reconstruct(rays, height, width, case.seen.camera)[0][..., :3]
        errors = [float(np.sqrt(np.mean((p - truth) ** 2))) for p in (plain, made)]
        alike = f"SSIM {ssim(made, truth):.3f} against {ssim(plain, truth):.3f}"
        note = f"RMS {errors[1]:.4f} against {errors[0]:.4f}; {alike}"
        what = f"reconstruction: error of plain averaging over ours, {spp} sample{'s' if spp > 1 else ''} a pixel"
        rows.append(without_bar(what, errors[0] / errors[1], "times", note))
        panels += [plain, made] if spp == 4 else []
    if pictures:
        _save(np.concatenate([*panels, truth], 1), "lens-samples.png")
    return rows


C_TWIN = """
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <omp.h>
void scatter(float *out, long size, const float *rgba, const int32_t *base, long n, const int32_t *delta,
             const float *value, long count) {
  int threads = omp_get_max_threads();
  float *copies = calloc((size_t)size * threads, 4);
  #pragma omp parallel
  {
    float *mine = copies + (size_t)size * omp_get_thread_num();
    #pragma omp for schedule(static)
    for (long i = 0; i < n; i++) {
      const float r = rgba[4*i], g = rgba[4*i+1], b = rgba[4*i+2], a = rgba[4*i+3];
      float *at = mine + 4L * base[i];
      for (long k = 0; k < count; k++) {
        float *p = at + 4L * delta[k]; const float v = value[k];
        p[0] += v*r; p[1] += v*g; p[2] += v*b; p[3] += v*a;
      }
    }
    #pragma omp for schedule(static)
    for (long j = 0; j < size; j++) {
      float s = 0;
      for (int t = 0; t < threads; t++) s += copies[(size_t)size * t + j];
      out[j] = s;
    }
  }
  free(copies);
}
"""


def twin(quick: bool) -> list[Row]:
    """The Dr.Jit scatter over a C twin (gcc -O3 -march=native -fopenmp) of the same points."""
    what = "scatter: points per second of Dr.Jit over a C twin, radius 32 px"
    if shutil.which("gcc") is None:
        return [without_bar(what, None, "ratio", "no gcc here")]
    size = 128 if quick else 512
    with tempfile.TemporaryDirectory() as folder:
        source, binary = Path(folder) / "twin.c", Path(folder) / "twin.so"
        source.write_text(C_TWIN)
        subprocess.run(
            ["gcc", "-O3", "-march=native", "-fopenmp", "-shared", "-fPIC", source, "-o", binary], check=True
        )
        library = ctypes.CDLL(str(binary))
        family = families.depth(32.0)
        points = Points.of([dict(bake_node(family, family.size - 1, Recipe()))[0]])
        rgba = np.random.default_rng(0).random((size, size, 4)).astype(np.float32)
        sources, frame = _all_pixels(rgba, np.zeros((size, size))), Frame(size, size, guard_for(points, False))
        height, width = frame.padded
        base = ((sources.y + frame.guard) * width + sources.x + frame.guard).astype(np.int32)
        delta, out = (points.y * width + points.x).astype(np.int32), np.zeros((height, width, 4), np.float32)
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (out, sources.rgba, base, delta, points.value)]

        def run():
            library.scatter(
                pointers[0], ctypes.c_long(out.size), pointers[1], pointers[2], ctypes.c_long(len(base)), pointers[3],
                pointers[4], ctypes.c_long(len(delta)),
            )  # fmt: skip

        rounds = 1 if quick else 9
        theirs, ours = median_seconds(run, rounds), median_seconds(lambda: splat(frame, points, sources), rounds)
        same = np.abs(out - splat(frame, points, sources).charges).max() / np.abs(out).max()
        rate = len(base) * len(delta) / ours / 1e6
        note = (
            f"{rate:.0f} M RGBA points/s against {len(base) * len(delta) / theirs / 1e6:.0f}; they differ by {same:.0e}"
        )
    return [without_bar(what, theirs / ours, "ratio", note)]


def gpu(quick: bool) -> list[Row]:
    """1024², two layers, on CUDA."""
    from lightwell.backend import ACTIVE

    what = "GPU: 1024x1024, two layers, radius up to 32 px"
    if not ACTIVE.variant.startswith("cuda"):
        return [at_most(what, 5, None, "ms", "no CUDA device here; the paper: 190 ms on a GTX 980 Ti")]
    rgba, s = lens_scenes.ramp(1024, 32.0, 0)
    engine = Engine(families.depth(64), Recipe(), Shelf())
    plan = engine.plan(Layer(rgba, s, None), Report())
    frame = Frame(1024, 1024, guard_for(plan.points, False))
    seconds = median_seconds(lambda: engine.integrate(frame, splat(frame, plan.points, plan.sources)), 9)
    return [
        at_most(what, 5, 2e3 * seconds, "ms", "scatter on the GPU, solve on the CPU with both copies; twice one layer")
    ]


def bokeh(quick: bool, pictures: bool = False) -> list[Row]:
    """Point lights behind focus through a disc, a hexagon, a heart, the cat's eye, and a hexagon in motion."""
    from lightwell.lens.aperture import from_picture, polygon

    y, x = np.mgrid[-1:1:200j, -1.1:1.1:200j]
    heart = ((x * x + y * y - 0.5) ** 3 + x * x * y**3 < 0).astype(float)
    size = 80 if quick else 220
    rng = np.random.default_rng(6)
    rgba = np.full((size, size, 4), 0.02, np.float32)
    rgba[..., 3] = 1
    at = rng.integers(14, size - 14, (9 if quick else 22, 2))
    rgba[at[:, 0], at[:, 1], :3] = rng.uniform(40, 400, (len(at), 1)) * (0.4 + 0.6 * rng.random((len(at), 3)))
    depth, motion = np.full((size, size), 6.0), np.zeros((size, size, 2), np.float32)
    motion[:] = 22, -12
    camera = Camera(focus=2.0, fstop=1.0, focal=0.05, shutter=1.0)
    camera = replace(camera, fstop=float(camera.confusion(6.0, size) / 11))
    views = (
        Settings(), Settings(aperture=polygon(6, 15)), Settings(aperture=from_picture(heart)), Settings(cats_eye=1.2),
    )  # fmt: skip
    made = [Lens(view).apply(rgba, depth, None, camera)[0][..., :3] for view in views]
    made.append(Lens(views[1]).apply(rgba, depth, motion, camera)[0][..., :3])
    if pictures:
        _save(np.concatenate(made, 1), "lens-bokeh.png")
    lowest = float(min(m.min() for m in made))
    return [without_bar("bokeh: darkest pixel around highlights over a background of 0.02", lowest, "of white")]


PARTS = {
    "bokeh": bokeh,
    "psnr": psnr,
    "speed": speed,
    "hd": hd,
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
    parser.add_argument("--only", default=",".join(PARTS), help=f"parts, of {', '.join(PARTS)}")
    parser.add_argument("--pictures", action="store_true", help="write the pictures of docs/lens.md")
    arguments = parser.parse_args()
    for part in arguments.only.split(","):
        extra = (arguments.pictures,) if part in WITH_PICTURES else ()
        publish("lens", PARTS[part](arguments.quick, *extra), arguments.quick)


if __name__ == "__main__":
    main()
