"""Pictures of what a bake writes, for README and docs: the page, the report, the scene in any viewer, the numbers.

    python tools/page_picture.py demo docs/images/page.webp
    python tools/page_picture.py demo docs/images --what all

Reads FOLDER as `make demo` writes it. `all` makes every picture that README and docs show. Needs Node and a Chromium.
"""

from __future__ import annotations

import argparse
import html
import json
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

TOOLS = Path(__file__).parent
# Quality of the encoder: text of the panel stays readable.
QUALITY = 82
# Widths of the large picture of the page, and of those in README's table.
WIDE, NARROW = 900, 420
# What the page shows, and where the report is scrolled to, as addresses say it.
# The lamp's place is that of no bake: each chooses its own first one.
STATES = {"page": "mode=split&view=1&lights=-0.7,2.35,0.1", "report": "#first-learned"}
# Pixels of the browser's window for each kind of picture; the page is cut off above its frame times.
WINDOWS = {"page": "1000x560", "report": "1000x640", "scene": "1000x640", "numbers": "620x397"}
# Figures of report.json that its picture shows.
SHOWN = (
    "version",
    "scene",
    "field",
    "relative_error",
    "noise_floor",
    "energy_ratio",
    "psnr_db",
    "ssim",
    "flip",
    "bytes",
)
NUMBERS = """<!doctype html><meta charset="utf-8"><body style="margin: 0; background: #16181d; color: #d6deeb">
<pre style="margin: 28px; font: 19px/1.65 monospace">{}</pre>"""


def main() -> None:
    """Make the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder that `make demo` wrote")
    parser.add_argument("out", type=Path, help=".webp to write; with --what all a folder")
    parser.add_argument("--what", choices=(*WINDOWS, "all"), default="page")
    parser.add_argument("--state", help="what the page shows, as its address says it")
    parser.add_argument("--window", help="pixels of the browser's window, WxH")
    parser.add_argument("--width", type=int, default=900, help="pixels of the picture")
    given = parser.parse_args()
    folder = given.folder.resolve()
    if given.what != "all":
        photograph(folder, given.out, given.what, given.width, given.state, given.window)
        return
    large = given.out / "page.webp"
    photograph(folder, large, "page", WIDE)
    write(Image.open(large).convert("RGB"), given.out / "written-page.webp", NARROW)
    for what in ("report", "scene", "numbers"):
        photograph(folder, given.out / f"written-{what}.webp", what, NARROW)


def photograph(
    folder: Path, out: Path, what: str, width: int, state: str | None = None, window: str | None = None
) -> None:
    """Make one picture.

    Args:
        folder: Baked folder.
        out: .webp to write.
        what: A key of ``WINDOWS``.
        width: Pixels of the picture.
        state: What the page shows; None: as in ``STATES``.
        window: Pixels of the browser's window, WxH; None: as in ``WINDOWS``.
    """
    with tempfile.TemporaryDirectory() as scratch:
        shot = Path(scratch) / "shot.png"
        script = _script(what, folder, shot, STATES.get(what, "") if state is None else state)
        subprocess.run(["node", *script, window or WINDOWS[what]], check=True, stdout=subprocess.DEVNULL)
        picture = Image.open(shot).convert("RGB")
    write(picture, out, width)


def write(picture: Image.Image, out: Path, width: int) -> None:
    """Scale a picture down and write it.

    Args:
        picture: The picture.
        out: .webp to write.
        width: Its width, pixels.
    """
    size = width, round(picture.height * width / picture.width)
    picture.resize(size, Image.Resampling.LANCZOS).save(out, "WEBP", quality=QUALITY, method=6)
    print(f"{out}: {size[0]}x{size[1]}, {out.stat().st_size:,} bytes")


def _script(what: str, folder: Path, shot: Path, state: str) -> list[str]:
    """The words after ``node`` but the last one, the size of the window."""
    if what == "scene":
        return [str(TOOLS / "plain-viewer.mjs"), str(shot), str(folder / "scene.glb")]
    page = folder / ("index.html" if what == "page" else "report.html")
    if what == "numbers":
        numbers = json.loads((folder / "report.json").read_text())
        lines = json.dumps({name: numbers[name] for name in SHOWN}, indent=1)
        page = shot.with_name("numbers-report.html")
        page.write_text(NUMBERS.format(html.escape(lines.replace("\n}", ",\n …"))), encoding="utf-8")
    return [str(TOOLS / "screenshot.mjs"), str(shot), str(page), state]


if __name__ == "__main__":
    main()
