"""A bake of an environment map that turns: the file has the map and its range, the report the angles."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset.read import read_fields
from lightwell.asset.schema import validate
from lightwell.asset.validate import validate_file
from lightwell.baking.pipeline import bake
from lightwell.core.image_io import write_picture
from lightwell.rendering.path import render_path
from lightwell.rendering.settings import RenderSettings
from lightwell.scenes.turning import Turning
from lightwell.scenes.variables import from_json
from tests.baking.conftest import small

TURN = "environment.rotation=0..360"
SCENE = """<scene version="3.0.0">
  <sensor type="perspective"><float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0, 1, 4" target="0, 0.5, 0" up="0, 1, 0"/></transform></sensor>
  <emitter type="envmap"><string name="filename" value="map.exr"/></emitter>
  <shape type="cube"><transform name="to_world"><scale x="2" y="0.1" z="2"/></transform></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.4"/><translate y="0.5"/></transform></shape>
</scene>"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> str:
    folder = tmp_path_factory.mktemp("mapped")
    texels = np.full((16, 32, 3), 0.2, np.float32)
    texels[4:8, 2:6] = (6, 5, 4)
    write_picture(folder / "map.exr", texels)
    (folder / "scene.xml").write_text(SCENE)
    return str(folder / "scene.xml")


@pytest.fixture(scope="module")
def baked_turn(scene, tmp_path_factory) -> tuple[Path, dict]:
    out = tmp_path_factory.mktemp("turn") / "out"
    return out, bake(small(out, scene=scene, shards=1, lights_per_shard=8, steps=20, views=1, vary=(TURN,)))


def extension_of(glb: Path) -> dict:
    data = glb.read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    return document["extensions"]["LIGHTWELL_neural_radiance"]


@pytest.mark.slow
def test_the_file_has_the_map_and_the_report_its_angles(baked_turn):
    out, report = baked_turn
    assert validate_file(out) == []
    _, (entry,) = read_fields(out / "scene.glb")
    assert from_json(entry) == Turning(0, 360) and entry["intensity"] == 1
    assert entry["initial"] == pytest.approx([0, 0, -1], abs=1e-6)
    extension = extension_of(out / "scene.glb")
    # The map is behind the scene, but no light that stands still.
    assert extension["version"] == 2 and "texture" in extension["environment"]
    assert [field["role"] for field in extension["fields"]] == ["indirect"]
    assert report["sweep_axis"] == "turn of the environment, degrees"
    angles = [point["at"] for point in report["sweep"]]
    assert angles == sorted(angles) and 0 <= angles[0] < angles[-1] <= 360
    assert np.isfinite(report["relative_error"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"range": [0, 0]}, "range: expected two increasing angles"),
        ({"range": [-360, 360]}, "range: expected two increasing angles, at most 360 degrees apart"),
        ({"range": [0]}, "range: [0] is too short"),
        ({"kind": "moon"}, "kind: 'moon' is not one of"),
        ({"low": [0, 0, 0]}, "variables[0]"),
    ],
)
def test_a_wrong_entry_is_refused_with_its_place(baked_turn, changed, message):
    extension = extension_of(baked_turn[0] / "scene.glb")
    extension["variables"][0] |= changed
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        validate(extension)
    assert message in str(error.value)


@pytest.mark.slow
def test_version_one_and_a_second_map_are_refused(baked_turn):
    extension = extension_of(baked_turn[0] / "scene.glb")
    with pytest.raises(ValueError, match="variables"):
        validate(extension | {"version": 1})
    twice = [*extension["variables"], extension["variables"][0] | {"name": "other"}]
    with pytest.raises(ValueError, match="only one environment can turn"):
        validate(extension | {"variables": twice})


def test_a_picture_of_an_angle(scene, tmp_path):
    def render(out: str, *state: str) -> dict:
        return render_path(RenderSettings(scene, tmp_path / out, size=(12, 8), spp=16, vary=(TURN,), set=state))

    first = render("first.exr", "environment.rotation=0")
    again, turned = render("again.exr", "environment.rotation=360"), render("turned.exr", "environment.rotation=180")
    assert first["light"] == pytest.approx([0, 0, -1], abs=1e-6)
    assert turned["light"] == pytest.approx([0, 0, 1], abs=1e-6)
    assert first["mean_radiance"] == pytest.approx(again["mean_radiance"], rel=1e-3)
    assert abs(turned["mean_radiance"] / first["mean_radiance"] - 1) > 0.05


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"set": ("environment.rotation=90",)}, "set: 'environment.rotation' needs a map that turns; declare it"),
        ({"vary": ("environment.rotation=0..90",), "set": ("environment.rotation=200",)}, "is outside of 0..90"),
        ({"vary": (TURN,), "set": ("environment.rotation=east",)}, "is no angle in degrees; write for example"),
        ({"vary": (TURN,), "options": {"deep": 2}}, "render: --deep has no sky; leave out --deep, or environment"),
    ],
)
def test_an_angle_that_cannot_be_shown_is_one_line_with_a_cure(scene, tmp_path, options, message):
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        render_path(RenderSettings(scene, tmp_path / "x.exr", size=(4, 4), spp=1, **options))
    assert message in str(error.value)


def test_bakes_that_a_map_cannot_turn_in_are_refused(scene, tmp_path):
    with pytest.raises(ValueError, match=r"^vary: scene 'cornell.*' has no environment map that could turn; add an"):
        bake(small(tmp_path / "out", vary=(TURN,)))
    for field in ("probes", "lightmap"):
        with pytest.raises(ValueError, match=rf"^bake: field '{field}' learns no environment that turns; use --field"):
            bake(small(tmp_path / "out", scene=scene, field=field, vary=(TURN,)))
