"""What a reader of the README sees without scrolling, on a screen of 1280 x 800: `python tools/first_screen.py`.

Needs markdown-it-py, Node and a Chromium.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[1]
SCREEN = "1280x800"
# What must be seen: moving picture, sentence, the two commands.
WANTED = {"picture": 'img[src$="lamp.webp"]', "sentence": "p > strong", "commands": "pre"}
# A repository page: width of the column and sizes of text as forges show them.
STYLE = """
body { margin: 24px auto; width: 830px; font: 16px/1.5 sans-serif }
h1 { font-size: 32px; border-bottom: 1px solid #ccc; padding-bottom: 10px; margin: 0 0 16px }
p, pre { margin: 0 0 16px } img { max-width: 100% } pre { padding: 16px; font-size: 14px; background: #f6f8fa }
"""


def seen(text: str) -> dict[str, bool]:
    """Lay a README out as a repository page, and look at its first screen.

    Args:
        text: Markdown; its pictures are found from the root of the repository.

    Returns:
        For each part of ``WANTED``, whether all of it is on the screen.

    Raises:
        RuntimeError: The browser failed.
    """
    html = MarkdownIt("commonmark").enable("table").render(text)
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        base = f'<!doctype html><meta charset="utf-8"><base href="{ROOT.as_uri()}/">'
        page.write_text(f"{base}<style>{STYLE}</style>{html}", encoding="utf-8")
        script = ["node", str(ROOT / "tools/first-screen.mjs"), str(page), SCREEN, *WANTED.values()]
        done = subprocess.run(script, capture_output=True, text=True, timeout=600)
    if not done.stdout:
        raise RuntimeError(f"first-screen: {done.stderr.strip()[-300:]}")
    found = {row["selector"]: row["seen"] for row in map(json.loads, done.stdout.splitlines())}
    return {name: found[selector] for name, selector in WANTED.items()}


if __name__ == "__main__":
    print(json.dumps(seen((ROOT / "README.md").read_text())))
