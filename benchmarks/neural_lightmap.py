"""The figures of neural light maps, measured side by side on this machine.

    python benchmarks/neural_lightmap.py                        every figure; writes results/neural_lightmap.json
    python benchmarks/neural_lightmap.py --quick                a smoke run of a minute; writes nothing
    python benchmarks/neural_lightmap.py --only staircase2,leak
    python benchmarks/neural_lightmap.py --only staircase2 --ablate     prints a table of variants beside it
    python benchmarks/neural_lightmap.py --only curve --plot            draws docs/images/lightmap-curve.png

Parts: the scenes, leak, mips, vary, cycles (needs LIGHTWELL_BPY, a Python that has bpy), codecs (KTX2 needs alktx2),
subsurface, page (needs Node and Chromium), web, curve. Rows are written after every part, so that a killed run goes on
with ``--only``. Every scene is traced once; all light maps see the same atlas, the same light at texels and the same
eye samples, and are scored on the same held-out views from the graphs and pictures that they ship. PSNR is that of
x / (1 + x), then sRGB, of the pixels that the light map lights: clear glass is drawn by the rasteriser, its share is
printed, and a row counts it as black too; *corrected* takes the noise of the truth off the squared error.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from lightmap_cycles import cycles
from lightmap_parts import codecs, leak, mips, subsurface, vary
from lightmap_plot import curve
from lightmap_scenes import MEGABYTE, SCENES, scene_rows
from rows import Row, at_least, at_most, chosen, publish


def pending(quick: bool) -> list[Row]:
    """What is asked and nobody has measured yet: rows without a figure, so that they are not forgotten."""
    note = "not measured yet"
    return [
        at_most("page: frame time over that of the ordinary light map, headless Chromium", 2.5, None, "ratio", note),
        at_most("shading at 1080p on a GPU", 0.3, None, "ms", note),
    ]


def web(quick: bool) -> list[Row]:
    """What the page weighs."""
    import lightmap_web

    return [] if quick else lightmap_web.bundle_rows()


def page(quick: bool) -> list[Row]:
    """What a pixel costs in headless Chromium."""
    import lightmap_web

    return lightmap_web.page_rows(quick)


def missing(quick: bool) -> list[Row]:
    """Rows that nobody has measured yet."""
    return [*(row for name in SCENES for row in unmeasured(name)), *pending(quick)]


PARTS = {
    "leak": leak,
    "mips": mips,
    "vary": vary,
    "page": page,
    "pending": missing,
    "cycles": cycles,
    "codecs": codecs,
    "subsurface": subsurface,
    "web": web,
    "curve": curve,
}


def unmeasured(name: str) -> list[Row]:
    """The rows of a scene, empty."""
    what, note = f"{name}, default at no more than 1 MB: ", "not measured yet"
    return [
        at_least(what + "PSNR", 40, None, "dB", note),
        at_most(what + "FLIP", 0.05, None, "of 1", note),
        at_most(what + "bytes", MEGABYTE, None, "B", note),
        at_least(f"{name}: atlas coverage, padding not counted", 0.7, None, "of 1", note),
    ]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--ablate", action="store_true")
    parser.add_argument("--plot", action="store_true", help="of curve: draw it")
    parser.add_argument("--pictures", action="store_true", help="of scenes: write docs/images/lightmap-SCENE.png")
    parser.add_argument("--only", default="", help=f"parts, comma-separated: {','.join([*SCENES, *PARTS])}")
    arguments = parser.parse_args()
    parts = chosen("--only", arguments.only, [*PARTS, *SCENES])
    if arguments.quick and not arguments.only:
        SCENES["courtyard"] = "two-rooms"
        parts = ["leak", "courtyard", "subsurface"]
    for part in parts:
        if part in SCENES:
            rows = scene_rows(part, arguments.quick, arguments.ablate, arguments.pictures)
        elif part == "curve":
            rows = curve(arguments.plot)
        else:
            rows = PARTS[part](arguments.quick)
        publish("neural_lightmap", rows, arguments.quick)


if __name__ == "__main__":
    main()
