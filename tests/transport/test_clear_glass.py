"""Clear glass: pictures look through it, and its own samples hold what it reflects."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.scenes import load
from lightwell.scenes.scene import Camera
from lightwell.scenes.variables import declare
from lightwell.transport.camera import gbuffer
from lightwell.transport.queries import make_query
from lightwell.transport.radiance import static
from lightwell.transport.seen import draw_seen
from lightwell.transport.surface import draw_surface
from lightwell.transport.tables import tables

ROOM = """<scene version="3.0.0">
  <shape type="cube" id="room"><boolean name="flip_normals" value="true"/>
    <transform name="to_world"><scale value="2"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  <shape type="rectangle" id="pane"><bsdf type="{glass}"/></shape>
</scene>"""
UNDER_SKY = """<scene version="3.0.0">
  <shape type="rectangle">
    <bsdf type="thindielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf></shape>
  <shape type="sphere"><point name="center" x="0" y="0" z="-50"/>
    <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  <emitter type="constant"><rgb name="radiance" value="1"/></emitter>
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


def test_points_are_drawn_on_glass_too(scene):
    assert np.count_nonzero(draw_surface(scene, 512, 0, floor=16).points.shape == 1) >= 16
    variable = declare((), scene)
    assert np.count_nonzero(draw_seen(scene, variable, 512, 0, floor=16).points.shape == 1) >= 16


def test_a_pane_under_the_sky_shines_by_what_it_reflects(tmp_path):
    # Under a sky of radiance 1 a pane shows the sky in every direction; its own light is the share that it reflects.
    path = tmp_path / "pane.xml"
    path.write_text(UNDER_SKY)
    scene = load(str(path))
    points = draw_surface(scene, 512, 0, floor=256, is_open=True).points
    points = points[np.flatnonzero(points.shape == 0)]
    a, b = static(scene, points, 256, 1)
    cosine = np.abs(make_query(scene, points, np.zeros(3, np.float32)).normal @ [0, 0, 1] * points.view[:, 2])
    sine2 = (1 - cosine**2) / 1.5**2
    inside = np.sqrt(1 - sine2)
    s, p = (cosine - 1.5 * inside) / (cosine + 1.5 * inside), (1.5 * cosine - inside) / (1.5 * cosine + inside)
    once = 0.5 * (s**2 + p**2)
    # Of both faces together, with light that goes to and fro between them.
    expected = 2 * once / (1 + once)
    found = 0.5 * (a + b)[:, 0]
    assert found.mean() == pytest.approx(expected.mean(), rel=0.03)
    np.testing.assert_allclose(found, expected, atol=0.15)


def test_a_scene_of_glass_alone_is_not_empty(tmp_path):
    path = tmp_path / "pane.xml"
    path.write_text('<scene version="3.0.0"><shape type="rectangle"><bsdf type="dielectric"/></shape></scene>')
    assert not tables(load(str(path))).clear.any()


def test_a_camera_looks_through_frosted_glass_and_light_does_not_pass_it_straight(tmp_path):
    path = tmp_path / "room.xml"
    path.write_text(ROOM.format(glass="roughdielectric"))
    scene = load(str(path))
    points, mask, _ = gbuffer(scene, CAMERA, 8, 8)
    assert mask.all() and (points.shape == 0).all() and not tables(scene).clear.any()
