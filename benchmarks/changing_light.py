"""Light that changes: switches of a scene's own lamps, learned beside path-traced states.

python benchmarks/changing_light.py                       all scenes; writes results/changing_light.json
python benchmarks/changing_light.py --scenes loft --quick a small run of one scene; writes nothing
python benchmarks/changing_light.py --pictures FOLDER     also pictures of states: learned, reference
python benchmarks/changing_light.py --scenes none --door --day --three --keep FOLDER   whole bakes, which stay in FOLDER
python benchmarks/changing_light.py --scenes none --frames --tracing   times, on a machine that does nothing else
python benchmarks/changing_light.py --scenes none --keys --keep FOLDER the day that --day kept beside key light maps

Each of --door, --day, --three, --frames, --tracing and --keys measures its rows; the rows of the others stay as they
were. --keys bakes a day where FOLDER has none.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from key_light_maps import key_rows
from rows import Row, at_most, chosen, publish, without_bar
from sixteen_lamps import frame_row, tracing_row, untrained

from lightwell.baking.pipeline import bake, loaded
from lightwell.baking.settings import BakeSettings, request_of
from lightwell.core.color import display
from lightwell.core.denoise import denoise, missing
from lightwell.core.image_io import write_picture
from lightwell.core.progress import Progress
from lightwell.core.work import Work
from lightwell.fields.baked import Baked
from lightwell.fields.budget import Budget
from lightwell.fields.protocol import Fit, Job, State
from lightwell.fields.registry import find_field
from lightwell.fields.request import Request
from lightwell.report.metrics import noise_floor, relative_error
from lightwell.scenes.dimmed import dimmed
from lightwell.scenes.viewpoints import sample_cameras
from lightwell.transport import SurfacePoints, draw_surface, static
from lightwell.transport.camera import gbuffer
from lightwell.transport.seen import draw_seen

SHARED = Path(__file__).resolve().parents[2] / "shared" / "zoo"
DOOR = "node:Door.rotation=y:0..90"
# Scenes whose days and doors are measured: names of their bakes, scene, and what varies.
DAYS = {
    "day": ("courtyard-day", ()),
    "day-godot-living-room": (
        str(SHARED.parent / "scenes/gltf/godot-living-room/living_room.glb"),
        ("day=2026-06-21,48.1,11.6",),
    ),
}
DOORS = {
    "door": ("doorway", (DOOR,)),
    "door-courtyard-day": (
        "courtyard-day",
        ("day=2026-06-21,36.7,-4.4,1", "node:Door.translation=(0,0,0)..(1.39,0,0)"),
    ),
}
THREE = (
    "light.position=box(-1.7,0.4,-1.7,1.1,6.5,1.7)",
    "day=2026-06-21,36.7,-4.4,1",
    "node:Door.translation=(0,0,0)..(1.39,0,0)",
)
# Scene and switches.
SCENES: dict[str, tuple[str, tuple[str, ...]]] = {
    "loft": ("loft", ("name",)),
    "pyraxia-hallway": (str(SHARED / "pyraxia-hallway" / "Hallway.gltf"), ("eyes=Eyes*", "glow=Emission*", "each")),
    "needle-lightmap-house": (str(SHARED / "needle-lightmap-house" / "house.glb"), ("each",)),
}
# Options that measure further rows, and what.
MEASURED = {
    "door": "the door",
    "day": "the day",
    "three": "three variables at once",
    "frames": "the time of a frame with sixteen lamps",
    "tracing": "the time of tracing sixteen groups",
    "keys": "light maps of key times beside the day",
}
# Held-out points and paths of each, and random settings of the switches. With 256 paths the noise of small lamps was
# most of the error (loft: 0.22 to 0.26 of 0.43 to 0.9, with 4,096 paths 0.08 to 0.15).
POINTS, PATHS, STATES, SEED = 2048, 4096, 6, 0xC4A
PICTURE, PICTURE_PATHS = (240, 150), 32
# Time of the reference of whole bakes: what three minutes leave for it has few paths, whose noise in dim rooms is most
# of a relative error (one file was 113 % off where the noise was 30 %, and 48 % where it was 20 %).
TRUTH = Budget(120.0)
# Lamps that are shown alone, and taken away.
SHOWN = 3


@dataclass(frozen=True)
class LearnedLamps:
    """The learned lamps of a scene."""

    state: State
    fit: Fit
    baked: Baked

    def at(self, points: SurfacePoints, dimmers: np.ndarray) -> np.ndarray:
        """[N, 3] radiance for dimmers [K]."""
        baked = self.baked.with_frame(lamps=np.tile(np.asarray(dimmers, np.float32), 3))
        return np.maximum(baked(self.fit.query(points, np.zeros(3, np.float32))), 0)

    def reference(self, points: SurfacePoints, dimmers: np.ndarray, paths: int) -> tuple[np.ndarray, np.ndarray]:
        """Two halves [N, 3] of the path-traced radiance."""
        factors = {g.name: (float(d),) * 3 for g, d in zip(self.state.lamps, dimmers)}
        with dimmed(self.state.scene, self.state.lamps, factors):
            return static(self.state.scene, points, paths, SEED)


def learned(name: str, lamps: tuple[str, ...], quick: bool, budget: dict) -> LearnedLamps:
    """Learn the lamps of a scene, and nothing else."""
    with tempfile.TemporaryDirectory() as folder:
        settings = BakeSettings(scene=name, out=Path(folder), lamps=lamps, field="factored", **budget)
        scene, field = loaded(settings), find_field("factored")
        work = Work(settings, scene.digest)
        request = Request(**request_of(settings))
        state = field.prepare(Job(scene, request, settings.options, work, Progress(quiet=quick)))
        state.roles = ("static",)
        fit = field.fit(state, "static", field.sample(state, "static"))
        lowered = fit.lower()
        return LearnedLamps(state, fit, Baked(lowered.graph, lowered.frame))


def errors(
    lit: LearnedLamps, points: SurfacePoints, weight: np.ndarray, dimmers: np.ndarray, paths: int
) -> tuple[float, float]:
    """Relative error of one state with its own exposure, the noise of its reference included, and that noise."""
    a, b = (np.nan_to_num(half) for half in lit.reference(points, dimmers, paths))
    y = 0.5 * (a + b)
    unit = 4 * max(float(np.average(y.mean(axis=1), weights=weight)), 1e-30)
    error = relative_error(lit.at(points, dimmers) / unit, y / unit, weight).mean
    return error, noise_floor(a / unit, b / unit, weight).mean


def states(count: int) -> dict[str, np.ndarray]:
    """Settings of the switches by name: all on, each alone, random ones."""
    random = np.random.default_rng(SEED).random((STATES, count)) < 0.5
    random[~random.any(axis=1), 0] = True
    return {"all": np.ones(count)} | {f"random {k}": row.astype(float) for k, row in enumerate(random)}


def score(name: str, lit: LearnedLamps, quick: bool) -> list[Row]:
    """Errors of the states of a scene."""
    # As the report of a bake draws them: fronts alone, in the core of the scene.
    points = 256 if quick else POINTS
    draw = draw_surface(lit.state.scene, points, SEED, core=True, shown=True)
    paths = 16 if quick else PATHS
    found = {
        what: errors(lit, draw.points, draw.weight, dimmers, paths)
        for what, dimmers in states(len(lit.state.lamps)).items()
    }
    noise = float(np.median([part for _, part in found.values()]))
    (together, _), random = found.pop("all"), [error for error, _ in found.values()]
    seen = draw_seen(lit.state.scene, lit.state.variable, points, SEED, floor=8, shown=True)
    looked = errors(lit, seen.points, seen.weight, np.ones(len(lit.state.lamps)), paths)
    note = f"{len(lit.state.lamps)} lamps; noise of the reference, included: {noise:.1%}"
    return [
        at_most(f"{name}: error of random switch states, median", 0.1, float(np.median(random)), "", note),
        at_most(f"{name}: error of random switch states, worst", 0.1, max(random), "", note),
        at_most(f"{name}: random states over all on", 1.15, float(np.mean(random)) / together, "x", note),
        without_bar(f"{name}: error of all on", together, "", note),
        without_bar(f"{name}: error of all on, where people look", looked[0], "", f"noise included: {looked[1]:.1%}"),
        without_bar(f"{name}: learned lamps", lit.baked.graph.nbytes / 1000, "kB"),
    ]


def pictures(name: str, lit: LearnedLamps, folder: Path) -> None:
    """Write learned and reference side by side for all on, one on and one off, through the first camera."""
    scene, count = lit.state.scene, len(lit.state.lamps)
    width, height = PICTURE
    camera = (scene.cameras or sample_cameras(scene, lit.state.variable, 1, SEED))[0]
    points, mask, _ = gbuffer(scene, camera, width, height)
    seen = np.flatnonzero(mask)
    named = list(enumerate(lit.state.lamps))
    shown = {"all": np.ones(count)} | {f"only {g.name}": np.eye(count)[k] for k, g in named[:SHOWN]}
    shown |= {f"without {g.name}": 1 - np.eye(count)[k] for k, g in named[1:2]}
    folder.mkdir(parents=True, exist_ok=True)
    for what, dimmers in shown.items():
        a, b = lit.reference(points[seen], dimmers, PICTURE_PATHS)
        images = np.zeros((2, height * width, 3), np.float32)
        images[:, seen] = lit.at(points[seen], dimmers), np.nan_to_num(0.5 * (a + b))
        mine, reference = images.reshape(2, height, width, 3)
        clean = reference if missing() else denoise(reference)
        exposure = 0.25 / max(float(np.median(clean[clean > 0])) if (clean > 0).any() else 1, 1e-6)
        side = display(exposure * np.concatenate([mine, clean], axis=1))
        write_picture(folder / f"{name}-{what.replace(' ', '-')}.png", side**2.2, 1.0)


def size_rows() -> list[Row]:
    """Bytes of a lamp, and multiply-adds of a pixel, from untrained graphs of one and of sixteen lamps."""
    one, sixteen = untrained(1), untrained(16)
    return [
        at_most("one more lamp", 8, (sixteen.nbytes - one.nbytes) / 15 / 1000, "kB", "quality good"),
        without_bar("field of one lamp", one.nbytes / 1000, "kB", "quality good"),
        at_most("multiply-adds of a pixel, 16 lamps over one", 1.05, sixteen.macs / one.macs, "x"),
    ]


def baked(name: str, scene: str, vary: tuple[str, ...], quick: bool, keep: Path | None, **more: Any) -> dict[str, Any]:
    """The report of a whole bake, which stays in a folder of its name where one is given."""
    small: dict[str, Any] = (
        {"quality": "draft", "shards": 1, "steps": 40, "lights_per_shard": 64, "truth": None} if quick else {}
    )
    with tempfile.TemporaryDirectory() as folder:
        out = (keep or Path(folder)) / name
        return bake(BakeSettings(scene=scene, out=out, vary=vary, **({"truth": TRUTH} | more | small)))


def day_rows(quick: bool, measure: bool, keep: Path | None, counts: dict[str, int]) -> list[Row]:
    """Days of scenes with the sky, at times that were not learned."""
    return [row for name in DAYS for row in _day_rows(name, quick, measure, keep, counts)]


def _day_rows(name: str, quick: bool, measure: bool, keep: Path | None, counts: dict[str, int]) -> list[Row]:
    error, bare, note = None, None, "not measured yet: python benchmarks/changing_light.py --day on a quiet machine"
    if measure:
        report = baked(name, *DAYS[name], quick, keep, **counts)
        error = report["relative_error"]
        shown, noise = (report["quality"] or {}).get("psnr_db") or 0, report["noise_floor"]
        note = f"{shown:.1f} dB in the pictures, noise taken off; noise of the reference {noise:.1%}"
        bare = report["error_without_noise"]
    return [
        at_most(f"{name}: error at held-out times", 0.08, error, "", note),
        without_bar(f"{name}: error at held-out times, noise taken off", bare, "", "root mean square"),
    ]


def key_map_rows(quick: bool, measure: bool, keep: Path | None, counts: dict[str, int]) -> list[Row]:
    """The kept bake of a day, or one that is made for it, beside light maps of key times."""
    if not measure:
        return key_rows(None, quick)
    with tempfile.TemporaryDirectory() as folder:
        keep = keep or Path(folder)
        if not (keep / "day" / "report.json").exists():
            baked("day", "courtyard-day", (), quick, keep, **counts)
        return key_rows(keep / "day", quick)


def three_rows(quick: bool, measure: bool, keep: Path | None, counts: dict[str, int]) -> list[Row]:
    """A lamp that roams, the sun and the door of the courtyard at once."""
    error, bare, note = None, None, "not measured yet: python benchmarks/changing_light.py --three on a quiet machine"
    if measure:
        report = baked("three", "courtyard-day", THREE, quick, keep, **counts)
        of_sun = report["settings"]["indirect-day_field"]
        sun = of_sun["relative_error"]
        lamp, noise = report["relative_error"], (report["noise_floor"], of_sun["noise_floor"])
        error = 0.5 * (lamp + sun)
        both = [part["error_without_noise"] for part in (report, of_sun)]
        bare = None if None in both else 0.5 * sum(both)
        note = (
            f"courtyard-day; lamp {lamp:.1%}, sun and sky {sun:.1%}, each with the door in any pose; noise of the "
            f"reference {noise[0]:.1%} and {noise[1]:.1%}"
        )
    return [
        at_most("three variables at once: error", 0.12, error, "", note),
        without_bar("three variables at once: error, noise taken off", bare, "", "root mean square"),
    ]


def door_rows(quick: bool, measure: bool, keep: Path | None, counts: dict[str, int]) -> list[Row]:
    """Doors that shut, from whole bakes; without figures unless they are measured."""
    return [row for name in DOORS for row in _door_rows(name, quick, measure, keep, counts)]


def _door_rows(name: str, quick: bool, measure: bool, keep: Path | None, counts: dict[str, int]) -> list[Row]:
    error = leak = size = None
    note = "not measured yet: python benchmarks/changing_light.py --door on a quiet machine"
    if measure:
        report = baked(name, *DOORS[name], quick, keep, **counts)
        poses, stops = report["facts"]["movers"][0]["poses"], report["facts"]["movers"][0]["end_stops"]
        error, leak = float(np.mean([pose["relative_error"] for pose in poses])), stops[0]["leak"]
        size = report["bytes"] / 1000 if "bytes" in report else None
        worst = report["facts"]["movers"][0]["worst_pose"]
        noise = float(np.mean([pose["noise"] for pose in poses]))
        note = f"{DOORS[name][0]}; worst {worst['relative_error']:.1%} at {worst['value']:g}; noise {noise:.1%}"
    return [
        at_most(f"{name}: error at held-out poses", 0.1, error, "", note),
        at_most(f"{name}: light that leaks when shut", 0.01, leak, "of the open light", note),
        at_most(f"{name}: asset", 300, size, "kB", note),
    ]


def main() -> None:
    """Measure and publish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", help=f"none, or some of {', '.join(SCENES)}, joined by commas (default: all)")
    parser.add_argument("--quick", action="store_true", help="a small run; writes nothing")
    parser.add_argument(
        "--shards", type=int, help="batches of 8,192 points (whole bakes: 65,536 samples), not a time budget"
    )
    parser.add_argument("--steps", type=int, help="steps of the training, in place of a time budget")
    for name, what in MEASURED.items():
        parser.add_argument(f"--{name}", action="store_true", help=f"measure {what} as well")
    parser.add_argument("--keep", type=Path, help="folder for the bakes of these")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of states")
    arguments = parser.parse_args()
    budget = {"shards": 1, "steps": 40} if arguments.quick else {}
    budget |= {name: getattr(arguments, name) for name in ("shards", "steps") if getattr(arguments, name)}
    rows = size_rows()
    rows += [frame_row(arguments.frames, arguments.quick), tracing_row(arguments.tracing, arguments.quick)]
    whole = ((door_rows, "door"), (day_rows, "day"), (key_map_rows, "keys"), (three_rows, "three"))
    for of, name in whole:
        rows += of(arguments.quick, getattr(arguments, name), arguments.keep, budget)
    for name in [] if arguments.scenes == "none" else chosen("--scenes", arguments.scenes, SCENES):
        lit = learned(*SCENES[name], arguments.quick, budget)
        if arguments.pictures:
            pictures(name, lit, arguments.pictures)
        rows += score(name, lit, arguments.quick)
    publish("changing_light", rows, arguments.quick)


if __name__ == "__main__":
    main()
