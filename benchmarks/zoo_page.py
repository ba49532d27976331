"""Compares the page of a baked scene with the references it carries, for benchmarks/zoo.py: page.json and page.jpg.

python benchmarks/zoo_page.py FOLDER

The page is drawn by headless Chromium at each saved view, first with learned light and then with the reference. What a
browser adds to learned light is in these figures: direct light and shadows of the rasteriser, materials, exposure.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import flip_evaluator
import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
# Pixels of a view, and seconds in which a page must draw all of them on a software rasteriser.
SIZE, PATIENCE = "640x400", 300


def pictures(folder: Path, shots: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Learned and reference of each view that has both, [H, W, 3] display values in 0 to 1.

    Args:
        folder: Folder of a bake.
        shots: Folder for the screenshots.

    Raises:
        RuntimeError: The page does not draw; the message says why.
    """
    command = ["node", str(ROOT / "tools/page_views.mjs"), str(folder / "index.html"), str(shots), SIZE, f"{PATIENCE}"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(([*done.stderr.strip().splitlines(), "it said nothing"])[0][:200])
    read = lambda path: np.asarray(Image.open(path).convert("RGB"), np.float32) / 255  # noqa: E731
    learned = sorted(shots.glob("*-learned.png"))
    pairs = [(path, path.with_name(path.name.replace("learned", "reference"))) for path in learned]
    return [(read(a), read(b)) for a, b in pairs if b.exists()]


def figures(views: list[tuple[np.ndarray, np.ndarray]]) -> dict[str, Any]:
    """Mean FLIP over views, that of the worst, and PSNR in dB of all pixels."""
    if not views:
        return {"page_flip": None, "page_worst": None, "page_psnr": None}
    flips = [float(flip_evaluator.evaluate(y, x, "LDR", applyMagma=False)[1]) for x, y in views]
    square = float(np.mean([np.mean((x - y) ** 2) for x, y in views]))
    psnr = -10 * np.log10(max(square, 1e-10))
    return {"page_flip": float(np.mean(flips)), "page_worst": max(flips), "page_psnr": float(psnr)}


def compare(folder: Path) -> dict[str, Any]:
    """The figures of a bake's page; ``page`` says why it did not draw, or is empty. Writes ``page.jpg`` beside it."""
    with tempfile.TemporaryDirectory() as shots:
        try:
            views = pictures(folder, Path(shots))
        except RuntimeError as error:
            return figures([]) | {"page": str(error)}
    if views:
        strips = [np.concatenate(pair, axis=1) for pair in views]
        Image.fromarray((255 * np.concatenate(strips)).astype(np.uint8)).save(folder / "page.jpg", quality=85)
    return figures(views) | {"page": ""}


def main() -> None:
    """Compare the page of the folder that is named."""
    folder = Path(sys.argv[1])
    (folder / "page.json").write_text(json.dumps(compare(folder)))


if __name__ == "__main__":
    main()
