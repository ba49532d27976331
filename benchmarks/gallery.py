"""The gallery: the main job on four scenes that nobody here made, each with its figures and a screenshot of its page.

    python benchmarks/gallery.py [--budget 3m] [--out FOLDER] [--reuse]

Bakes into FOLDER, photographs the pages (needs Node and a Chromium, as the tests do) and writes docs/gallery.md with
small PNGs in docs/images/. ``--reuse`` takes bakes that are already in FOLDER. `python tools/live_pages.py
FOLDER/*` then puts the pages themselves on the site.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from lightwell.core.units import size_text

ROOT = Path(__file__).resolve().parents[1]
GIVEN = ROOT.parent / "shared" / "scenes"
IMAGES = ROOT / "docs" / "images"
# Width of the gallery's pictures, pixels; of the screenshot it is made from.
WIDTH, TAKEN = 640, "1280x800"


@dataclass(frozen=True)
class Entry:
    """One scene of the gallery."""

    name: str
    file: str
    credit: str
    view: int = 0


ENTRIES = (
    Entry("godot-living-room", "gltf/godot-living-room/living_room.glb", "Godot Engine contributors, MIT"),
    Entry("room-soft-shadows", "gltf/room-soft-shadows/room-decoded.glb", "Anex (sketchfab.com/anex), CC-BY-4.0"),
    Entry("veach-ajar", "mitsuba/veach-ajar/scene_mi3.xml", "Benedikt Bitterli, CC0"),
    Entry("staircase2", "mitsuba/staircase2/scene_mi3.xml", "NewSee2l035, port by Benedikt Bitterli, CC-BY-3.0"),
)

HEAD = """\
# Gallery

The main job on scenes that nobody here made: `lightwell bake SCENE -o OUT --budget {budget}`, on 2 cores without a
GPU, all by `python benchmarks/gallery.py`. A point light roams each scene's air; where a scene has lights of its own,
theirs is learned as a second field. The pictures are screenshots of the page: direct light of the moving lamp by the
rasteriser, everything else learned. Pages to move the lamp in: [live pages](live-pages.md).

[Relative error](glossary.md) is over surface points under lights that training never saw; *noise* is what the
path-traced reference itself still has. The dark corners of a scene weigh as much as its bright ones in the mean, so
that the median is given too. PSNR and FLIP are those of the picture on screen, held-out views and lights.

| scene | error | median | noise of the reference | PSNR dB | FLIP | learned data | MAC per pixel | wall time |
|---|---|---|---|---|---|---|---|---|
"""


def bake(entry: Entry, out: Path, budget: str) -> None:
    """Run the command line, as a user does."""
    command = [
        sys.executable,
        "-m",
        "lightwell.cli",
        "bake",
        str(GIVEN / entry.file),
        "-o",
        str(out),
        "--budget",
        budget,
    ]
    subprocess.run(command, check=True)


def photograph(entry: Entry, out: Path) -> Path:
    """Screenshot of the page without controls, scaled down."""
    large, small = out / "screenshot.png", IMAGES / f"{entry.name}.png"
    query = f"mode=learned&view={entry.view}&ui=0&weights=inline"
    script = [str(ROOT / "tools/screenshot.mjs"), str(large), str((out / "index.html").resolve()), query, TAKEN]
    if not large.exists() or large.stat().st_mtime < (out / "index.html").stat().st_mtime:
        subprocess.run(["node", *script], check=True)
    picture = Image.open(large).convert("RGB")
    picture = picture.resize((WIDTH, round(WIDTH * picture.height / picture.width)), Image.Resampling.LANCZOS)
    picture.save(small, optimize=True)
    return small


def row(entry: Entry, report: dict) -> str:
    """One line of the table."""
    quality = report.get("quality") or {}
    least = "≥ " if "psnr_db" in quality.get("bounds", {}) else ""
    psnr, flip = quality.get("psnr_db"), quality.get("flip")
    cells = (
        f"[{entry.name}](#{entry.name})",
        f"{report['relative_error']:.1%}",
        f"{report['relative_error_median']:.1%}",
        f"{report['noise_floor']:.1%}",
        "–" if psnr is None else f"{least}{psnr:.1f}",
        "–" if flip is None else f"{flip:.3f}",
        size_text(report["bytes"]),
        f"{report['macs_per_pixel']:,}",
        f"{report['seconds']['total']:.0f} s",
    )
    return "| " + " | ".join(cells) + " |"


def section(entry: Entry, report: dict, picture: Path) -> str:
    """Heading, picture and what the report says."""
    lines = [f"## {entry.name}", "", f"![{entry.name}](images/{picture.name})", "", f"*{entry.credit}.*"]
    if report.get("verdict"):
        lines += ["", f"The report's verdict: *{report['verdict']}*"]
    static = report["settings"].get("static_field")
    if static:
        error, noise = static["relative_error"], static["noise_floor"]
        lines += [
            "",
            f"Its own lamps, learned as a still field: error {error:.1%}, noise of the reference {noise:.1%}.",
        ]
    if report["warnings"]:
        lines += ["", "What the bake warned of:", ""]
        lines += [f"- {warning}" for warning in report["warnings"][:6]]
        if len(report["warnings"]) > 6:
            lines += [f"- … and {len(report['warnings']) - 6} more, in the report"]
    return "\n".join(lines)


def main() -> None:
    """Bake, photograph, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--budget", default="3m")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "gallery")
    parser.add_argument("--reuse", action="store_true")
    arguments = parser.parse_args()
    IMAGES.mkdir(parents=True, exist_ok=True)
    rows, sections = [], []
    for entry in ENTRIES:
        out = arguments.out / entry.name
        if not (arguments.reuse and (out / "report.json").exists()):
            bake(entry, out, arguments.budget)
        report = json.loads((out / "report.json").read_text())
        sections.append(section(entry, report, photograph(entry, out)))
        rows.append(row(entry, report))
    text = HEAD.format(budget=arguments.budget) + "\n".join(rows) + "\n\n" + "\n\n".join(sections) + "\n"
    (ROOT / "docs/gallery.md").write_text(text)


if __name__ == "__main__":
    main()
