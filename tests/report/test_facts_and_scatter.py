"""Charts of the facts that a field reports, and labelled points."""

import re

from lightwell.report.charts import ChartAxis, ChartSeries, line_chart
from lightwell.report.facts import facts_of
from lightwell.report.numbers import brief_amount
from lightwell.report.scatter import ScatterPoint, scatter_chart

PLAIN = ChartAxis("x", str)
LOG = ChartAxis("x", brief_amount, log=True)


def test_every_form_of_a_fact():
    found = facts_of(
        {
            "rule": "raw <i>",
            "capped": False,
            "leaves": 12,
            "step": [0, 10, 20],
            "entropy": [2.0, 1.0, 0.5],
            "share": [[0.5, 0.5], [0.4, 0.6], [0.1, 0.9]],
            "histogram": {"3": 4, "4": 8},
            "curves": {"seconds": [1, 2], "gate": [0.1, 0.2], "expert": [0.3, 0.1]},
            "nested": {"kind": "joint", "weights": [1.0, 2.0]},
            "long": [0.5] * 40,
        }
    )
    rows = dict(found.rows)
    assert rows == {"rule": "raw <i>", "capped": "no", "leaves": "12", "nested, kind": "joint"}
    html = "".join(svg for _, svg in found.charts)
    # entropy 1 line, share 2, curves 2, long 1; the histogram has 2 bars and the weights, which are no curve, 2.
    assert html.count("<polyline") == 6 and html.count('class="bar"') == 4
    empty = facts_of({})
    assert not empty.rows and not empty.charts


def test_a_lone_point_is_a_dot():
    svg = line_chart([ChartSeries("a", [1], [1], tone="tone-3")], PLAIN, PLAIN, "one")
    (points,) = re.findall(r'points="([^"]+)"', svg)
    first, second = points.split()
    assert first == second and "tone-3" in svg


def test_scatter_front_floor_and_labels():
    points = [
        ScatterPoint("a", 10, 0.5, "tone-0"),
        ScatterPoint("b", 100, 0.1, "tone-1"),
        ScatterPoint("c <", 1000, 0.2, "tone-2"),
    ]
    svg = scatter_chart(points, LOG, LOG, "title", floor=0.05)
    assert "noise floor" in svg and "c &lt;" in svg and svg.count('class="dot') == 3
    (front,) = re.findall(r'class="front" points="([^"]+)"', svg)
    # a, the corner under it, b; c is beaten by b.
    assert len(front.split()) == 3
    assert scatter_chart([ScatterPoint("free", 0, 0.1, "tone-0")], LOG, LOG, "title") == ""


def test_labels_do_not_cover_each_other():
    points = [ScatterPoint(f"field {k}", 10 + k, 0.5, f"tone-{k}") for k in range(3)]
    svg = scatter_chart(points, LOG, LOG, "title")
    places = re.findall(r'class="label small" x="([\d.]+)" y="([\d.]+)" text-anchor="(\w+)"', svg)
    assert len(set(places)) == 3


def test_round_amounts():
    # A narrow no-break space stands between a number and its unit.
    assert brief_amount(1000, "B") == "1\u202fkB" and brief_amount(300) == "300" and brief_amount(2.5e6) == "2.5\u202fM"
