"""Scenes of Mitsuba 0.x and 2.x."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from lightwell.backend import mi
from lightwell.scenes import load
from lightwell.scenes.mitsuba_document import Element
from lightwell.scenes.mitsuba_upgrade import Upgrade, snake_case

ZOO = Path(__file__).resolve().parents[3] / "shared" / "zoo" / "lajolla-vol-cbox" / "vol_cbox_teapot.xml"

OLD = """<scene version="0.5.0">
<integrator type="bdpt"><integer name="maxDepth" value="-1"/></integrator>
<sensor type="perspective"><float name="fov" value="40"/><string name="fovAxis" value="y"/>
  <transform name="toWorld"><lookAt origin="1, 2, 3" target="1, 2, 0" up="0, 1, 0"/></transform>
  <sampler type="halton"><integer name="sampleCount" value="4"/></sampler>
  <film type="ldrfilm"><integer name="width" value="20"/><integer name="height" value="10"/></film></sensor>
<bsdf type="diffuse" id="wood"><texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/>
  <string name="filterType" value="trilinear"/><string name="wrapMode" value="zero"/><float name="uscale" value="2"/>
  <float name="voffset" value="0.5"/></texture></bsdf>
<shape type="rectangle" id="floor"><transform name="toWorld"><scale value="3"/></transform><ref id="wood"/>
  <boolean name="flipNormals" value="false"/></shape>
<shape type="cube"><bsdf type="diffuse"><srgb name="reflectance" value="#ff0000"/></bsdf></shape>
<shape type="cube"><bsdf type="dielectric"><float name="intIOR" value="1.3"/><float name="extIOR" value="1"/></bsdf>
  <subsurface type="dipole"/></shape>
</scene>"""


def test_a_scene_of_0_5(tmp_path):
    PillowImage.fromarray(np.full((2, 2, 3), 200, np.uint8)).save(tmp_path / "a.png")
    (tmp_path / "old.xml").write_text(OLD)
    scene = load(tmp_path / "old.xml")
    (camera,) = scene.cameras
    np.testing.assert_allclose([camera.position, camera.target], [[1, 2, 3], [1, 2, 2]], atol=1e-6)
    assert camera.fov_y == pytest.approx(40, abs=1e-3)
    floor, red, glass = scene.meshes
    assert np.abs(floor.positions).max() == 3
    texture = scene.materials[floor.material].base_color_texture
    assert texture.wrap == ("clamp", "clamp")
    expected = np.array(
        (mi.ScalarTransform4f().scale([2, 1, 1]) @ mi.ScalarTransform4f().translate([0, 0.5, 0])).matrix
    )
    np.testing.assert_allclose(np.array(texture.transform)[:2, :2], expected[:2, :2])
    assert np.array(texture.transform)[1, 2] == pytest.approx(expected[1, 3])
    assert scene.materials[red.material].base_color == pytest.approx((1, 0, 0, 1))
    assert scene.materials[glass.material].ior == pytest.approx(1.3)
    told = " | ".join(scene.warnings)
    assert "the wrap mode 'zero' of a texture is read as 'clamp'" in told and "<subsurface>" in told
    assert "trilinear" not in told


def test_names_are_those_of_mitsuba_3():
    names = {"toWorld": "to_world", "intIOR": "int_ior", "maxDepth": "max_depth", "alpha": "alpha", "to_uv": "to_uv"}
    assert {name: snake_case(name) for name in names} == names


def test_a_medium_of_two_cross_sections():
    def color(name: str, value: str) -> Element:
        return Element("rgb", {"name": name, "value": value}, "a.xml", 1)

    medium = Element("medium", {"type": "homogeneous"}, "a.xml", 1, [color("sigma_a", "1 0 0"), color("sigma_s", "1")])
    (upgraded,) = Upgrade(lambda text: None)(medium, (0, 6))
    assert (upgraded.value("sigma_t"), upgraded.value("albedo")) == ("2 1 1", "0.5 1 1")


@pytest.mark.skipif(not ZOO.exists(), reason="the scenes of others are not here")
def test_a_scene_of_the_zoo_loads():
    scene = load(ZOO)
    assert len(scene.meshes) == 7 and len(scene.cameras) == 1
    assert any("the medium inside it is ignored" in warning for warning in scene.warnings)
