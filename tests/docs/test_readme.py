"""The README begins with what a reader needs in ten seconds."""

from first_screen import seen
from PIL import Image

from .snippets import ROOT, commands, snippets

README = ROOT / "README.md"
MOST_BYTES = 3_000_000


def test_the_first_screen_has_the_picture_the_sentence_and_two_commands():
    text = README.read_text()
    assert seen(text) == {"picture": True, "sentence": True, "commands": True}
    first = next(snippet for snippet in snippets(README) if snippet.language == "sh")
    assert [words[:2] for words in commands(first)] == [["lightwell", "bake"], ["lightwell", "view"]]
    pushed = text.replace("```sh", "text\n\n" * 12 + "```sh", 1)
    assert seen(pushed) == {"picture": True, "sentence": True, "commands": False}


def test_the_moving_picture_moves_and_is_small():
    path = ROOT / "docs/images/lamp.webp"
    with Image.open(path) as picture:
        assert picture.is_animated and picture.n_frames >= 24 and picture.height <= 320
    assert path.stat().st_size <= MOST_BYTES


def test_python_is_ten_lines_and_three_js_three():
    found = {snippet.language: snippet.text for snippet in snippets(README) if snippet.language in ("python", "ts")}
    assert len([line for line in found["python"].splitlines() if line]) <= 10 and len(found["ts"].splitlines()) == 3
