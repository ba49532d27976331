"""The lens in the browser: FLIP against the physical reference beside three.js and pmndrs, and what a frame costs.

    python benchmarks/lens_web.py [--only flip,time,size] [--quick] [--pictures]

Everybody gets the same pinhole colour and depth of the scenes of lens_scenes.py (fence, and cubes at rest: none of
the others blurs motion in the same pass), in headless Chromium (tools/lens-peers.mjs). Ours has no free setting:
camera and depth say it all. The others' controls are not those of a camera, so that theirs are searched on a grid
around the values that match the circle of confusion, and the one with the lowest FLIP against the reference is taken:
the best that their user could find, no blur included. Rows go to results/lens.json. Needs Node and the web tests'
packages (`npm ci` in web/) and a Chromium with WebGPU.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from itertools import product
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import lens_scenes
from lens_measure import save
from rows import Row, at_least, at_most, chosen, publish, without_bar

from lightwell.report.picture_metrics import flip, ssim

ROOT = Path(__file__).resolve().parents[1]
STANDARD = ROOT / "lightwell/lens/standard"
NEAR, FAR = 0.1, 100.0
TIMEOUT = 1800
"""Seconds for a process."""
LIMIT = 120
"""Seconds for one draw."""
NAMES = {
    "bokeh": "three.js' BokehPass",
    "bokeh2": "three.js' BokehShader2",
    "dof": "three.js' dof node (WebGPU)",
    "pmndrs": "pmndrs' DepthOfFieldEffect",
}


def missing() -> str:
    """Empty where the page can be drawn, else why not."""
    if not shutil.which("node"):
        return "Node is not installed"
    if not (ROOT / "web/node_modules/postprocessing").exists():
        return "the web's packages are missing; run 'npm ci' in web/"
    return ""


def in_browser(rgb, depth, camera, fov_x: float, draws: list[dict], folder: Path) -> dict:
    """Draw one frame with many settings; every draw gets ``picture`` [h, w, 3] or ``error``."""
    height, width = depth.shape
    rgba = np.concatenate([rgb, np.ones((height, width, 1))], -1).astype("<f4")
    with np.errstate(divide="ignore"):
        buffered = np.clip(FAR / (FAR - NEAR) * (1 - NEAR / depth), 0, 1).astype("<f4")
    rgba.tofile(folder / "color.f32")
    buffered.tofile(folder / "depth.f32")
    frame = {
        "width": width, "height": height, "color": str(folder / "color.f32"), "depth": str(folder / "depth.f32"),
        "near": NEAR, "far": FAR, "focus": camera.focus / camera.scene_unit,
        "fovY": float(np.rad2deg(2 * np.arctan(np.tan(np.deg2rad(fov_x) / 2) * height / width))),
        "camera": {n: float(getattr(camera, n)) for n in ("focus", "focal", "fstop", "sensor")},
        "libraries": [str(STANDARD / "disc-32.lwsp")],
    }  # fmt: skip
    for i, draw in enumerate(draws):
        draw.setdefault("rounds", 1)
        draw["out"] = str(folder / f"{i}.f32")
    (folder / "job.json").write_text(json.dumps({"frame": frame, "draws": draws, "limit": LIMIT}))
    command = ["node", str(ROOT / "tools/lens-peers.mjs"), str(folder / "job.json")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT)
    if done.returncode:
        raise RuntimeError(f"lens-peers: {done.stderr.strip().splitlines()[-1] if done.stderr.strip() else 'failed'}")
    answer = json.loads(done.stdout)
    for draw, found in zip(draws, answer["draws"]):
        draw.update(found)
        if "error" not in found:
            picture = np.fromfile(draw["out"], "<f4").reshape(height, width, 4)[..., :3].astype(np.float64)
            draw["picture"] = np.nan_to_num(picture, nan=0.0, posinf=0.0, neginf=0.0)
    return answer


def settings(case, depth, quick: bool) -> list[dict]:
    """Ours, everybody with their blur at nothing, and the others' grids around what matches the circle of confusion."""
    camera, width = case.seen.camera, case.seen.width
    s = np.abs(camera.confusion(depth, width))
    largest, focus = float(s.max()), camera.focus
    # Where a linear law in depth meets the lens: pixels per metre from focus, by least squares.
    away = np.abs(np.minimum(depth, 20) - focus)
    slope = float((s * away).sum() / max((away**2).sum(), 1e-9))
    factors = (1.0,) if quick else (0.5, 0.7, 1.0, 1.4, 2.0)
    ranges = (1.8,) if quick else (0.5, 1.0, 1.8, 3.0, 6.0, 12.0)
    draws = [{"name": "ours", "setting": {}}]
    draws += [
        {"name": "bokeh", "setting": {"aperture": 0.0, "maxblur": 0.0}},
        {"name": "bokeh2", "setting": {"maxblur": 0.0, "fstop": 1e6, "focalLength": 50.0}},
        {"name": "dof", "setting": {"scale": 0.0, "range": 1e6}},
        {"name": "pmndrs", "setting": {"scale": 0.0, "range": 1e6}},
    ]
    # Its taps reach 0.4 of the blur, which is in widths of the picture.
    for a, b in product(factors, (0.35, 0.5, 0.7, 1.0, 1.4, 100.0) if not quick else (1.0,)):
        unit = 0.4 * width
        draws.append({"name": "bokeh", "setting": {"aperture": a * slope / unit, "maxblur": b * largest / unit}})
    # A real lens up to a largest blur: five rings of maxblur pixels each.
    for a in (1.0,) if quick else (0.7, 0.85, 1.0, 1.2, 1.4):
        focal = 50.0
        unit = (focal * 1e-3) ** 2 * 1e3 / 0.03 / (focus - focal * 1e-3)
        full = largest * focus / camera.strength(width)
        draws.append(
            {"name": "bokeh2", "setting": {"focalLength": focal, "fstop": unit / full, "maxblur": a * largest / 5}}
        )
    # These two know no lens: their blur grows from 0 to its largest within a range of depths about focus.
    for r, a in product(ranges, factors if quick else (0.15, 0.3, *factors, 4.0, 8.0)):
        draws.append({"name": "dof", "setting": {"range": r, "scale": a * largest}})
        draws.append({"name": "pmndrs", "setting": {"range": r, "scale": 0.5 * a * largest}})
    return draws


def check_nothing(draws: list[dict], rgb: np.ndarray) -> None:
    """With their blur at nothing the others must show the frame itself: it was handed over rightly."""
    for draw in draws[1:5]:
        if "picture" in draw:
            error = float(np.abs(draw["picture"] - rgb).max())
            if error > 0.02:
                raise RuntimeError(f"lens_web: {draw['name']} without blur differs from the frame by {error:.3f}")


def flip_rows(quick: bool, pictures: bool = False) -> list[Row]:
    """FLIP of ours over each of the others', against averaged thin-lens renders."""
    rows, why = [], missing()
    size = (96, 60) if quick else (320, 200)
    times, spp = (2, 8) if quick else (64, 48)
    for name in ("fence",) if quick else ("fence", "cubes at rest"):
        whats = {peer: f"web: FLIP of ours over {title}, {name}" for peer, title in NAMES.items()}
        if why:
            rows += [Row(what, "<= 0.999", None, "ratio", None, "", why) for what in whats.values()]
            continue
        case = lens_scenes.fence(*size) if name == "fence" else lens_scenes.cubes(*size, moving=False)
        truth, noise = lens_scenes.reference(case, times, spp)
        rgb, depth, _ = lens_scenes.inputs(case, 16 if quick else 256)
        draws = settings(case, depth, quick)
        with tempfile.TemporaryDirectory() as folder:
            answer = in_browser(rgb, depth, case.seen.camera, case.fov, draws, Path(folder))
        check_nothing(draws, rgb)
        ours = draws[0]
        if "error" in ours:
            rows += [Row(what, "<= 0.999", None, "ratio", None, "", ours["error"][:120]) for what in whats.values()]
            continue
        mine = flip(ours["picture"], truth)
        note = (
            f"FLIP {mine:.4f} on {answer['adapter']}; noise of the reference {noise:.4f}; sharp {flip(rgb, truth):.4f}"
        )
        rows.append(at_least(f"web: SSIM of ours, {name}, 2 layers", 0.97, ssim(ours["picture"], truth), "", note))
        panels = [rgb, ours["picture"]]
        for peer, what in whats.items():
            tried = [d for d in draws if d["name"] == peer and "picture" in d]
            if not tried:
                why_not = next(d["error"] for d in draws if d["name"] == peer)
                rows.append(Row(what, "<= 0.999", None, "ratio", None, "", why_not[:120]))
                continue
            scores = [flip(d["picture"], truth) for d in tried]
            best = int(np.argmin(scores))
            chosen = ", ".join(f"{k} {v:.3g}" for k, v in tried[best]["setting"].items())
            note = f"ours {mine:.4f}, theirs {scores[best]:.4f}: the best of {len(tried)} settings ({chosen})"
            rows.append(at_most(what, 0.999, mine / scores[best], "ratio", note))
            panels.append(tried[best]["picture"])
        if pictures:
            middle = slice(size[0] // 4, 3 * size[0] // 4)
            save(np.concatenate([p[:, middle] for p in (*panels, truth)], 1), f"lens-web-{name.split()[0]}.png")
    return rows


def time_rows(quick: bool) -> list[Row]:
    """Milliseconds of a frame on the adapter at hand, side by side: the pass alone, ours, the others. Information."""
    what = "web: frame of the lens, {}x{}, two layers"
    width, height, rounds = (96, 60, 1) if quick else (640, 400, 7)
    if why := missing():
        return [Row(what.format(width, height), "–", None, "ms", None, "", why)]
    case = lens_scenes.fence(width, height)
    rgb, depth, _ = lens_scenes.inputs(case, 16)
    largest = float(np.abs(case.seen.camera.confusion(depth, width)).max())
    draws = [{"name": "plain", "setting": {}}, {"name": "ours", "setting": {}}]
    draws += [{"name": "ours", "setting": {"layers": 1}}]
    draws += [{"name": "dof", "setting": {"range": 1.8, "scale": largest}}]
    draws += [{"name": "pmndrs", "setting": {"range": 1.8, "scale": 0.5 * largest}}]
    for draw in draws:
        draw["rounds"] = rounds + 1
    with tempfile.TemporaryDirectory() as folder:
        answer = in_browser(rgb, depth, case.seen.camera, case.fov, draws, Path(folder))
    medians = [float(np.median(d["milliseconds"][1:])) if "milliseconds" in d else None for d in draws]
    plain, ours, one, dof, pmndrs = medians
    alone = f"one layer {one or 0:.0f} ms; the pass alone {plain or 0:.0f} ms"
    note = f"{answer['adapter']}; blur up to {largest:.0f} px; {alone}"
    rows = [without_bar(what.format(width, height), ours, "ms", note)]
    for other, title in ((dof, NAMES["dof"]), (pmndrs, NAMES["pmndrs"])):
        ratio = ours / other if ours and other else None
        note = f"ours {ours or 0:.0f} ms, theirs {other or 0:.0f} ms on {answer['adapter']}, with 80 taps at most"
        rows.append(without_bar(f"web: frame of the lens over {title}, {width}x{height}", ratio, "times", note))
    return rows


def size_rows(quick: bool) -> list[Row]:
    """What the effect adds to a page, gzipped; by web/test/bundle-size.test.ts."""
    what = "npm package: lightwell/lens, gzipped, without libraries of spreadlets"
    if why := missing():
        return [Row(what, "–", None, "kB", None, "", why)]
    run = ["npx", "vitest", "run", "test/bundle-size"]
    subprocess.run(run, cwd=ROOT / "web", check=False, capture_output=True, timeout=TIMEOUT)
    sizes = json.loads((ROOT / "web/test-results/bundle.json").read_text())["sizes"]
    files = ", ".join(f"{p.name} {p.stat().st_size / 1000:.0f} kB" for p in sorted(STANDARD.glob("disc-*.lwsp")))
    note = f"with the node for three.js {sizes['lens-three']['gzipped'] / 1000:.1f} kB; libraries: {files}"
    return [without_bar(what, sizes["lens"]["gzipped"] / 1000, "kB", note)]


PARTS = {"flip": flip_rows, "time": time_rows, "size": size_rows}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="smoke run, writes nothing")
    parser.add_argument("--only", help=f"parts, of {', '.join(PARTS)}")
    parser.add_argument("--pictures", action="store_true", help="write the pictures of docs/lens.md")
    arguments = parser.parse_args()
    for part in chosen("--only", arguments.only, PARTS):
        extra = (arguments.pictures,) if part == "flip" else ()
        publish("lens", PARTS[part](arguments.quick, *extra), arguments.quick)


if __name__ == "__main__":
    main()
