"""The main job at default settings on every scene that is there: given, further third-party and built-in ones.

    python benchmarks/zoo.py --out FOLDER              every scene; writes results/zoo.json and docs/zoo.md (hours)
    python benchmarks/zoo.py --out FOLDER --subset 8   eight scenes while working on the field; writes nothing
    python benchmarks/zoo.py --out FOLDER --only drake-living-room,courtyard -- --budget 60s
    python benchmarks/zoo.py --out FOLDER --reuse      only the table and the pictures of bakes that are in FOLDER

Each scene is baked in a process of its own by the command that a user would type. A scene whose bake is in FOLDER is
not baked again. What follows ``--`` goes to the bake.

The scenes of ``KEPT_OUT`` took no part in choosing any constant.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parent))

from rows import Row, at_least, at_most, publish

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"
IMAGES = ROOT / "docs" / "images" / "zoo"
BUILT_IN = ("cornell", "courtyard", "two-rooms")
GIVEN = {
    "cornell-box": "mitsuba/cornell-box/scene_mi3.xml",
    "staircase2": "mitsuba/staircase2/scene_mi3.xml",
    "veach-ajar": "mitsuba/veach-ajar/scene_mi3.xml",
    "veach-bidir": "mitsuba/veach-bidir/scene_mi3.xml",
    "living-room-2": "mitsuba/living-room-2/scene_mi3.xml",
    "godot-living-room": "gltf/godot-living-room/living_room.glb",
    "godot-room": "gltf/godot-room/room.glb",
    "room-soft-shadows": "gltf/room-soft-shadows/room-decoded.glb",
    "littlest-tokyo": "gltf/littlest-tokyo/LittlestTokyo-transformed.glb",
    "tile-game-room": "gltf/tile-game-room/tile-game-room6.glb",
    "zdm2": "gltf/zdm2/zdm2.glb",
    "bevy-cornell": "gltf/bevy-cornell/CornellBox.glb",
    "bevy-dof": "gltf/bevy-dof/DepthOfFieldExample.glb",
}
SUFFIXES = (".glb", ".gltf", ".xml")
# Eight scenes of different kinds for work on the field.
SUBSET = (
    "cornell",
    "courtyard",
    "godot-living-room",
    "drake-living-room",
    "modern-house",
    "recast-dungeon",
    "needle-lightmap-house",
    "hello-webxr-hall",
)
# Scenes that took no part in choosing any constant.
KEPT_OUT = ("staircase2", "webxr-cave", "pyraxia-hallway", "vr-gallery")
# A bake that takes longer than this is a failure, seconds.
LONGEST = 1800
# Height of a picture of the page, pixels.
HEIGHT = 200
# Bars: median and 90th percentile (of the worse direction) over scenes.
BARS: tuple[tuple[str, str, float, float, bool, str], ...] = (
    ("psnr_db", "PSNR of the indirect light, noise off", 36, 31, True, "dB"),
    ("flip", "FLIP of the whole picture", 0.06, 0.12, False, "of 1"),
    ("mottle", "mottle of smooth lit patches", 0.03, 0.08, False, "of 1"),
    ("leak", "leak", 0.005, 0.02, False, "of 1"),
    ("relative_error", "relative error", 0.08, 0.20, False, "of 1"),
)


@dataclass(frozen=True)
class Result:
    """One scene."""

    name: str
    outcome: str
    """'page', or the last line of what the command said."""
    wall: float
    """Seconds."""
    budget: float | None
    """Seconds that the bake was given."""
    figures: dict[str, float | None]
    bytes: int | None
    macs: int | None
    verdict: str

    @property
    def overtime(self) -> float | None:
        """Seconds beyond 1.25 × budget + 15 s; negative when in time."""
        return None if self.budget is None else self.wall - (1.25 * self.budget + 15)


def scenes() -> dict[str, str]:
    """Name each scene that is on this machine, with its path or built-in name."""
    found = {name: name for name in BUILT_IN}
    found |= {name: str(path) for name, file in GIVEN.items() if (path := SHARED / "scenes" / file).exists()}
    for folder in sorted((SHARED / "zoo").glob("*/")):
        files = sorted(p for p in folder.iterdir() if p.suffix in SUFFIXES)
        found |= {folder.name: str(files[0])} if files else {}
    return found


def bake(name: str, scene: str, folder: Path, more: Sequence[str]) -> Result:
    """Bake a scene by the command line, or read what an earlier run left.

    Args:
        name: What the scene is called here.
        scene: Path or built-in name.
        folder: Where bakes lie, one folder each.
        more: Further arguments of the bake.

    Returns:
        What came out.
    """
    out, record = folder / name, folder / f"{name}.json"
    if record.exists():
        told = json.loads(record.read_text())
    else:
        command = [sys.executable, "-m", "lightwell", "bake", scene, "-o", str(out), "--force", "--json", *more]
        start = perf_counter()
        try:
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=LONGEST, check=False)
            lines = done.stderr.strip().splitlines() or ["no word"]
            outcome = "page" if done.returncode == 0 and (out / "index.html").exists() else lines[-1][:300]
        except subprocess.TimeoutExpired:
            outcome = f"not finished after {LONGEST} s"
        told = {"outcome": outcome, "wall": perf_counter() - start}
        record.write_text(json.dumps(told))
    report = out / "report.json"
    numbers = json.loads(report.read_text()) if report.exists() and told["outcome"] == "page" else {}
    return _result(name, told, numbers)


def _result(name: str, told: dict[str, Any], numbers: dict[str, Any]) -> Result:
    quality = numbers.get("quality", {})
    figures = {key: quality.get(key) for key, *_ in BARS}
    return Result(
        name,
        told["outcome"],
        told["wall"],
        numbers.get("settings", {}).get("budget_seconds"),
        figures,
        numbers.get("bytes"),
        numbers.get("macs_per_pixel"),
        numbers.get("verdict", ""),
    )


def rows(results: Sequence[Result]) -> list[Row]:
    """The bars over all scenes: medians, and 90th percentiles of the worse direction."""
    found = []
    for key, words, median, tail, higher, unit in BARS:
        values = [r.figures[key] for r in results if r.figures.get(key) is not None]
        note = f"{len(values)} of {len(results)} scenes"
        row = at_least if higher else at_most
        at = (50, 10 if higher else 90)
        middle, worse = np.percentile(values, at) if values else (None, None)
        found += [row(f"zoo: {words}, median", median, middle, unit, note)]
        found += [row(f"zoo: {words}, 90th percentile", tail, worse, unit, note)]
    failed = [r for r in results if r.outcome != "page"]
    late = [r.overtime for r in results if r.overtime is not None]
    whole = [r for r in results if r.bytes is not None]
    found += [
        at_most("zoo: scenes without a page", 0, len(failed), "scenes", "; ".join(r.name for r in failed)),
        at_most("zoo: bytes, largest", 300_000, max((r.bytes for r in whole), default=None), "B"),
        at_most("zoo: multiply-adds per pixel, most", 1500, max((r.macs for r in whole), default=None), "MAC"),
        at_most("zoo: wall time beyond 1.25 x budget + 15 s, worst", 0, max(late, default=None), "s"),
    ]
    return found


# ---------------------------------------------------------------------- page


def picture(report: str, height: int = HEIGHT) -> Image.Image | None:
    """Put the first view of a report side by side: learned, then path-traced.

    Args:
        report: Text of ``report.html``.
        height: Height of the picture, pixels.

    Returns:
        The picture, or None where the report has no view.
    """
    panels = []
    for kind in ("learned", "path-traced"):
        match = re.search(rf'<img alt="{kind}, (?!worst)[^"]*" src="data:image/png;base64,([^"]+)"', report)
        if not match:
            return None
        image = Image.open(io.BytesIO(base64.b64decode(match[1]))).convert("RGB")
        panels.append(image.resize((round(image.width * height / image.height), height), Image.Resampling.LANCZOS))
    both = Image.new("RGB", (sum(p.width for p in panels) + 4, height), "white")
    both.paste(panels[0], (0, 0))
    both.paste(panels[1], (panels[0].width + 4, 0))
    return both


def write_page(results: Sequence[Result], folder: Path) -> None:
    """Write docs/zoo.md and its pictures.

    Args:
        results: What came out.
        folder: Where bakes lie.
    """
    IMAGES.mkdir(parents=True, exist_ok=True)
    lines = [
        HEAD,
        *(_line(r) for r in results),
        "",
        "## Pictures",
        "",
        "Learned to the left, path-traced to the right.",
        "",
    ]
    for result in results:
        report = folder / result.name / "report.html"
        made = picture(report.read_text()) if result.outcome == "page" and report.exists() else None
        if made:
            made.save(IMAGES / f"{result.name}.webp", quality=80)
            lines += [f"![{result.name}: learned and path-traced](images/zoo/{result.name}.webp)", ""]
        lines += [f"*{result.name}*: {result.verdict or result.outcome}", ""]
    (ROOT / "docs" / "zoo.md").write_text("\n".join(lines))


HEAD = """\
# The zoo

`lightwell bake SCENE -o OUT` with default settings on scenes of many kinds, by `python benchmarks/zoo.py`.
Nothing is set for a scene. Scenes marked * took no part in choosing any constant. Figures of merit are medians
and 90th percentiles over scenes (`benchmarks/results/zoo.json`), not single lines of this table.

PSNR is that of the displayed indirect light with the noise of the reference taken off; FLIP is that of the
whole picture; *mottle* is the standard deviation of the logarithm of learned over reference on smooth lit
patches; *leak* is the light that is wrong on the darkest quarter of the surface, over the mean of all.

| scene | wall / budget, s | PSNR, dB | FLIP | mottle | leak | error | kB | MAC |
|---|---|---|---|---|---|---|---|---|"""


def _line(r: Result) -> str:
    mark = " *" if r.name in KEPT_OUT else ""
    if r.outcome != "page":
        return f"| {r.name}{mark} | {r.wall:.0f} | no page: {r.outcome} | | | | | | |"
    number = lambda key, form: "–" if r.figures.get(key) is None else format(r.figures[key], form)  # noqa: E731
    cells = [number("psnr_db", ".1f"), number("flip", ".3f"), number("mottle", ".3f"), number("leak", ".2%")]
    cells += [number("relative_error", ".1%"), f"{(r.bytes or 0) / 1000:.0f}", f"{r.macs or 0:,}"]
    return f"| {r.name}{mark} | {r.wall:.0f} / {r.budget or 0:.0f} | " + " | ".join(cells) + " |"


def main() -> None:
    """Bake, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the bakes")
    parser.add_argument("--subset", type=int, help="the first so many of the scenes for work on the field")
    parser.add_argument("--only", help="names of scenes, separated by commas")
    parser.add_argument("--reuse", action="store_true", help="only scenes whose bake is in the folder")
    parser.add_argument("--page", action="store_true", help="write docs/zoo.md also for a part of the scenes")
    parser.add_argument("bake", nargs="*", help="further arguments of the bakes, after --")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    chosen = scenes()
    if arguments.only or arguments.subset:
        names = arguments.only.split(",") if arguments.only else SUBSET[: arguments.subset]
        chosen = {name: chosen[name] for name in names if name in chosen}
    if arguments.reuse:
        chosen = {name: scene for name, scene in chosen.items() if (arguments.out / f"{name}.json").exists()}
    results = []
    for name, scene in chosen.items():
        results.append(bake(name, scene, arguments.out, arguments.bake))
        print(json.dumps(asdict(results[-1])), flush=True)
    whole = not (arguments.only or arguments.subset or arguments.bake)
    publish("zoo", rows(results), quick=not whole)
    if whole or arguments.page:
        write_page(results, arguments.out)


if __name__ == "__main__":
    main()
