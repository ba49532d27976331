"""The lens against averaged thin-lens and shutter renders, and beside Blender's Defocus."""

from __future__ import annotations

import os
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import lens_scenes
import numpy as np
from lens_measure import median_seconds, save
from rows import Row, at_least, at_most, without_bar

from lightwell.core.denoise import denoise
from lightwell.lens.camera import LensCamera
from lightwell.lens.pipeline import Lens
from lightwell.lens.samples import reconstruct
from lightwell.lens.settings import LensSettings
from lightwell.report.picture_metrics import flip, ssim


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
            out, report = Lens(LensSettings(layers=layers)).apply(rgb, depth, motion, case.seen.camera, peel=behind)
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
            save(np.concatenate(panels, 1), f"lens-{case.name}.png")
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
        camera = LensCamera(focus=2.0, fstop=1.0, focal=0.05)
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


def samples(quick: bool, pictures: bool = False) -> list[Row]:
    """Few samples of lens and time per pixel: reconstruction against plain averaging, and against that denoised."""
    rows, panels = [], []
    for moving in (False, True):
        case = lens_scenes.cubes(*((96, 60) if quick else (320, 200)), moving)
        times, spp = (2, 16) if quick else (64, 16) if moving else (16, 64)
        truth, _ = lens_scenes.reference(case, times, spp, moving=moving)
        for spp in (1, 4) if quick else (1, 4, 16):
            plain, made, clean = _few(case, spp, moving)
            errors = [float(np.sqrt(np.mean((p - truth) ** 2))) for p in (plain, made)]
            name = f"{spp} sample{'s' if spp > 1 else ''} a pixel" + (", in motion" if moving else "")
            alike = f"SSIM {ssim(made, truth):.3f} against {ssim(plain, truth):.3f}"
            note = f"RMS {errors[1]:.4f} against {errors[0]:.4f}; {alike}"
            rows.append(
                without_bar(
                    f"reconstruction: error of plain averaging over ours, {name}", errors[0] / errors[1], "times", note
                )
            )
            what = f"reconstruction: FLIP of averaging denoised by OIDN over ours, {name}"
            theirs, ours = flip(clean, truth), flip(made, truth)
            rms = float(np.sqrt(np.mean((clean - truth) ** 2)))
            note = f"FLIP {theirs:.4f} against {ours:.4f}, RMS {rms:.4f} against {errors[1]:.4f}"
            rows.append(without_bar(what, theirs / ours, "ratio", note))
            panels += [plain, made] if spp == 4 and not moving else []
        if not moving:
            panels.append(truth)
    if pictures:
        save(np.concatenate(panels, 1), "lens-samples.png")
    return rows


def _few(case, spp: int, moving: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Averaging, reconstruction, and averaging denoised, of the same samples."""
    rays = lens_scenes.samples(case, spp, seed=2, moving=moving)
    height, width = case.seen.height, case.seen.width
    plain = np.zeros((height * width, 3))
    where = np.minimum(rays.y.astype(int), height - 1) * width + np.minimum(rays.x.astype(int), width - 1)
    np.add.at(plain, where, rays.rgb / spp)
    plain = plain.reshape(height, width, 3)
    made = reconstruct(rays, height, width, case.seen.camera)[0][..., :3]
    return plain, made, denoise(plain)
