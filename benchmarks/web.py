"""Web figures: the same picture in other engines, what package and page weigh, versions of three.js, what axe finds.

    python benchmarks/web.py [--page OUT/index.html] [--times] [--quick | --last]

Runs the web tests that measure, and prints rows; ``--last`` takes what their last run found. ``--page`` is the page of
`lightwell bake courtyard`. ``--times`` also times frames and the first picture of the Cornell box, which is baked for
it: for a machine that does nothing else. Needs Node, a Chromium and `npm ci` in web/.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from lightmap_web import bundle_rows
from rows import Row, at_least, at_most, publish

ROOT = Path(__file__).parents[1]
# Decibels between pictures of two engines, displayed (sRGB, clipped); file sizes of pages in megabytes.
AGREE, VERSIONS_AGREE, PAGE_MB = 40.0, 45.0, 6.0
TESTS = ("engines", "versions", "three-ways", "accessibility", "budget")
TIMEOUT = 1800
# Wall seconds of the Cornell box's bake: what a page loads depends on the form of the field alone.
BAKE_SECONDS = 30.0
NEEDED = "needs npm ci in web/ and a Chromium"
ENGINES = {
    "babylon left": "Babylon.js, left-handed axes",
    "babylon right": "Babylon.js, right-handed axes",
    "playcanvas": "PlayCanvas",
    "aframe": "A-Frame, with its own three.js",
}
# What needs a GPU.
ON_GPU = [
    ("default field at 1920x1080, Chromium with a GPU", 0.5, "ms", "no GPU on this machine"),
    ("light map at 1920x1080, Chromium with a GPU", 0.3, "ms", "no GPU on this machine"),
    ("lens at 1920x1080, Chromium with a GPU", 5.0, "ms", "no GPU on this machine"),
]


# Name of a figure in test-results/figures.json: the row's text, its bar, its unit.
FIGURES = {
    "memory grown over 50 cycles, MB": ("memory after 50 load and dispose cycles, growth of the heap", 0.5, "MB"),
    "hostile graph, ms": ("hostile graph (104 kB for 82 MB of GLSL): until it is refused", 100.0, "ms"),
    "axe on a phone": ("axe, WCAG 2.2 AA, panel and help open: violations on a phone", 0.0, ""),
    "axe on a phone on its side": ("axe: violations on a phone on its side", 0.0, ""),
    "axe on a desktop": ("axe: violations on a desktop", 0.0, ""),
}
# The same, of a machine that does nothing else.
TIMES = {
    "field over light map on swiftshader": (
        "frame time over a plain light map, field of 1,000 multiply-adds, SwiftShader",
        2.0,
        "x",
    ),
    "field over light map on llvmpipe": (
        "frame time over a plain light map, field of 1,000 multiply-adds, llvmpipe",
        2.0,
        "x",
    ),
    "first picture, s": ("first picture of the Cornell box, SwiftShader", 3.0, "s"),
}
OLDER = {"three-0.182": "three.js 0.182", "three-0.184": "three.js 0.184"}
KINDS = {"webgl": "WebGLRenderer", "webgpu": "WebGPURenderer"}


def run(names: tuple[str, ...], **environment: str) -> None:
    """Run web tests that measure.

    Args:
        names: Of the tests.
        environment: Variables for them.
    """
    command = ["npx", "vitest", "run", *(f"test/{name}.test.ts" for name in names)]
    everything = {**os.environ, "LIGHTWELL_MEASURE": "1", **environment}
    done = subprocess.run(
        command, cwd=ROOT / "web", check=False, capture_output=True, text=True, timeout=TIMEOUT, env=everything
    )
    if done.returncode:
        print(f"{' '.join(names)}: some tests failed\n{done.stdout[-2000:]}", file=sys.stderr)


def time_pages() -> None:
    """Bake the Cornell box in little time and time pages, in a process of its own each."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "lightwell", "bake", "cornell", "-o", folder, "--budget", f"{BAKE_SECONDS:g}s"]
        subprocess.run(command, check=True, capture_output=True, timeout=TIMEOUT)
        run(("times",), LIGHTWELL_FIRST_PICTURE=str(Path(folder) / "index.html"))


def engine_rows() -> list[Row]:
    """Make a row of each engine from what ``web/test/engines.test.ts`` wrote last.

    Returns:
        The rows; without a figure where it could not run.
    """
    path = ROOT / "web/test-results/engines.json"
    found = json.loads(path.read_text()) if path.exists() else {}
    note = "least of three pictures of 160x120 against three.js in headless Chromium (SwiftShader)"
    return [
        at_least(f"picture of {text} against three.js", AGREE, found.get(key), "dB", note if key in found else NEEDED)
        for key, text in ENGINES.items()
    ]


def test_rows() -> list[Row]:
    """Make rows of the figures that web tests kept last.

    Returns:
        The rows; without a figure where its test has not run.
    """
    path = ROOT / "web/test-results/figures.json"
    found = json.loads(path.read_text()) if path.exists() else {}
    rows = [
        at_most(text, bar, found.get(name), unit, "" if name in found else why)
        for figures, why in [(FIGURES, NEEDED), (TIMES, "needs --times, on a machine that does nothing else")]
        for name, (text, bar, unit) in figures.items()
    ]
    for version, kind in [(version, kind) for version in OLDER for kind in KINDS]:
        name = f"{version} on {kind}, dB"
        text = f"picture of {OLDER[version]} against the newest, {KINDS[kind]}"
        rows.append(at_least(text, VERSIONS_AGREE, found.get(name), "dB", "" if name in found else NEEDED))
    return rows


def page_row(page: Path | None) -> Row:
    """Weigh the page of a bake.

    Args:
        page: ``index.html`` of the courtyard at the defaults; None: not measured.

    Returns:
        The row, in megabytes (10⁶ bytes).
    """
    size = None if page is None else page.stat().st_size / 1e6
    return at_most("page of the courtyard", PAGE_MB, size, "MB", "one file, before the gzip of a server")


def main() -> None:
    """Print the rows and write ``results/web.json``."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--page", type=Path, help="index.html that `lightwell bake courtyard` wrote")
    parser.add_argument("--times", action="store_true", help="also times, on a machine that does nothing else")
    parser.add_argument("--quick", action="store_true", help="a smoke run without a browser; writes nothing")
    parser.add_argument("--last", action="store_true", help="pictures of engines as the tests wrote them last")
    options = parser.parse_args()
    if not (options.quick or options.last):
        run(TESTS)
    if options.times:
        time_pages()
    sizes = [] if options.quick else bundle_rows()
    unmeasured = [at_most(what, bar, None, unit, why) for what, bar, unit, why in ON_GPU]
    publish("web", [page_row(options.page), *engine_rows(), *test_rows(), *sizes, *unmeasured], options.quick)


if __name__ == "__main__":
    main()
