"""The README begins with what a reader needs in ten seconds."""

import json
import subprocess

from markdown_it import MarkdownIt
from PIL import Image

from .snippets import ROOT, commands, snippets

README = ROOT / "README.md"
MOST_BYTES = 3_000_000
# A repository page: width of the column and sizes of text as forges show them.
STYLE = """
body { margin: 24px auto; width: 830px; font: 16px/1.5 sans-serif }
h1 { font-size: 32px; border-bottom: 1px solid #ccc; padding-bottom: 10px; margin: 0 0 16px }
p, pre { margin: 0 0 16px } img { max-width: 100% } pre { padding: 16px; font-size: 14px; background: #f6f8fa }
"""


def _look(folder, text):
    """Where picture, sentence and commands of a README end on a screen of 1280 x 800."""
    html = MarkdownIt("commonmark").enable("table").render(text)
    page = folder / "page.html"
    page.write_text(f'<!doctype html><meta charset="utf-8"><base href="{ROOT.as_uri()}/"><style>{STYLE}</style>{html}')
    script = ["node", "tools/first-screen.mjs", str(page), "1280x800", 'img[src$="lamp.webp"]', "p > strong", "pre"]
    done = subprocess.run(script, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.stdout, done.stderr
    return {row["selector"]: row["seen"] for row in map(json.loads, done.stdout.splitlines())}


def test_the_first_screen_has_the_picture_the_sentence_and_two_commands(tmp_path):
    text = README.read_text()
    seen = _look(tmp_path, text)
    assert len(seen) == 3 and all(seen.values())
    first = next(snippet for snippet in snippets(README) if snippet.language == "sh")
    assert [words[:2] for words in commands(first)] == [["lightwell", "bake"], ["lightwell", "view"]]
    pushed = text.replace("```sh", "text\n\n" * 12 + "```sh", 1)
    assert [name for name, here in _look(tmp_path, pushed).items() if not here] == ["pre"]


def test_the_moving_picture_moves_and_is_small():
    path = ROOT / "docs/images/lamp.webp"
    with Image.open(path) as picture:
        assert picture.is_animated and picture.n_frames >= 24 and picture.height <= 320
    assert path.stat().st_size <= MOST_BYTES


def test_python_is_ten_lines_and_three_js_three():
    found = {snippet.language: snippet.text for snippet in snippets(README) if snippet.language in ("python", "ts")}
    assert len([line for line in found["python"].splitlines() if line]) <= 10 and len(found["ts"].splitlines()) == 3
