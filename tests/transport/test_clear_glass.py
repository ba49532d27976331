"""Clear glass is left to the rasteriser: no sample lies on it, and pictures look through it."""

from __future__ import annotations

import pytest

from lightwell.scenes import load
from lightwell.scenes.scene import Camera
from lightwell.scenes.variables import declare
from lightwell.transport.camera import gbuffer
from lightwell.transport.seen import draw_seen
from lightwell.transport.surface import draw_surface
from lightwell.transport.tables import tables

ROOM = """<scene version="3.0.0">
  <shape type="cube" id="room"><boolean name="flip_normals" value="true"/>
    <transform name="to_world"><scale value="2"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  <shape type="rectangle" id="pane"><bsdf type="{glass}"/></shape>
</scene>"""
CAMERA = Camera(position=(0.0, 0.0, 1.5), target=(0.0, 0.0, 0.0), fov_y=30.0)


@pytest.fixture(scope="module", params=["thindielectric", "dielectric"])
def scene(request, tmp_path_factory):
    path = tmp_path_factory.mktemp(request.param) / "room.xml"
    path.write_text(ROOM.format(glass=request.param))
    return load(str(path))


def test_a_camera_looks_through_a_pane(scene):
    assert tables(scene).clear.tolist() == [False, True]
    points, mask, _ = gbuffer(scene, CAMERA, 8, 8)
    assert mask.all() and (points.shape == 0).all()


def test_no_point_is_drawn_on_glass(scene):
    assert (draw_surface(scene, 512, 0, floor=16).points.shape == 0).all()
    variable = declare((), scene)
    assert (draw_seen(scene, variable, 512, 0, floor=16).points.shape == 0).all()


def test_a_scene_of_glass_alone_is_not_empty(tmp_path):
    path = tmp_path / "pane.xml"
    path.write_text('<scene version="3.0.0"><shape type="rectangle"><bsdf type="dielectric"/></shape></scene>')
    assert not tables(load(str(path))).clear.any()
