"""The page of a comparison: complete, self-contained, escaped; segments, seams and facts shown where there are any."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from lightwell.report import summary
from lightwell.report.compare_html import ComparedField, write_comparison

SETTINGS = {"samples": 1000, "budget_seconds": 60.0, "fixed_steps": None}
VOID = {"meta", "link", "img", "br"}


class Balance(HTMLParser):
    """Fails on tags that do not nest; collects what the page refers to."""

    def __init__(self):
        super().__init__()
        self.open, self.links, self.tags = [], [], set()

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        self.links += [value for name, value in attributes if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"</{tag}> closes nothing"


@pytest.fixture
def fields(data) -> list[ComparedField]:
    """One field with segments and facts, and one network that is closer to the truth."""
    facts = {
        "leaves": 17,
        "gate_entropy": [2.0, 1.5, 1.0],
        "share": [[0.5, 0.5], [0.4, 0.6]],
        "depth": {"3": 5, "4": 2},
    }
    experts = replace(data, field="experts", facts=facts, compressed_bytes=100_000, parameters=60_000)
    exact = [replace(v, prediction=v.reference * 1.01, regions=None, blend=None) for v in data.views]
    points = replace(data.points, prediction=0.5 * (data.points.half_a + data.points.half_b))
    network = replace(data, field="mlp", points=points, views=exact, bytes=10_000, macs_per_pixel=500)
    return [
        ComparedField("experts:report", "experts-report", experts, summary(experts), 200),
        ComparedField("mlp", "mlp", network, summary(network), 100),
    ]


@pytest.fixture
def written(tmp_path, fields):
    numbers = write_comparison(tmp_path / "out", fields, {"bad <b>": "loss is nan"}, SETTINGS)
    return numbers, (tmp_path / "out/compare.html").read_text("utf-8"), tmp_path / "out"


@pytest.mark.slow
def test_page_is_accessible_and_fits_a_phone(written, accessible):
    assert accessible(written[2] / "compare.html")


def test_json_holds_every_field(written):
    numbers, _, out = written
    assert json.loads((out / "compare.json").read_text("utf-8")) == numbers
    experts, network = numbers["fields"]
    assert experts["segments"] == 4 and network["segments"] is None
    assert experts["border_ratio"] == pytest.approx(1.0, abs=0.2) and network["border_ratio"] is None
    assert experts["train_seconds"] == 20 and experts["facts"]["leaves"] == 17
    assert numbers["failed"] == {"bad <b>": "loss is nan"}


def test_the_page_is_self_contained_and_nests(written):
    _, page, _ = written
    checker = Balance()
    checker.feed(page)
    assert not checker.open and "script" not in checker.tags
    pages = {f"{f}/{p}.html" for f in ("mlp", "experts-report") for p in ("index", "report")}
    assert set(checker.links) - {"data:,"} == pages
    assert "bad &lt;b&gt;" in page and "<b>" not in page.replace("&lt;b&gt;", "")


def test_every_picture_is_stored_once(written, fields):
    _, page, _ = written
    names = re.findall(r"\.([a-z]+-[\d-]+) \{ background-image", page)
    assert len(names) == len(set(names))
    views = range(len(fields[0].data.views))
    wanted = {f"reference-{v}" for v in views} | {
        f"{p}-{k}-{v}" for p in ("prediction", "difference") for k in (0, 1) for v in views
    }
    assert set(names) == wanted | {"regions-0-0"}
    assert all(f'"picture {name}"' in page for name in wanted)


def test_what_the_page_says(written):
    _, page, _ = written
    assert "one network, no segments" in page and "Seams" in page and "noise floor" in page
    for chart in ("Error over size", "Error over multiply-adds", "Error over training time", "along the sweep"):
        assert chart in page
    assert "gate entropy" in page and "leaves" in page
    # The best comes first.
    assert page.index('mlp/report.html">mlp') < page.index('experts-report/report.html">experts:report')


def test_black_where_there_is_no_surface():
    from lightwell.report.figures import region_colours

    pixels = region_colours(np.array([[-1, 0], [1, 2]]))
    assert not pixels[0, 0].any() and pixels[0, 1].any()
