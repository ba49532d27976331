"""The page: the viewer with the asset and its views inside."""

import base64
import gzip
import json
import re
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset.page import PLACEHOLDER, PageView, view_json, viewer_html, write_page
from lightwell.asset.page_picture import dark_radiance
from lightwell.scenes.scene import Camera

SHELL = f"<!doctype html><head><title>viewer</title></head><body>{PLACEHOLDER}</body>"
WEB_FIXTURES = Path(__file__).parents[2] / "web/test/fixtures"
HOME = Camera((0.0, 1.0, 3.0), (0.0, 0.5, 0.0), fov_y=45)


def scripts(path) -> dict[str, str]:
    return dict(re.findall(r'<script type="[^"]*"[^>]* id="([^"]*)">(.*?)</script>', path.read_text("utf-8"), re.S))


def view(name="corner"):
    picture = np.random.default_rng(6).random((4, 5, 3)) * 2
    picture[0, 0] = [0, 1e9, -1]
    return PageView(name, HOME, (0.1, 0.2, 0.3), picture)


def unpacked(text: str) -> bytes:
    return gzip.decompress(base64.b64decode(text))


def decoded(stored) -> np.ndarray:
    """[height, width, 3] radiance of a packed reference, decoded pixel by pixel as the page does it."""
    height, width = stored["height"], stored["width"]
    high, low = np.frombuffer(unpacked(stored["reference"]), np.uint8).reshape(2, 3, height, width).astype(int)
    folded = high << 8 | low
    planes = (folded >> 1) ^ -(folded & 1)
    for plane in planes:
        for y, x in np.ndindex(height, width):
            left, above = plane[y, x - 1] if x else 0, plane[y - 1, x] if y else 0
            corner = plane[y - 1, x - 1] if x and y else 0
            plane[y, x] += sorted((left, above, left + above - corner))[1]
    green, red, blue = planes
    codes = np.stack([red + green, green, blue + green], axis=-1)
    return stored["dark"] * (2 ** (codes / 128) - 1)


def test_page_holds_everything(tmp_path):
    path = tmp_path / "index.html"
    options = {"home": HOME, "views": [view()], "exposure": 2, "viewer": SHELL, "links": {"report": "report.html"}}
    size = write_page(path, title="A & B", glb=b"\x00\xff", **options)
    assert size == path.stat().st_size
    assert "<title>A &amp; B</title>" in path.read_text() and PLACEHOLDER not in path.read_text()
    found = scripts(path)
    assert unpacked(found["lightwell-asset"]) == b"\x00\xff" and 'data-bytes="2"' in path.read_text()
    page = json.loads(found["lightwell-page"])
    assert page["home"] == {"position": [0, 1, 3], "target": [0, 0.5, 0], "up": [0, 1, 0], "fov_y": 45}
    assert page["links"] == [{"href": "report.html", "text": "report"}]
    assert page["exposure"] == 2 and page["report"] == {} and page["views"][0]["light"] == [0.1, 0.2, 0.3]


def test_a_reference_is_kept_to_a_third_of_a_per_cent(tmp_path):
    path = tmp_path / "index.html"
    write_page(path, title="", glb=b"", home=HOME, views=[view()], viewer=SHELL)
    stored = json.loads(scripts(path)["lightwell-page"])["views"][0]
    pixels = decoded(stored)
    np.testing.assert_allclose(pixels[0, 0], [0, 65504, 0], rtol=0.003)
    np.testing.assert_allclose(pixels[1:], view().reference[1:], rtol=0.0028, atol=0.0028 * stored["dark"])


def test_a_lamp_in_view_takes_no_steps_from_the_dark():
    picture = np.full((8, 8, 3), 0.02)
    dim = dark_radiance(picture)
    picture[0, :2] = 50_000
    assert dark_radiance(picture) < 0.004 and dim == pytest.approx(0.02 / 16, rel=1e-4)
    assert dark_radiance(np.zeros((2, 2, 3))) > 0


def test_the_browsers_decoder_is_tested_with_what_is_written_today():
    """``web/test/viewer-reference.test.ts`` decodes this file."""
    stored = json.loads((WEB_FIXTURES / "reference.json").read_text())
    picture = np.asarray(stored["radiance"]).reshape(stored["height"], stored["width"], 3)
    now = view_json(PageView("corner", HOME, (0.0, 0.0, 0.0), picture))
    assert {key: now[key] for key in ("width", "height", "dark")} == {
        key: stored[key] for key in ("width", "height", "dark")
    }
    assert unpacked(now["reference"]) == unpacked(stored["reference"])


def test_same_page_same_bytes(tmp_path):
    for name in ("a", "b"):
        write_page(tmp_path / name, title="t", glb=b"g", home=HOME, views=[view()], viewer=SHELL)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_hostile_names_stay_data(tmp_path):
    path = tmp_path / "index.html"
    name = "</script><script>alert(1)</script><!--\u2028"
    write_page(path, title=name, glb=b"", home=HOME, views=[view(name)], viewer=SHELL)
    text = path.read_text("utf-8")
    assert text.count("<script") == 2 and text.count("</script") == 2 and "alert(1)</script>" not in text
    assert json.loads(scripts(path)["lightwell-page"])["views"][0]["name"] == name


def test_refusals(tmp_path):
    options = {"title": "", "glb": b"", "home": HOME}
    with pytest.raises(RuntimeError, match="must contain <!--lightwell-data--> once, found 0"):
        write_page(tmp_path / "p", **options, viewer="<html>")
    with pytest.raises(ValueError, match="NaN or infinity"):
        write_page(tmp_path / "p", **options, report={"error": float("nan")}, viewer=SHELL)
    with pytest.raises(ValueError, match="exposure is 0"):
        write_page(tmp_path / "p", **options, exposure=0, viewer=SHELL)
    broken = PageView("v", HOME, (0, 0, 0), np.full((2, 2, 3), np.nan))
    with pytest.raises(ValueError, match="reference of view 'v' must be finite"):
        write_page(tmp_path / "p", **options, views=[broken], viewer=SHELL)
    assert not list(tmp_path.iterdir())


def test_the_built_viewer_takes_a_page():
    assert viewer_html().count(PLACEHOLDER) == 1
