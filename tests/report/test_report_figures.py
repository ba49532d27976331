"""Figures and charts: fixed scales, right places, round ticks."""

import base64
import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from lightwell.report import ViewComparison, charts, figures, numbers
from lightwell.report.records import ViewPicture


def pixels(uri: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))))


def test_log_difference_of_known_values():
    y = np.full((2, 2, 3), 0.99)
    f = y + 0.0999
    np.testing.assert_allclose(figures.log_difference(f, y), np.log10(0.1))
    np.testing.assert_allclose(figures.log_difference(y, y), np.log10(1e-4 / 1.0))


def test_colour_map_runs_from_dark_to_light():
    colours = figures.colour_map(np.linspace(0, 1, 256)) / 255
    luminance = colours @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance) >= -1e-9).all() and luminance[0] < 0.01 and luminance[-1] > 0.95
    assert figures.colour_map(np.array([-1.0, 2.0])).tolist() == [list(figures.INFERNO[0]), list(figures.INFERNO[-1])]


def test_the_colour_scale_does_not_depend_on_the_picture():
    y = np.full((2, 2, 3), 0.99)
    alone = figures.difference(y + 0.0999, y)[0, 0]
    y = np.full((2, 2, 3), 0.99)
    f = y + 0.0999
    f[1] += 5
    assert (figures.difference(f, y)[0, 0] == alone).all()


def test_view_pictures(data):
    view = data.views[0]
    pictures = figures.view_pictures(view, 1.0)
    assert list(pictures) == ["prediction", "reference", "difference", "regions"]
    assert all(pixels(picture).shape == (40, 32, 3) for picture in pictures.values())
    regions = pixels(pictures["regions"])
    assert len({tuple(c) for c in regions[20, [0, 8, 24]]}) == 3
    assert (regions[:, 16:24] == 255).all(axis=-1).mean() == pytest.approx(1 / figures.HATCH)


def test_pictures_show_the_enlarged_view_with_its_exposure(data):
    large = ViewPicture(np.full((120, 96, 3), 2.0), np.full((120, 96, 3), 4.0))
    view = replace(data.views[0], picture=large)
    pictures = {name: pixels(uri) for name, uri in figures.view_pictures(view, 4.0).items()}
    assert all(picture.shape == (120, 96, 3) for picture in pictures.values())
    # JPEG rounds by a code or two.
    for name, value in (("prediction", 0.5), ("reference", 1.0)):
        assert np.abs(pictures[name].astype(int) - figures.shown(np.full(3, value))).max() <= 2


def test_a_place_is_shown_in_a_frame_with_its_surroundings():
    y = np.ones((64, 96, 3))
    f = y.copy()
    f[16:32, 80:96] = 4
    view = ViewComparison("hall", f, y, y)
    place = pixels(figures.place_pictures(view, 1.0, 16, 80, 16)["prediction"]).astype(int)
    times = figures.ENLARGEMENT
    assert place.shape == (64 * times, 64 * times, 3)
    # The tile lies at the right edge of the picture, so that its surroundings are to the left of it.
    middle = place[24 * times, 56 * times]
    assert np.abs(middle - figures.shown(np.full(3, 4.0))).max() <= 3
    framed = figures.framed(np.full((40, 40, 3), 90, np.uint8), 10, 12, 16)
    assert (framed[8:10, 12:28] == 255).all() and (framed[10:26, 28:30] == 255).all() and (framed[18, 20] == 90).all()


def test_tiny_pictures_have_places():
    y = np.ones((5, 7, 3))
    view = ViewComparison("tiny", y, y, y)
    assert pixels(figures.place_pictures(view, 1.0, 0, 0, 16)["reference"]).shape[:2] == (10, 10)
    figures.view_pictures(view, 1.0)


@pytest.mark.parametrize(
    "low, high, log, expected",
    [
        (0, 1, False, [0, 0.2, 0.4, 0.6, 0.8, 1]),
        (0, 0.066, False, [0, 0.02, 0.04, 0.06]),
        (0.01, 1, True, [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1]),
        (1, 1e6, True, [1, 10, 100, 1e3, 1e4, 1e5, 1e6]),
    ],
)
def test_ticks(low, high, log, expected):
    np.testing.assert_allclose(charts.ticks(low, high, log), expected)


def test_line_chart_places_points():
    x, y = charts.ChartAxis("x", numbers.brief), charts.ChartAxis("y", numbers.brief_percent, log=True)
    svg = charts.line_chart([charts.ChartSeries("<a>", [0, 1], [0.1, 0.2])], x, y, "a & b")
    right = charts.WIDTH - charts.RIGHT
    assert f'points="{charts.LEFT}.0,' in svg and f" {right}.0," in svg and "a &amp; b" in svg


def test_charts_of_odd_data():
    x, y = charts.ChartAxis("x", numbers.brief, log=True), charts.ChartAxis("y", numbers.brief, log=True)
    assert charts.line_chart([charts.ChartSeries("a", [], [])], x, y, "") == ""
    assert charts.line_chart([charts.ChartSeries("a", [0, -1], [0, 1])], x, y, "") == ""
    assert "polyline" in charts.line_chart([charts.ChartSeries("a", [2], [3])], x, y, "")
    linear = charts.ChartAxis("x", numbers.brief)
    assert "polyline" in charts.line_chart([charts.ChartSeries("a", [0, 0], [0, 0])], linear, linear, "")
    assert charts.bar_chart([], numbers.percent, "") == ""
    assert "n…" in charts.bar_chart([("n" * 99, 0.0, 0.0)], numbers.percent, "")


@pytest.mark.parametrize(
    "text, expected",
    [
        (numbers.percent(0.03142), "3.14 %"),
        (numbers.percent(None), "–"),
        (numbers.percent(0), "0 %"),
        (numbers.percent(12.5), "1 250 %"),
        (numbers.amount(412_300, "B"), "412 kB"),
        (numbers.amount(999), "999"),
        (numbers.amount(1.25e9), "1.25 G"),
        (numbers.amount(12.34, "B"), "12.3 B"),
        (numbers.amount(None), "–"),
        (numbers.duration(0.32), "320 ms"),
        (numbers.duration(12.5), "12.5 s"),
        (numbers.duration(250), "4 min 10 s"),
        (numbers.duration(7384), "2 h 03 min"),
        (numbers.grouped(1234567), "1 234 567"),
        (numbers.brief_percent(0.02), "2 %"),
        (numbers.digits(0.0000123), "0.000012"),
    ],
)
def test_numbers(text, expected):
    assert text.replace("\u202f", " ") == expected
