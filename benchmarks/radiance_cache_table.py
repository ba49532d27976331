"""The equal-time table of the radiance cache over given scenes and those of the zoo; a part of radiance_cache.py.

    python benchmarks/radiance_cache.py --only table --resume                   hours; goes on after the last scene
    python benchmarks/radiance_cache.py --only table --resume --scenes zdm2     one scene

Three sides render in turns: Mitsuba's ``path`` with ``--spp`` samples, and in the wall time that this took, training
included, ours by default ("cache") and ours with ``estimator=guided``. Pictures are divided by the mean of the
reference, so that scenes of any brightness are comparable. Five errors, medians over the repeats:

    relMSE      mean of (I - A)(I - B) / (R^2 + 0.01): without the noise of the reference
    trimmed     the same without the worst 0.5 % of the pixels
    sMAPE       mean of |I - R| / (|I| + |R| + 0.01)
    FLIP        LDR-FLIP of the displayed pictures
    energy      mean of I over that of R, minus 1

Gains of the first two are error times time of ``path`` over ours; of sMAPE and FLIP, which fall with the root of the
time, error over error. Scenes whose lamps are partly transparent are left out: Mitsuba's ``path`` weights their
emission by their alpha, and loaded emitters have it already. Constants are chosen with the figures of CHOICE in sight;
those of HELD_OUT only check them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from radiance_cache_runs import cold, timed
from radiance_cache_truth import EPSILON, Truth, path_tracer, truth_of
from rows import Row, at_least, at_most, without_bar
from scipy.stats import norm
from scipy.stats import t as student

from lightwell.backend import mi
from lightwell.core.color import display
from lightwell.probes.solve import smape
from lightwell.report.picture_metrics import exposure_unit, flip

CHOICE = (
    "cornell-box", "veach-ajar", "living-room-2", "staircase2", "veach-bidir",
    "godot-living-room", "needle-lightmap-house", "hello-webxr-hall",
)  # fmt: skip
HELD_OUT = (
    "bevy-cornell", "zdm2", "pyraxia-hallway", "needle-scanned-room",
    "kenney-fps-level", "modern-house", "drake-living-room", "recast-dungeon",
)  # fmt: skip
HALVES = {name: half for half, names in (("choice", CHOICE), ("held out", HELD_OUT)) for name in names}
SIDES: dict[str, dict[str, Any]] = {"cache": {}, "guided": {"estimator": "guided"}}
# Stills that take little time are repeated as often as fits into so many seconds of each side: the error of scenes with
# rare bright paths differs by a fifth from still to still.
SIDE_SECONDS, MOST_REPEATS = 40.0, 15
# Share of the pixels that the trimmed error leaves out.
WORST = 0.005
# Errors that fall with the time, and those that fall with its root.
SQUARED, ABSOLUTE = ("relMSE", "trimmed"), ("sMAPE", "FLIP")
# 99 % of a normal distribution.
Z = 2.576
Figures = dict[str, Any]


def errors(truth: Truth, picture: np.ndarray) -> dict[str, float]:
    """The five errors of a picture [H, W, 3]."""
    unit = float(truth.mean.mean())
    p, a, b = (x.astype(np.float64) / unit for x in (picture, truth.a, truth.b))
    r = 0.5 * (a + b)
    relative = np.sort(((p - a) * (p - b) / (r**2 + EPSILON)).mean(axis=-1).ravel())
    exposure = exposure_unit(r) or 1.0
    return {
        "relMSE": float(relative.mean()), "trimmed": float(relative[: int(len(relative) * (1 - WORST))].mean()),
        "sMAPE": float(smape(r, p, EPSILON).mean()), "energy": float(p.mean() / r.mean() - 1),
        "FLIP": flip(np.maximum(p, 0) / exposure, r / exposure) if display(r).any() else 0.0,
    }  # fmt: skip


def table(name: str, scene: Any, plan: Figures) -> Figures:
    """Errors and wall times of ``path`` and of both of ours."""
    sensor, pt, spp = scene.sensors()[0], path_tracer(), plan["spp"]
    truth = truth_of(name, scene, sensor, plan["size"], plan["reference"])

    def theirs(seed: int) -> tuple[np.ndarray, float]:
        return timed(lambda: mi.render(scene, sensor=sensor, integrator=pt, spp=spp, seed=seed))

    def ours(side: str, seconds: float, seed: int) -> tuple[np.ndarray, float, Any]:
        nrc = cold({"mode": "still", **SIDES[side], "seconds": seconds}, scene)
        picture, wall = timed(lambda: mi.render(scene, sensor=sensor, integrator=nrc, spp=1, seed=seed))
        return picture, wall, nrc.last

    _, seconds = theirs(1)
    for side in SIDES:  # Twice: recordings are made in the first, kernels of all sizes by the second.
        for _ in range(2):
            ours(side, max(seconds, 0.2), 1)
    runs: dict[str, list[Figures]] = {side: [] for side in ("path", *SIDES)}
    repeats = plan["repeats"]
    if not plan["quick"]:
        repeats = max(repeats, min(MOST_REPEATS, int(SIDE_SECONDS / seconds)))
    for seed in range(repeats):
        picture, wall_pt = theirs(200 + seed)
        runs["path"].append(errors(truth, picture) | {"wall": wall_pt, "train": 0.0, "samples": spp, "guided": 0})
        for side in SIDES:
            picture, wall, last = ours(side, wall_pt, 100 + seed)
            facts = {"wall": wall, "train": last.seconds["train"], "samples": last.rendered.samples}
            runs[side].append(errors(truth, picture) | facts | {"guided": int(last.guiding)})
    return {"half": HALVES[name], "repeats": repeats, "reference": truth.spp, **summary(runs)}


def summary(runs: dict[str, list[Figures]]) -> Figures:
    """Medians of every side, gains over ``path``, and z of the mean of the unbiased side."""
    sides = {side: {k: float(np.median([run[k] for run in each])) for k in each[0]} for side, each in runs.items()}
    pt, gains = sides["path"], {}
    for side in SIDES:
        f = sides[side]
        time = pt["wall"] / f["wall"]
        gains[side] = {e: pt[e] / max(f[e], 1e-9) * time for e in SQUARED}
        gains[side] |= {e: pt[e] / max(f[e], 1e-9) for e in ABSOLUTE}
    a, b = (np.array([run["energy"] for run in runs[side]]) for side in ("guided", "path"))
    error = np.sqrt((a.var(ddof=1) + b.var(ddof=1)) / len(a)) if len(a) > 1 else np.inf
    return {"sides": sides, "gains": gains, "z": abs(float((a.mean() - b.mean()) / error))}


def table_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    """A row for every scene and side; the figures of merit where all scenes are there."""
    rows = [without_bar(f"table: relMSE of path over {side}, {name} ({f['half']})", f["gains"][side]["relMSE"], "ratio",
                        _note(f, side, plan)) for name, f in found.items() for side in SIDES]  # fmt: skip
    rows.append(at_least("table: scenes", 16, len(found), "scenes"))
    for error, bar in (("relMSE", 6), ("trimmed", 5)):
        gains = [f["gains"]["cache"][error] for f in found.values()] if set(found) == set(HALVES) else None
        what = f"table: {error} of path over the cache, geometric mean of the scenes"
        rows.append(at_least(what, bar, geometric(gains) if gains else None, "ratio"))
        rows.append(at_least(f"table: {error} of path over the cache, least of the scenes", 0.95,
                             min(gains) if gains else None, "ratio"))  # fmt: skip
    for half in ("choice", "held out"):
        for error in (*SQUARED, *ABSOLUTE):
            what = f"table: {error} of path over the cache, geometric mean of the scenes {half}"
            rows.append(without_bar(what, _over(found, half, "cache", error, geometric), "ratio"))
        for words, bar, fold in (("least", 0.95, min), ("median", 1.5, np.median)):
            what = f"table: relMSE of path over guided, {words} of the scenes {half}"
            rows.append(at_least(what, bar, _over(found, half, "guided", "relMSE", fold), "ratio"))
    z = max(normal(f["z"], f["repeats"]) for f in found.values()) if set(found) == set(HALVES) else None
    note = "Student's t of each scene, as the deviation of a normal distribution that is as rare"
    return [*rows, at_most("table: largest z of the mean of guided against path", Z, z, "sigma", note)]


def normal(t: float, repeats: int) -> float:
    """The deviation of a normal distribution that is as rare as t of Student's with two sides of so many stills."""
    return float(norm.isf(student.sf(t, 2 * repeats - 2))) if repeats > 1 else 0.0


def geometric(values: list[float]) -> float:
    """Geometric mean."""
    return float(np.exp(np.mean(np.log(np.maximum(values, 1e-9)))))


def _over(found: dict[str, Figures], half: str, side: str, error: str, fold: Any) -> float | None:
    """A gain over the scenes of one half; None where one is missing."""
    names = [name for name in HALVES if HALVES[name] == half]
    if not set(names) <= set(found):
        return None
    return float(fold([found[name]["gains"][side][error] for name in names]))


def _note(f: Figures, side: str, plan: Figures) -> str:
    """All errors of a scene, those of ``path`` in brackets."""
    ours, pt = f["sides"][side], f["sides"]["path"]
    listed = ", ".join(f"{e} {ours[e]:.3g} ({pt[e]:.3g})" for e in (*SQUARED, *ABSOLUTE, "energy"))
    kind = f"; guided {ours['guided']:.0f}, t {f['z']:.2f}" if side == "guided" else ""
    return (
        f"{listed}; {ours['wall']:.2f} s ({ours['train']:.2f} s training, {ours['samples']:.0f} spp) against "
        f"{pt['samples']:.0f} spp in {pt['wall']:.2f} s at {plan['size']}^2, {f['repeats']} repeats{kind}"
    )
