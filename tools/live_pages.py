"""Live pages for the documentation site: baked pages that a reader moves the lamp in.

    python tools/live_pages.py cornell two-rooms courtyard [--quality good]
    python tools/live_pages.py out/* demo

Each argument is a scene, which is baked, or a baked folder, which is copied, into docs/_live/live. From there
`make docs` takes them, and docs/live-pages.md lists them. Pictures need Node and a Chromium.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs/_live/live"
# What of a baked folder is published.
FILES = ("index.html", "report.html", "report.json", "scene.glb")
WIDTH = 480


def baked(source: str, quality: str, home: Path = FOLDER) -> Path:
    """Bake a scene into the folder of live pages, or copy what was baked.

    Args:
        source: Scene or baked folder.
        quality: Quality of a bake.
        home: Folder of live pages.

    Returns:
        The folder of its page.
    """
    out = home / Path(source).stem
    if (Path(source) / "report.json").is_file():
        out.mkdir(parents=True, exist_ok=True)
        for name in FILES:
            shutil.copy(Path(source) / name, out)
    else:
        command = [sys.executable, "-m", "lightwell", "bake", source, "-o", str(out), "--quality", quality]
        subprocess.run(command, check=True)
    return out


def main() -> None:
    """Bake or copy each, and make its picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sources", nargs="+", metavar="SCENE|FOLDER")
    parser.add_argument("--quality", default="good", help="of the bakes (default: %(default)s)")
    parser.add_argument("--no-pictures", action="store_true", help="the list then has names alone")
    given = parser.parse_args()
    for source in given.sources:
        folder = baked(source, given.quality)
        if not given.no_pictures:
            options = ["--state", "mode=learned&view=0&ui=0", "--window", "1280x800", "--width", str(WIDTH)]
            script = [str(ROOT / "tools/page_picture.py"), str(folder), str(folder / "page.webp"), *options]
            subprocess.run([sys.executable, *script], check=True)
        print(f"{folder}: done")


if __name__ == "__main__":
    main()
