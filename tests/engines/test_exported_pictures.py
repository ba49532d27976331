"""three.js, Babylon.js and PlayCanvas draw an exported light map as lightwell's own runtime draws the file."""

import pytest
from exported_pictures import Frame, pictures, psnr, write_diffuse

from lightwell.baking.pipeline import bake
from lightwell.baking.settings import BakeSettings
from lightwell.engines import export_engine
from lightwell.scenes import load

# Decibels of diffuse light.
AGREE = 40


@pytest.mark.slow
def test_engines_draw_the_exported_light_map(tmp_path):
    out, plain = tmp_path / "out", tmp_path / "plain.glb"
    bake(BakeSettings(scene="cornell", out=out, field="lightmap", quality="draft", views=1))
    write_diffuse(out / "scene.glb", plain)
    folders = {engine: tmp_path / engine for engine in ("threejs", "babylon", "playcanvas")}
    for engine, folder in folders.items():
        export_engine(out, engine, folder)
    camera = load("cornell").cameras[0]
    frame = Frame(tuple(map(float, camera.position)), tuple(map(float, camera.target)), fov=float(camera.fov_y))
    drawn = pictures(plain, folders, frame, tmp_path)
    assert drawn["page"].std() > 20
    assert {engine: psnr(drawn[engine], drawn["page"]) > AGREE for engine in folders} == dict.fromkeys(folders, True)
