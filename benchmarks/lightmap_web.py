"""Web figures of neural light maps: what the package weighs, what a pixel costs in headless Chromium.

    python benchmarks/lightmap_web.py [--page OUT/index.html] [--quick]

Prints rows; `neural_lightmap.py` calls ``rows`` and keeps them. ``--page`` is the page of a bake with a light map
(`lightwell bake SCENE --field lightmap`); without it the shading cost stays unmeasured. Needs Node and the web tests'
packages (`npm ci` in web/).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
from pathlib import Path

from rows import Row, at_most, publish, without_bar

ROOT = Path(__file__).parents[1]
# Bars: bytes of the runtime without three.js, and its cost over that of an ordinary light map.
LOADER_KB, SCENE_KB, COST_RATIO = 12.0, 30.0, 2.5
TIMEOUT = 900


def bundle_rows() -> list[Row]:
    """Gzipped sizes of what a page that has three.js bundles, by web/test/bundle-size.test.ts."""
    subprocess.run(
        ["npx", "vitest", "run", "test/bundle-size"],
        cwd=ROOT / "web",
        check=False,
        capture_output=True,
        timeout=TIMEOUT,
    )
    path = ROOT / "web/test-results/bundle.json"
    if not path.exists():
        return [
            at_most("npm package: loader, gzipped, without three.js", LOADER_KB, None, "kB", "needs npm ci in web/")
        ]
    sizes = {name: size["gzipped"] / 1000 for name, size in json.loads(path.read_text())["sizes"].items()}
    return [
        at_most("npm package: loader, gzipped, without three.js", LOADER_KB, sizes["loader at once"], "kB"),
        at_most("npm package: loader and scene, gzipped, without three.js", SCENE_KB, sizes["typical at once"], "kB"),
        without_bar("npm package: the same with what a field needs", sizes["typical with a field"], "kB"),
        at_most("npm package: WebGPURenderer, gzipped, without three.js", SCENE_KB, sizes["webgpu at once"], "kB"),
        without_bar("npm package: everything, gzipped, without three.js", sizes["everything"], "kB"),
        without_bar("npm package: the custom element, gzipped, without three.js", sizes["element"], "kB"),
    ]


def cost_rows(page: Path | None, rounds: int = 7) -> list[Row]:
    """Frame time of the learned light over that of the ordinary light map, same page, same run, medians."""
    what = "shading cost over the ordinary light map, headless Chromium, {}"
    if page is None or not page.exists() or not shutil.which("node"):
        return [
            at_most(what.format(name), COST_RATIO, None, "x", "needs a bake with a light map")
            for name in ("swiftshader", "llvmpipe")
        ]
    command = ["node", "tools/shading-cost.mjs", str(page.resolve()), str(rounds)]
    done = subprocess.run(
        command, cwd=ROOT, check=True, capture_output=True, text=True, timeout=TIMEOUT, env=os.environ
    )
    found = json.loads(done.stdout)
    return [
        at_most(
            what.format(name),
            COST_RATIO,
            figures["ratio"],
            "x",
            f"640x400, {figures['macs']:.0f} multiply-adds: {figures['learned_ms']:.0f} ms, light map "
            f"{figures['lightmap_ms']:.0f} ms",
        )
        for name, figures in found.items()
    ]


def page_rows(quick: bool = False) -> list[Row]:
    """The same of a page that is baked for it: what a pixel costs depends on the form of the network alone."""
    import tempfile

    from lightwell.baking.pipeline import bake
    from lightwell.baking.settings import BakeSettings
    from lightwell.fields.budget import Budget

    with tempfile.TemporaryDirectory() as folder:
        small = {"paths": 4, "shards": 1, "steps": 50, "views": 1, "view_size": (48, 30), "budget": Budget(2.0)}
        bake(BakeSettings("cornell", Path(folder), field="lightmap", options={"size": 256, "mips": 0}, **small))
        found = cost_rows(Path(folder) / "index.html", 1 if quick else 7)
    measured = [row.measured for row in found if row.measured is not None]
    note = "; ".join(f"{row.what.rsplit(', ', 1)[1]} {row.measured:.2f}" for row in found if row.measured is not None)
    what = "page: frame time over that of the ordinary light map, headless Chromium"
    return [*found, at_most(what, COST_RATIO, max(measured, default=None), "ratio", f"the slower of both: {note}")]


def rows(page: Path | None = None, quick: bool = False) -> list[Row]:
    """All web rows."""
    return bundle_rows() + cost_rows(page, 1 if quick else 7)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--page", type=Path, help="index.html of a bake with a light map")
    parser.add_argument("--quick", action="store_true", help="smoke run: one round, nothing is written")
    arguments = parser.parse_args()
    publish("neural_lightmap", rows(arguments.page, arguments.quick), arguments.quick)


if __name__ == "__main__":
    main()
