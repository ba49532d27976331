"""The README begins with what a reader needs in ten seconds."""

from PIL import Image

from .snippets import ROOT, commands, snippets

README = ROOT / "README.md"
MOST_BYTES = 3_000_000
# Lines of the first screen of a repository page at 1280 x 800, with a picture of 290 pixels in it.
FIRST_LINES = 10


def test_the_first_screen_has_the_picture_the_sentence_and_two_commands():
    head = README.read_text().splitlines()[:FIRST_LINES]
    order = [next(k for k, line in enumerate(head) if mark in line) for mark in ("lamp.webp", "**lightwell", "```sh")]
    assert order == sorted(order)
    first = next(snippet for snippet in snippets(README) if snippet.language == "sh")
    assert [words[:2] for words in commands(first)] == [["lightwell", "bake"], ["lightwell", "view"]]


def test_the_moving_picture_moves_and_is_small():
    path = ROOT / "docs/images/lamp.webp"
    with Image.open(path) as picture:
        assert picture.is_animated and picture.n_frames >= 24 and picture.height <= 320
    assert path.stat().st_size <= MOST_BYTES


def test_python_is_ten_lines_and_three_js_three():
    found = {snippet.language: snippet.text for snippet in snippets(README) if snippet.language in ("python", "ts")}
    assert len([line for line in found["python"].splitlines() if line]) <= 10 and len(found["ts"].splitlines()) == 3
