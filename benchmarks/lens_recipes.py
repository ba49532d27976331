"""What each step of the recipes buys, and the shapes of highlights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from lens_measure import PICTURES, save
from rows import Row, at_most, without_bar

from lightwell.lens import psf
from lightwell.lens.camera import LensCamera
from lightwell.lens.pipeline import Lens
from lightwell.lens.settings import LensSettings


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
    camera = LensCamera(focus=2.0, fstop=1.0, focal=0.05, shutter=1.0)
    camera = replace(camera, fstop=float(camera.confusion(6.0, size) / 11))
    views = (
        LensSettings(), LensSettings(aperture=polygon(6, 15)),
        LensSettings(aperture=from_picture(heart)), LensSettings(cats_eye=1.2),
    )  # fmt: skip
    made = [Lens(view).apply(rgba, depth, None, camera)[0][..., :3] for view in views]
    made.append(Lens(views[1]).apply(rgba, depth, motion, camera)[0][..., :3])
    if pictures:
        save(np.concatenate(made, 1), "lens-bokeh.png")
    lowest = float(min(m.min() for m in made))
    return [without_bar("bokeh: darkest pixel around highlights over a background of 0.02", lowest, "of white")]
