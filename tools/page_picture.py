"""Pictures of what a bake writes, for README and docs: the page, the report, the scene in any viewer, the numbers.

    python tools/page_picture.py demo docs/images/page.webp
    python tools/page_picture.py demo docs/images/written-report.webp --what report --width 420

Reads FOLDER as `make demo` writes it. Needs Node and a Chromium.
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
    parser.add_argument("out", type=Path, help=".webp to write")
    parser.add_argument("--what", choices=WINDOWS, default="page")
    parser.add_argument("--state", default="mode=split&view=0", help="what the page shows, as its address says it")
    parser.add_argument("--window", help="pixels of the browser's window, WxH")
    parser.add_argument("--width", type=int, default=900, help="pixels of the picture")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        shot = Path(scratch) / "shot.png"
        script = _script(given.what, given.folder.resolve(), shot, given.state)
        subprocess.run(["node", *script, given.window or WINDOWS[given.what]], check=True, stdout=subprocess.DEVNULL)
        picture = Image.open(shot).convert("RGB")
    size = given.width, round(picture.height * given.width / picture.width)
    picture.resize(size, Image.Resampling.LANCZOS).save(given.out, "WEBP", quality=QUALITY, method=6)
    print(f"{given.out}: {size[0]}x{size[1]}, {given.out.stat().st_size:,} bytes")


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
    return [str(TOOLS / "screenshot.mjs"), str(shot), str(page), state if what == "page" else ""]


if __name__ == "__main__":
    main()
