"""Web figures: the same picture in other engines, what package and page weigh, versions of three.js, what axe finds.

    python benchmarks/web.py [--page OUT/index.html] [--quick | --last]

Runs the web tests that measure, and prints rows; ``--last`` takes what their last run found. ``--page`` is the page of
`lightwell bake courtyard`. Needs Node, a Chromium and `npm ci` in web/.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
from pathlib import Path

from lightmap_web import bundle_rows
from rows import Row, at_least, at_most, publish

ROOT = Path(__file__).parents[1]
# Decibels between pictures of two engines, displayed (sRGB, clipped); file sizes of pages in megabytes.
AGREE, VERSIONS_AGREE, PAGE_MB = 40.0, 45.0, 6.0
TESTS = ("engines", "versions", "three-ways", "accessibility", "budget")
TIMEOUT = 1800
NEEDED = "needs npm ci in web/ and a Chromium"
ENGINES = {
    "babylon left": "Babylon.js, left-handed axes",
    "babylon right": "Babylon.js, right-handed axes",
    "playcanvas": "PlayCanvas",
    "aframe": "A-Frame, with its own three.js",
}
# What needs a machine that does nothing else, or a GPU.
QUIET = [
    ("frame time over a plain light map, field of 1,000 multiply-adds, SwiftShader", 2.0, "x", "not timed yet"),
    ("first picture of the Cornell box, SwiftShader", 3.0, "s", "not timed yet"),
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
OLDER = {"three-0.182": "three.js 0.182", "three-0.184": "three.js 0.184"}
KINDS = {"webgl": "WebGLRenderer", "webgpu": "WebGPURenderer"}


def run() -> None:
    """Run the web tests that measure."""
    tests = [f"test/{name}.test.ts" for name in TESTS]
    command, everything = ["npx", "vitest", "run", *tests], {**os.environ, "LIGHTWELL_MEASURE": "1"}
    subprocess.run(command, cwd=ROOT / "web", check=False, capture_output=True, timeout=TIMEOUT, env=everything)


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
        at_most(text, bar, found.get(name), unit, "" if name in found else NEEDED)
        for name, (text, bar, unit) in FIGURES.items()
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
    parser.add_argument("--quick", action="store_true", help="a smoke run without a browser; writes nothing")
    parser.add_argument("--last", action="store_true", help="pictures of engines as the tests wrote them last")
    options = parser.parse_args()
    if not (options.quick or options.last):
        run()
    sizes = [] if options.quick else bundle_rows()
    unmeasured = [at_most(what, bar, None, unit, why) for what, bar, unit, why in QUIET]
    publish("web", [page_row(options.page), *engine_rows(), *test_rows(), *sizes, *unmeasured], options.quick)


if __name__ == "__main__":
    main()
