"""Scenes whose surfaces see no other surface, and without air of their own: they are baked, and seen from above."""

import json

import numpy as np
import pytest

from lightwell.asset.read import read_fields
from lightwell.baking.pipeline import bake
from lightwell.scenes.assemble import assemble
from lightwell.scenes.scene import Light, Material, Mesh
from tests.plain_glb import write_plain
from tests.transport.rooms import box, quad

from .conftest import small

FEW = {"shards": 1, "steps": 20, "lights_per_shard": 8, "views": 1}
LAMP = Light("point", "lamp", position=(0.0, 2.0, 0.0), intensity=10.0)
DAY = ("day=2026-06-21,48.1,11.6",)
FLOOR, SOLID = quad("floor", (-2, 0, -2), (0, 0, 4), (4, 0, 0)), box("solid", (-1, -1, -1), (1, 1, 1))
# It stands askew, so that its bounds have air.
STEEP = Mesh("steep", np.float32([(-2, 0, -2), (0, 1, 2), (2, 0, -2)]), np.uint32([[0, 1, 2]]), 0)


def alone(path, mesh, *lights):
    """Write a scene of one surface, glossy, so that a field reads what it mirrors as well."""
    grey = Material("grey", metallic=0.0, roughness=0.4)
    write_plain(path, assemble("one", [mesh], [grey], lights=lights, digest="1"))
    return str(path)


@pytest.mark.parametrize("mesh", [FLOOR, pytest.param(SOLID, marks=pytest.mark.slow)], ids=["floor", "solid"])
def test_a_surface_under_a_day_is_baked_and_seen_from_around(mesh, tmp_path):
    report = bake(small(tmp_path / "out", scene=alone(tmp_path / "one.glb", mesh), vary=DAY, **FEW))
    assert report["relative_error"] is not None and np.isfinite(report["relative_error"])
    assert (tmp_path / "out/index.html").stat().st_size > 1000
    assert json.loads((tmp_path / "out/report.json").read_text()) == report


@pytest.mark.parametrize(
    "mesh, field",
    [
        pytest.param(FLOOR, "factored", id="no air"),
        pytest.param(STEEP, "factored", id="no light", marks=pytest.mark.slow),
        pytest.param(FLOOR, "lightmap", id="map", marks=pytest.mark.slow),
    ],
)
def test_a_surface_keeps_the_light_of_its_own_lamp(mesh, field, tmp_path):
    options = {"size": 64, "mips": 0} if field == "lightmap" else {}
    scene = alone(tmp_path / "one.glb", mesh, LAMP)
    report = bake(small(tmp_path / "out", scene=scene, field=field, options=options, **FEW))
    fields, variables = read_fields(tmp_path / "out/scene.glb")
    assert [field.role for field in fields] == ["static"] and variables == []
    told = any("only its own light is baked" in text for text in report["warnings"])
    assert told == (field == "factored")


def test_a_light_that_was_asked_for_is_refused_where_nothing_reflects_it(tmp_path):
    scene = alone(tmp_path / "one.glb", STEEP, LAMP)
    vary = ("light.position=box(-1,1.5,-1,1,2,1)",)
    with pytest.raises(ValueError, match="no indirect light of 'light' reaches any sampled surface point"):
        bake(small(tmp_path / "out", scene=scene, vary=vary, **FEW))


def test_a_scene_without_light_and_air_is_refused_with_what_to_declare(tmp_path):
    scene = alone(tmp_path / "one.glb", FLOOR)
    with pytest.raises(ValueError, match=r"has neither air for a light that moves nor light of its own; declare one"):
        bake(small(tmp_path / "out", scene=scene, **FEW))
    assert not (tmp_path / "out").exists()
