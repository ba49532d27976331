"""A bake of a day: the file has the sky, the report the hours, and a picture the light of a time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset.read import read_fields
from lightwell.asset.validate import validate_file
from lightwell.baking.pipeline import bake
from lightwell.cli import main
from lightwell.fields.registry import find_field
from lightwell.rendering.path import render_path
from lightwell.rendering.settings import RenderSettings
from lightwell.scenes.variables import from_json
from tests.baking.conftest import small

DAY = "day=2026-06-21,48.1,11.6"


@pytest.fixture(scope="module")
def baked_day(tmp_path_factory) -> tuple[Path, dict]:
    out = tmp_path_factory.mktemp("day") / "out"
    return out, bake(
        small(out, shards=1, lights_per_shard=8, steps=20, views=1, vary=(DAY,), north=180.0, turbidity=4.0)
    )


@pytest.mark.slow
def test_the_file_has_sun_and_sky_and_the_report_their_hours(baked_day):
    out, report = baked_day
    assert validate_file(out) == []
    _, (entry,) = read_fields(out / "scene.glb")
    sun = from_json(entry)
    assert (entry["name"], entry["kind"], sun.sky.turbidity) == ("day", "sun", 4)
    # North is where south was: at noon the sun stands in -Z.
    assert sun.middle[2] < 0
    assert sun.hour(np.array(entry["initial"])) == pytest.approx(12.3, abs=8)
    assert report["sweep_axis"] == "hour of the day"
    hours = [point["at"] for point in report["sweep"]]
    assert hours == sorted(hours) and 3.5 < hours[0] < hours[-1] < 21.1
    parts = [part["name"] for part in report["facts"]["times_of_day"]]
    assert "day" in parts and set(parts) <= {"twilight", "low sun", "day"}
    assert np.isfinite(report["relative_error"])
    data = (out / "scene.glb").read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert document["extensions"]["LIGHTWELL_neural_radiance"]["version"] == 2


@pytest.mark.slow
def test_a_picture_of_a_time(tmp_path):
    def render(out: str, *state: str) -> dict:
        settings = RenderSettings("cornell", tmp_path / out, size=(12, 8), spp=4, vary=(DAY,), set=state)
        return render_path(settings)

    dusk = render("dusk.exr", "day=20:30")
    assert dusk["light"][1] < 0 < dusk["mean_radiance"]
    noon, evening = render("noon.exr", "day=12:15", "light=2"), render("evening.exr", "day=19:55", "light=2")
    assert noon["light"][1] > 0.9 > 0.1 > evening["light"][1] > 0.03
    assert noon["mean_radiance"] > evening["mean_radiance"] > 10 * dusk["mean_radiance"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"set": ("day=18:30",)}, "set: 'day' needs a day; declare one with --vary day="),
        ({"vary": (DAY,), "set": ("day=23:00",)}, "set: it is night at 23:00; choose 03:"),
        ({"vary": (DAY,), "set": ("day=evening",)}, "set: 'evening' is no time of day; write for example 18:30"),
        ({"vary": (DAY,), "integrator": "vpl"}, "render: --vary is for --integrator path"),
        ({"vary": ("day=2026-12-21,80,0",)}, "choose another day or place"),
        ({"vary": (DAY,), "options": {"deep": 2}}, "render: --deep has no sky"),
    ],
)
def test_a_time_that_cannot_be_shown_is_one_line_with_a_cure(tmp_path, options, message):
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        render_path(RenderSettings("cornell", tmp_path / "x.exr", size=(4, 4), spp=1, **options))
    assert message in str(error.value)


@pytest.mark.parametrize("name", ["probes", "lightmap"])
def test_a_field_without_a_sky_refuses_a_day_before_it_prepares_the_scene(tmp_path, name, monkeypatch):
    field, message = find_field(name), f"field '{name}' learns no sky; use --field factored"
    monkeypatch.setattr(type(field), "prepare", lambda *_: pytest.fail("the scene is prepared"))
    for vary in ((DAY,), ("sun.direction=arc(90,10,270,10)", "sun.turbidity=4")):
        with pytest.raises(ValueError, match=message):
            bake(small(tmp_path / "out", field=name, vary=vary))
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_day_that_the_scene_suggests_is_refused_too(tmp_path):
    with pytest.raises(ValueError, match="field 'probes' learns no sky; use --field factored"):
        bake(small(tmp_path / "out", scene="courtyard-day", field="probes"))


def test_on_the_command_line_it_is_one_line(tmp_path, capsys):
    assert main(["bake", "cornell", "-o", str(tmp_path / "out"), "--field", "lightmap", "--vary", DAY]) == 2
    error = capsys.readouterr().err
    assert "lightmap' learns no sky; use --field factored, or drop the day" in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_of_several_lights_the_one_that_lights_nothing_is_named(tmp_path):
    # No sun reaches the rooms of the doorway.
    vary = ("light.position=box(-2.2,0.4,-1,2.2,2,1)", "sun.direction=arc(90,20,270,20)")
    with pytest.raises(ValueError, match=r"the sun 'sun' reaches .*; drop sun\.direction from --vary"):
        bake(
            small(tmp_path / "out", scene="doorway", shards=1, steps=20, lights_per_shard=8, quality="draft", vary=vary)
        )
