"""How many frames an untrained cache needs, and one that starts from a baked field of the scene; parts of
radiance_cache.py.

The error is that of the cache view (its values at what the camera sees) against the path-traced reference; the steady
one is the median of the last fifth of the frames.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from radiance_cache_runs import cold
from radiance_cache_table import HALVES
from radiance_cache_truth import Truth, source_of, truth_of, zoo_live
from rows import Row, at_most, without_bar

from lightwell.backend import dr
from lightwell.baking.pipeline import bake
from lightwell.baking.settings import BakeSettings
from lightwell.cache import RadianceCache, settings_of
from lightwell.cache.views import view
from lightwell.cache.warm_start import BakedLight, warm_start

WARM_SCENES = ("bevy-cornell", "hello-webxr-hall", "needle-scanned-room", "drake-living-room")
Figures = dict[str, Any]


def settling(scene: Any, sensor: Any, cache: RadianceCache, truth: Truth, frames: int) -> Figures:
    """Frames until the error of the cache view stays within 1.1 x the steady one; errors are of all frames."""
    errors_of = []
    with dr.suspend_grad():
        for _ in range(frames):
            cache.train_frame(scene, sensor, 1)
            errors_of.append(truth.error(view(scene, sensor, cache, "cache", 4, 5)))
    curve = np.array(errors_of)
    steady = float(np.median(curve[-max(frames // 5, 1) :]))
    return {"frames": stays(curve <= 1.1 * steady), "steady": steady, "after8": float(curve[min(7, frames - 1)]),
            "curve": [float(f"{x:.3g}") for x in curve]}  # fmt: skip


def cold_start(name: str, scene: Any, plan: Figures) -> Figures:
    """Frames to 1.1 x the steady error of the cache view, from an untrained cache."""
    sensor = scene.sensors()[0]
    truth = truth_of(name, scene, sensor, plan["size"], plan["reference"])
    return settling(scene, sensor, cold({"mode": "frames"}, scene).cache, truth, 6 if plan["quick"] else 100)


def warm(name: str, scene: Any, plan: Figures) -> Figures:
    """The same from a baked field of the scene, a draft; and from an untrained cache beside it."""
    loaded, live = zoo_live(str(source_of(name)), plan["size"])
    sensor, frames = live.sensor, 6 if plan["quick"] else 100
    truth = truth_of(name, live.scene, sensor, plan["size"], plan["reference"], "-live")
    with tempfile.TemporaryDirectory() as folder:
        bake(BakeSettings(str(source_of(name)), Path(folder), quality="draft"))
        baked = BakedLight.read(Path(folder) / "scene.glb")
    found: Figures = {}
    for kind in ("cold", "warm"):
        cache = RadianceCache(settings_of({"mode": "frames"}))
        if kind == "warm":
            warm_start(cache, live, loaded, baked, 0)
        else:
            cache.prepare(live.scene)
        found[kind] = settling(live.scene, sensor, cache, truth, frames)
    return found


def stays(holds: np.ndarray) -> int:
    """Number, from 1, of the frame from which on it holds, for most of the eight frames from there."""
    for k in range(len(holds)):
        if holds[k] and holds[k : k + 8].mean() > 0.5:
            return k + 1
    return len(holds) + 1


def cold_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    what = "cold start: frames to 1.1 x the steady error of the cache view"
    rows = [without_bar(f"{what}, {name} ({HALVES[name]})", f["frames"], "frames",
                        f"steady error {f['steady']:.3g}, after 8 frames {f['after8']:.3g}")
            for name, f in found.items()]  # fmt: skip
    median = float(np.median([f["frames"] for f in found.values()])) if set(found) == set(HALVES) else None
    return [*rows, at_most(f"{what}, median of the scenes", 8, median, "frames")]


def warm_rows(found: dict[str, Figures], plan: Figures) -> list[Row]:
    what = "warm start: frames to 1.1 x the steady error of the cache view from a baked field"
    rows = []
    for name, f in found.items():
        note = (f"first frame {f['warm']['curve'][0]:.3g}, steady {f['warm']['steady']:.3g}; untrained "
                f"{f['cold']['curve'][0]:.3g} and {f['cold']['frames']} frames; a draft bake")  # fmt: skip
        rows.append(at_most(f"{what}, {name}", 1, f["warm"]["frames"], "frames", note))
    return rows
