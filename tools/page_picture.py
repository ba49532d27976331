"""The picture of a baked page in README and docs: split view, the lamp's handle, the panel.

    python tools/page_picture.py demo docs/images/page.webp

Reads FOLDER/index.html, as `make demo` writes it. Needs Node and a Chromium.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
# Quality of the encoder: text of the panel stays readable.
QUALITY = 82


def main() -> None:
    """Make the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder that `make demo` wrote")
    parser.add_argument("out", type=Path, help=".webp to write")
    parser.add_argument("--state", default="mode=split&view=0", help="what the page shows, as its address says it")
    parser.add_argument("--window", default="1280x820", help="pixels of the browser's window")
    parser.add_argument("--width", type=int, default=900, help="pixels of the picture")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        shot = Path(scratch) / "page.png"
        page = (given.folder / "index.html").resolve()
        script = ["node", str(ROOT / "tools/screenshot.mjs"), str(shot), str(page), given.state, given.window]
        subprocess.run(script, check=True)
        picture = Image.open(shot).convert("RGB")
        height = round(picture.height * given.width / picture.width)
        picture.resize((given.width, height), Image.Resampling.LANCZOS).save(
            given.out, "WEBP", quality=QUALITY, method=6
        )
    print(f"{given.out}: {given.width}x{height}, {given.out.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
