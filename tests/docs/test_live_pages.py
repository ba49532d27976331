"""Baked pages on the site: the tool copies what was baked, and the list names each with its verdict."""

import importlib.util
import json

import live_pages
import pytest

from .snippets import ROOT


@pytest.fixture
def live_list():
    spec = importlib.util.spec_from_file_location("live_list", ROOT / "docs/live_list.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_list_names_each_page_with_its_verdict(live_list, tmp_path):
    (text,) = live_list.listed(tmp_path)
    assert "has no live pages" in text.astext()
    for name in ("attic", "barn"):
        (tmp_path / name).mkdir()
        report = {"verdict": f"good: {name}", "bytes": 291_800, "macs_per_pixel": 1485}
        (tmp_path / name / "report.json").write_text(json.dumps(report))
        (tmp_path / name / "index.html").write_text("<p>page</p>")
    (tmp_path / "barn/page.webp").touch()
    nodes = live_list.listed(tmp_path)
    whole = " ".join(node.astext() for node in nodes)
    assert "good: attic" in whole and "292 kB of learned light, 1,485 multiply-adds" in whole
    links = [link["refuri"] for node in nodes for link in node.findall() if link.tagname == "reference"]
    assert links == [f"../live/{name}/{page}.html" for name in ("attic", "barn") for page in ("index", "report")]
    assert whole.count("<img") == 1 and "../live/barn/page.webp" in whole


def test_scenes_of_the_zoo_link_to_their_pages(live_list, tmp_path):
    (tmp_path / "barn").mkdir()
    (tmp_path / "barn/index.html").touch()
    text = "# The zoo\n\n## attic\n\nDark.\n\n## barn\n\nBright.\n"
    link = '<a href="../live/barn/index.html">Move the lamp in it</a>'
    assert live_list.linked(text, tmp_path) == text.replace("## barn\n", f"## barn\n\n{link}\n")


def test_a_baked_folder_is_copied(tmp_path):
    (tmp_path / "made").mkdir()
    for name in (*live_pages.FILES, "notes.txt"):
        (tmp_path / "made" / name).write_text(name)
    out = live_pages.baked(str(tmp_path / "made"), "draft", tmp_path / "site")
    assert out == tmp_path / "site/made" and {path.name for path in out.iterdir()} == set(live_pages.FILES)
