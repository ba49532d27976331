"""The main job: everything that it promises to write is there, valid, and says what was computed."""

import json
import math
import re

import numpy as np
import pytest

from lightwell.asset.exposure import declared_exposure
from lightwell.asset.read import read_fields
from lightwell.baking.information import describe
from lightwell.baking.pipeline import bake
from lightwell.baking.side_by_side import comparison, table
from lightwell.fields.base import query_inputs
from lightwell.graph import evaluate
from lightwell.scenes.variables import declare
from lightwell.transport import draw_surface, make_query
from lightwell.transport.seen_shards import PATHS_OF_EACH, RAYS

from .conftest import small

REPORT_KEYS = {
    "relative_error",
    "psnr_db",
    "ssim",
    "flip",
    "bytes",
    "macs_per_pixel",
    "seconds",
    "paths",
    "paths_per_second",
    "versions",
    "seed",
    "noise_floor",
    "energy_ratio",
}


def test_all_files_are_written_and_nothing_else(baked):
    out, _ = baked
    assert sorted(p.name for p in out.iterdir()) == ["index.html", "report.html", "report.json", "scene.glb"]


def test_the_report_has_its_keys(baked):
    out, report = baked
    assert json.loads((out / "report.json").read_text()) == report
    assert REPORT_KEYS <= set(report)
    assert {"trace", "train"} <= set(report["seconds"])
    assert all(math.isfinite(report[key]) for key in ("relative_error", "psnr_db", "ssim", "flip"))
    # The rays that all shards gather from, and the paths of the samples of three shards: two for each of `--paths`.
    own = report["settings"]["paths_per_sample"]
    assert own == PATHS_OF_EACH * 8 and report["paths"] == 8192 * RAYS + 3 * 32 * 128 * own


def test_the_asset_holds_the_field(baked):
    out, report = baked
    fields, variables = read_fields(out / "scene.glb")
    assert [field.role for field in fields] == ["indirect"]
    assert variables[0]["kind"] == "point"
    assert sum(field.graph.nbytes for field in fields) == report["bytes"]
    from lightwell.scenes import load

    scene = load("cornell")
    points = draw_surface(scene, 64, 1, floor=0).points
    query = make_query(scene, points, np.asarray(variables[0]["initial"], np.float32))
    radiance = evaluate(fields[0].graph, query_inputs(query))["radiance"]
    assert np.isfinite(radiance).all() and (radiance >= 0).all() and radiance.max() > 0


def test_the_page_is_self_contained(baked):
    text = (baked[0] / "index.html").read_text()
    assert 'id="lightwell-asset"' in text and 'id="lightwell-page"' in text
    assert "<!--lightwell-data-->" not in text


def test_the_file_declares_the_exposure_of_its_page(baked):
    text = (baked[0] / "index.html").read_text()
    page = json.loads(re.search(r'id="lightwell-page">(.*?)</script>', text, re.S)[1])
    assert page["exposure"] == declared_exposure(baked[0] / "scene.glb") > 0


# ``test_resume.test_interrupted_by_the_keyboard`` asks for the same bytes of a second bake, too.
@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(baked, tmp_path):
    bake(small(tmp_path / "again"))
    assert (tmp_path / "again/scene.glb").read_bytes() == (baked[0] / "scene.glb").read_bytes()


@pytest.mark.slow
def test_another_seed_gives_another_field(baked, tmp_path):
    bake(small(tmp_path / "other", seed=1, views=1))
    assert (tmp_path / "other/scene.glb").read_bytes() != (baked[0] / "scene.glb").read_bytes()


# ``test_late_failures`` bakes with a declared sun, too.
@pytest.mark.slow
@pytest.mark.parametrize(
    "vary",
    ["sun.direction=arc(100,20,260,20)", "light.position=box(-0.5,0.5,-0.5,0.5,1.5,0.5)"],
)
def test_declared_variables_reach_the_asset(tmp_path, vary):
    bake(small(tmp_path / "out", vary=(vary,), views=1, steps=10, shards=1))
    (variable,) = read_fields(tmp_path / "out/scene.glb")[1]
    from lightwell.scenes import load

    assert variable["kind"] == declare([vary], load("cornell")).kind


def test_compare_puts_reports_side_by_side(baked):
    rows = comparison([baked[0], baked[0]])
    assert len(rows) == 2 and rows[0]["relative_error"] == baked[1]["relative_error"]
    assert len(table(rows).splitlines()) == 3


def test_info_tells_what_is_inside(baked):
    facts = describe(str(baked[0]))
    assert facts["macs_per_pixel"] == baked[1]["macs_per_pixel"]
    assert describe("two-rooms")["triangles"] > 0
