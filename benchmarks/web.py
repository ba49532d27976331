"""Web figures: the same picture in other engines, what the package weighs, versions of three.js, what axe finds.

    python benchmarks/web.py [--quick | --last]

Runs the web test that holds pictures of engines against each other, and prints rows; ``--last`` takes what its last run
found. Needs Node, a Chromium and `npm ci` in web/.
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
AGREE = 40.0
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


def run(test: str) -> None:
    """Run a web test for its figures.

    Args:
        test: Path of the test below web/.
    """
    command, everything = ["npx", "vitest", "run", test], {**os.environ, "LIGHTWELL_MEASURE": "1"}
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


def main() -> None:
    """Print the rows and write ``results/web.json``."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--quick", action="store_true", help="a smoke run without a browser; writes nothing")
    parser.add_argument("--last", action="store_true", help="pictures of engines as the tests wrote them last")
    options = parser.parse_args()
    if not (options.quick or options.last):
        run("test/engines.test.ts")
    sizes = [] if options.quick else bundle_rows()
    unmeasured = [at_most(what, bar, None, unit, why) for what, bar, unit, why in QUIET]
    publish("web", [*engine_rows(), *sizes, *unmeasured], options.quick)


if __name__ == "__main__":
    main()
