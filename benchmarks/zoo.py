"""The main job on every scene that is there, with default settings only: how good is light that nobody tuned?

    python benchmarks/zoo.py [--subset 8] [--only NAMES] [--out FOLDER] [--quality NAME]
                                                hours on 2 cores; goes on where it stopped
    python benchmarks/zoo.py --ablation [--subset 8] [--out FOLDER]
                                                what each choice is worth, at equal steps; goes on where it stopped
    python benchmarks/zoo.py --field lightmap|factored+probes [--subset 8] [--out FOLDER]
                                                other fields, by the figures of their own reports
    python benchmarks/zoo.py --table                    print what is recorded

Every scene is baked and scored in processes of its own. Figures of merit are medians and 90th percentiles over scenes.
Results lie in FOLDER/NAME.json (NAME.FIELD.json); results/zoo.json and docs/zoo.md are written when all scenes have
ended, or with --publish for those that are asked for; other fields have results/zoo_FIELD.json.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parent))

from rows import Row, at_least, at_most, markdown, publish, without_bar
from zoo_scenes import CREDITS, HELD_OUT, SUBSET, scenes
from zoo_score import DIFFERENCE, VIEWS

from lightwell.fields.budget import DEFAULT_QUALITY, QUALITY_SECONDS

ROOT = Path(__file__).resolve().parents[1]
# Views of each scene on the page, and the width of their picture, pixels.
SHOWN_VIEWS, PAGE_WIDTH = 2, 1080
# Seconds for the reference of the report of a light map or of probes, which their figures are from: the noise of one
# within the budget hides the error.
TRUTH = 120
# Longest wall time of one bake and of its scoring, seconds.
PATIENCE = 3600
# The wall time of a bake, from the start of its process, is at most so many times the budget and so many seconds.
WALL_FACTOR, WALL_SECONDS = 1.25, 15.0
WALL = f"wall time of a bake over ({WALL_FACTOR} x budget + {WALL_SECONDS:.0f} s)"
# figure: (what, better, bar of the median, bar of the 90th percentile, unit); docs/zoo.md says what each is.
BARS = {
    "psnr_db": ("noise-free PSNR of the indirect light", max, 36, 31, "dB"),
    "flip": ("FLIP of the whole picture", min, 0.06, 0.12, ""),
    "mottle": ("mottle", min, 0.03, 0.08, ""),
    "leak": ("leak", min, 0.005, 0.02, "of 1"),
    "relative_error": ("relative error", min, 0.08, 0.2, "of 1"),
    "bytes": ("bytes", min, 300_000, 300_000, "B"),
    "macs": ("multiply-adds per pixel", min, 1500, 1500, "MAC"),
}
# Those of the page in a browser, beside its own references (zoo_page.py); nothing asks for a value of them.
PAGE_FIGURES = {
    "page_flip": ("FLIP of the page in a browser, mean of its views", 90, ""),
    "page_psnr": ("PSNR of the page in a browser", 10, "dB"),
}
# Those that are asked of a light map, whose reference is that of its own bake.
LIGHT_MAP_BARS = {
    "psnr_db": ("noise-free PSNR", max, 36, 31, "dB"),
    "flip": ("FLIP of the whole picture", min, 0.06, 0.12, ""),
}
# Those of probes: balls in free air, as the report of a bake has them. The walls are those of the field beside them.
PROBES_BARS = {"moved_flip": ("FLIP of what probes light", min, 0.08, None, "")}
FIELD_BARS = {"lightmap": LIGHT_MAP_BARS, "factored+probes": PROBES_BARS}


def run_scene(name: str, source: str, out: Path, quality: str, field: str | None) -> dict:
    """Bake and score one scene, each in a process of its own; the row is kept in a file."""
    label = f"{name}.{field}" if field else name
    path, folder = out / f"{label}.json", out / label
    if path.exists():
        return json.loads(path.read_text())
    begin = perf_counter()
    command = [sys.executable, "-m", "lightwell.cli", "bake", source, "-o", str(folder), "--quality", quality]
    code, message = _process([*command, "--field", field, "--truth", f"{TRUTH}s"] if field else command)
    row = {
        "scene": name,
        "seconds": round(perf_counter() - begin, 1),
        "budget": QUALITY_SECONDS[quality] + (TRUTH if field else 0),
        "exit": code,
        "message": message,
        "commit": _commit(),
    }
    if code == 0 and field:
        row |= _reported(folder)
    elif code == 0:
        scorer = Path(__file__).with_name("zoo_score.py")
        code, message = _process([sys.executable, str(scorer), source, str(folder)])
        row |= json.loads((folder / "quality.json").read_text()) if code == 0 else {"exit": code, "message": message}
    if code == 0:
        code, message = _process([sys.executable, str(Path(__file__).with_name("zoo_page.py")), str(folder)])
        row |= json.loads((folder / "page.json").read_text()) if code == 0 else {"page": message}
    path.write_text(json.dumps(row))
    return row


def _reported(folder: Path) -> dict:
    """The figures that a bake reports itself; those without a value are null."""
    report = json.loads((folder / "report.json").read_text())
    empty = dict.fromkeys(("psnr_db", "flip", "flip_direct", "mottle", "leak", "relative_error", "noise_floor"))
    told = empty | (report.get("quality") or {}) | {"moved_flip": (report.get("moved_objects") or {}).get("flip")}
    return told | {"bytes": report["bytes"], "macs": report["macs_per_pixel"], "verdict": report.get("verdict")}


def _commit() -> str:
    """Short name of the commit that is measured."""
    found = subprocess.run(["git", "rev-parse", "--short=7", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    return found.stdout.strip() or "unknown"


def _process(command: list[str]) -> tuple[int, str]:
    """Exit code and last line of what a process says."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return 124, f"no end after {PATIENCE} s"
    said = (done.stdout + done.stderr).strip().splitlines()
    return done.returncode, said[-1][:200] if said and done.returncode else ""


def table(rows: list[dict]) -> str:
    """All rows as a Markdown table."""
    lines = [
        "| scene | PSNR dB | FLIP (direct alone) | page | mottle | leak | error (noise) | bytes | MAC | s |",
        "|---" * 10 + "|",
    ]
    number = lambda value, form: "–" if value is None else format(value, form)  # noqa: E731
    for row in rows:
        mark = " *" if row["scene"] in HELD_OUT else ""
        if row["exit"]:
            lines.append(f"| {row['scene']}{mark} | {row['message']} | | | | | | | | {row['seconds']:.0f} |")
            continue
        flip = f"{number(row['flip'], '.3f')} ({number(row['flip_direct'], '.3f')})"
        error = f"{number(row['relative_error'], '.3f')} ({number(row['noise_floor'], '.3f')})"
        bounds = row.get("bounds", {})
        psnr = ("≥ " if "psnr_db" in bounds else "") + number(row["psnr_db"], ".1f")
        mottle = f"≤ {bounds['mottle']:.3f}" if "mottle" in bounds else number(row["mottle"], ".3f")
        leak = f"≤ {bounds['leak']:.4f}" if "leak" in bounds else number(row["leak"], ".4f")
        page = "none" if row.get("page") else number(row.get("page_flip"), ".3f")
        cells = [row["scene"] + mark, psnr, flip, page, mottle]
        cells += [leak, error, f"{row['bytes']:,}", f"{row['macs']:,}", f"{row['seconds']:.0f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def measured(row: dict, key: str, tail: float | None) -> bool:
    """Whether a figure of a scene counts: a leak that is less than its noise does where the noise is within the bar."""
    hidden = key == "leak" and row.get("bounds", {}).get("leak", 0) > (tail or 0)
    return row.get(key) is not None and not hidden


def figures(rows: list[dict], bars: dict[str, tuple]) -> list[Row]:
    """Medians and 90th percentiles of all scenes that ended with a page, and how many did not."""
    found = []
    for key, (what, better, median, tail, unit) in bars.items():
        values = [row[key] for row in rows if not row["exit"] and measured(row, key, tail)]
        at, quantile = (at_least, 10) if better is max else (at_most, 90)
        note = f"{len(values)} scenes"
        found.append(at(f"zoo, median: {what}", median, float(np.median(values)) if values else None, unit, note))
        worst = float(np.percentile(values, quantile)) if values else None
        what = f"zoo, 90th percentile: {what}"
        found.append(without_bar(what, worst, unit, note) if tail is None else at(what, tail, worst, unit, note))
    for key, (what, quantile, unit) in PAGE_FIGURES.items():
        values = [row[key] for row in rows if row.get(key) is not None]
        for name, at in (("median", 50), (f"{max(quantile, 100 - quantile)}th percentile", quantile)):
            value = float(np.percentile(values, at)) if values else None
            found.append(without_bar(f"zoo, {name}: {what}", value, unit, f"{len(values)} scenes"))
    undrawn = [row["scene"] for row in rows if row.get("page")]
    found.append(at_most("zoo: pages that do not draw", 0, len(undrawn), "pages", ", ".join(undrawn)))
    failed = [row["scene"] for row in rows if row["exit"]]
    late = [row["seconds"] / (WALL_FACTOR * row["budget"] + WALL_SECONDS) for row in rows if "budget" in row]
    found.append(at_most(f"zoo, longest: {WALL}", 1.0, max(late, default=None), "of 1", f"{len(late)} scenes"))
    return [*found, at_most("zoo: scenes that end without a page", 0, len(failed), "scenes", ", ".join(failed))]


def write_page(rows: list[dict], out: Path) -> None:
    """docs/zoo.md: the tables and pictures of each scene, learned beside reference."""
    images = ROOT / "docs" / "images" / "zoo"
    images.mkdir(parents=True, exist_ok=True)
    shown = []
    for row in rows:
        picture = out / row["scene"] / "quality.jpg"
        if picture.exists():
            _smaller(picture, images / f"{row['scene']}.jpg")
            told = f"Learned, reference (denoised), {DIFFERENCE} times the difference; direct light included."
            link = f"![{row['scene']}](images/zoo/{row['scene']}.jpg)"
            shown.append(f"## {row['scene']}\n\n{link}\n\n*{told} Scene: {CREDITS.get(row['scene'], 'lightwell')}.*")
    text = f"""# The zoo: scenes that nobody tuned

What `lightwell bake SCENE` gives with default settings on {len(rows)} scenes, by `python benchmarks/zoo.py`. No scene
has settings of its own; those with a star (\\*) took no part in the choice of any constant. All but the courtyard are
the work of others and not part of lightwell: the benchmark looks for them in a folder beside the checkout and leaves
out those that are missing. Code measured: commit {", ".join(sorted({row["commit"] for row in rows}))}.

{markdown("zoo")}

PSNR: displayed indirect light, noise of the reference taken off. FLIP: the whole picture, and in brackets what direct
light alone scores. Page: FLIP of the page in a browser beside the reference that it carries, mean of its views.
Mottle: blotches on smooth lit patches. Leak: light in the darkest quarter of the surface, relative to the mean. Error:
mean relative error over all surfaces, and that of the reference itself. s: wall time of the bake on two cores. What the
noise of the reference hides has a bound; mottle that it hides, and leaks whose bounds are beyond the bar, are not part
of the figures above.

"""
    (ROOT / "docs" / "zoo.md").write_text(text + table(rows) + "\n\n" + "\n\n".join(shown) + "\n")


def _smaller(picture: Path, to: Path) -> None:
    """Keep the first views of a picture, at a size for a page."""
    with Image.open(picture) as image:
        kept = image.crop((0, 0, image.width, image.height * SHOWN_VIEWS // VIEWS))
        kept.resize((PAGE_WIDTH, kept.height * PAGE_WIDTH // kept.width), Image.LANCZOS).save(to, quality=82)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--subset", type=int, help="the first so many of the scenes that work is done with")
    parser.add_argument("--only", help="names of scenes, with commas between them")
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "lightwell-zoo")
    parser.add_argument("--quality", choices=tuple(QUALITY_SECONDS), default=DEFAULT_QUALITY)
    parser.add_argument("--field", choices=tuple(FIELD_BARS), help="bake this field in place of the default one")
    parser.add_argument("--ablation", action="store_true")
    parser.add_argument("--table", action="store_true", help="print the recorded rows of this folder")
    parser.add_argument("--publish", action="store_true", help="write results and page though scenes are left out")
    arguments = parser.parse_args()
    known = scenes()
    names = [name for name in SUBSET[: arguments.subset] if name in known] if arguments.subset else list(known)
    if arguments.only:
        names = [name for name in arguments.only.split(",") if name in known]
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.ablation:
        from zoo_ablation import ablation

        names = [name for name in names if name in SUBSET]
        publish("zoo_ablation", ablation({name: known[name] for name in names}, arguments.out), quick=False)
        return
    if arguments.table:
        suffix = f".{arguments.field}.json" if arguments.field else ".json"
        names = [name for name in names if (arguments.out / f"{name}{suffix}").exists()]
    rows = []
    for name in names:
        rows.append(run_scene(name, known[name], arguments.out, arguments.quality, arguments.field))
        print(table(rows[-1:]).splitlines()[-1], flush=True)
    print(table(rows))
    whole = arguments.publish or not (arguments.subset or arguments.only or arguments.table)
    if arguments.field:
        publish(
            f"zoo_{arguments.field.removeprefix('factored+')}",
            figures(rows, FIELD_BARS[arguments.field]),
            quick=not whole,
        )
        return
    publish("zoo", figures(rows, BARS), quick=not whole)
    if whole:
        write_page(rows, arguments.out)


if __name__ == "__main__":
    main()
