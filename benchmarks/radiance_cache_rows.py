"""Rows of the radiance cache from its figures, and the table of its page. See ``radiance_cache.py``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from radiance_cache_live import at, plot
from radiance_cache_table import HALVES
from radiance_cache_truth import NAMES, ROOT
from rows import Row, at_least, at_most, markdown, of_gpu, without_bar

LIVE_SIZE, LIVE_SCENES = 512, ("cornell-box", "veach-ajar", "living-room-2", "needle-scanned-room")
PAGE = ROOT / "docs" / "radiance-cache.md"
BEGIN, END = "<!-- rows: written by benchmarks/radiance_cache.py -->", "<!-- end of the rows -->"
Figures = dict[str, Any]


def stats(f: Figures, plan: Figures) -> str:
    return (
        f"{f['error']:.3g} in {f['wall']:.2f} s ({f['train']:.2f} s training, {f['samples']:.0f} spp) against "
        f"{f['error_pt']:.3g} in {f['wall_pt']:.2f} s at {plan['size']}^2, {f['repeats']} repeats"
    )


def geometric(found: dict[str, Figures], names: Iterable[str] = NAMES) -> float | None:
    """Of the gains, where all scenes are there."""
    if set(found) != set(names):
        return None
    return float(np.exp(np.mean([np.log(max(f["gain"], 1e-9)) for f in found.values()])))


def equal_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    rows = []
    for name, f in found.items():
        bar = 15 if name == "veach-ajar" else 0.9
        rows.append(at_least(f"equal time: relMSE of path over ours, {name}", bar, f["gain"], "ratio", stats(f, plan)))
    return [*rows, at_least("equal time: geometric mean of the five scenes", 5, geometric(found), "ratio")]


def denoise_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    return denoised_rows("denoised: {} of denoised path over ours at equal time, {}", found, plan)


def blend_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    return denoised_rows("denoised, with the cache: {} of denoised path over ours at equal time, {}", found, plan)


def denoised_rows(what: str, found: dict[str, Figures], plan: Figures) -> list[Row]:
    """Rows of relMSE and FLIP of every scene, and the geometric mean of the former."""
    rows = []
    for name, f in found.items():
        note = f"{stats(f, plan)}; FLIP {f['flip']:.3f} against {f['flip_pt']:.3f}"
        rows.append(at_least(what.format("relMSE", name), 0.95, f["gain"], "ratio", note))
        rows.append(at_least(what.format("FLIP", name), 0.95, f["flip_pt"] / max(f["flip"], 1e-9), "ratio"))
    mean = geometric(found, HALVES)
    return [*rows, at_least(f"{what.split(':')[0]}: geometric mean of the scenes", 2.5, mean, "ratio")]


def parts_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    what = "parts: relMSE of path over ours at equal time, "
    return [without_bar(f"{what}{change}, {name}", f["gain"], "ratio", stats(f, plan))
            for name, changes in found.items() for change, f in changes.items()]  # fmt: skip


def frame_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    rows = []
    for name, f in found.items():
        note = f"{f['wall']:.0f} ms ({f['train']:.0f} training) against {f['wall_pt']:.0f}; {f['triangles']} triangles"
        what, ratio = f"frame: time of a 1-sample frame over path's, {name}", f["wall"] / f["wall_pt"]
        large = f["triangles"] >= 100_000
        rows.append(at_most(what, 1, ratio, "ratio", note) if large else without_bar(what, ratio, "ratio", note))
    return rows


def unbiased_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    rows = []
    for name, f in found.items():
        kind = "guided" if f["guided"] else "calm: path traced with our sampling, no guide"
        note = (
            f"estimator=guided ({kind}); {f['repeats']} stills of {f['wall']:.2f} s ({f['train']:.2f} s training from "
            f"cold, {f['samples']:.0f} spp) against {f['spp']} spp in {f['wall_pt']:.2f} s; 99 %"
        )
        rows.append(at_most(f"unbiased: |z| of the mean against path, {name}", 2.576, f["z"], "sigma", note))
        what = f"unbiased: equal-time variance of path over ours, {name}"
        rows.append(without_bar(what, f["gain"], "ratio", note))
    if found:
        second = sorted((f["gain"] for f in found.values()), reverse=True)[min(1, len(found) - 1)]
        what = "unbiased: equal-time variance of path over ours, second best scene"
        rows.append(at_least(what, 1.5, second if len(found) > 1 else None, "ratio"))
    return rows


def lag_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    rows = []
    for name, f in found.items():
        for what, words in (("picture", "a picture of 1 sample"), ("view", "the cache view")):
            note = f"steady error {f[f'{what}_steady']:.3g}, after 8 frames {f[f'{what}_after8']:.3g}"
            row = f"cold start: frames to 1.1 x the steady error of {words}, {name}"
            rows.append(at_most(row, 8, f[what], "frames", note))
        note = f"lamp to a tenth, mean of the cache view; half after {f['t50']}; changes noticed: {f['changes']}"
        rows.append(at_most(f"light switch: frames to regain 90 % of the gap, {name}", 8, f["t90"], "frames", note))
    return rows


def drift_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    what = "drift: change of the mean of the cache view over the last 1,000 of 2,000 static frames, "
    return [at_most(what + name, 0.02, f["change"], "ratio", f"false alarms: {f['changes']}")
            for name, f in found.items()]  # fmt: skip


def live_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    """Rates and quality; the plot is drawn where all scenes are there."""
    rows = []
    for name, f in found.items():
        for key, words in (("orbit", "while the camera turns"), ("rest", "at rest")):
            r = f[key]
            note = (
                f"{r['train']:.0f} ms training, {r['picture']:.0f} ms picture, {r['encode']:.0f} ms encoding; over HTTP"
            )
            rows.append(
                at_least(f"live frames per second at {LIVE_SIZE}^2, {words}, {name}", 10, r["fps"], "frames/s", note)
            )
        what = f"live: picture to the path-traced one after 2 s of standing still, {name}"
        (first, begin), (last, end) = f["curve"][0], f["curve"][-1]
        note = f"after {first:.1f} s {begin:.1f} dB, after {last:.1f} s {end:.1f}"
        rows.append(at_least(what, 30, at(f["curve"]), "dB", note))
    if set(found) == set(LIVE_SCENES) and not plan["quick"]:
        plot(found, ROOT / "docs" / "images" / "live-quality.png")
    return rows


def gpu_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    what = "GPU: cache overhead per 1080p frame (published: 2.6 ms, RTX 3090)"
    return [of_gpu(what, "GPU: cache overhead per 1080p frame, training and queries")]


def write_page() -> None:
    """Put the rows that something is asked of between their marks in the page."""
    text = PAGE.read_text()
    before, rest = text.split(BEGIN)
    lines = markdown("radiance_cache").replace("|z|", "z, absolute,").splitlines()
    kept = [line for k, line in enumerate(lines) if k < 2 or line.split(" | ")[1] != "–"]
    PAGE.write_text(before + BEGIN + "\n\n" + "\n".join(kept) + "\n\n" + END + rest.split(END)[1])
