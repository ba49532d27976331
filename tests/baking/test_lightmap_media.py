"""Subsurface light: a scene with a medium is baked with the light that left it."""

from pathlib import Path

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.fields.lightmap.media import media_meshes, volumetric
from lightwell.fields.lightmap.trace import chart
from lightwell.fields.lightmap.views import eye_samples
from lightwell.scenes import load
from lightwell.scenes.atlas import charted
from lightwell.transport.radiance import static
from lightwell.transport.surface import draw_surface

WAX = Path(__file__).resolve().parents[2] / "examples" / "subsurface.xml"


@pytest.fixture(scope="module")
def wax():
    return load(str(WAX))


def test_the_solid_with_a_medium_is_known(wax):
    assert [m.name for m, inside in zip(wax.meshes, media_meshes(wax)) if inside] == ["wax"]
    assert not media_meshes(load("two-rooms")).any()


def test_it_agrees_with_mitsubas_picture_of_the_wax(wax):
    from lightwell.transport.camera import gbuffer

    scene = mi.load_file(str(WAX), resx=24, resy=15)
    picture = np.array(mi.render(scene, spp=512, integrator=mi.load_dict({"type": "volpath", "max_depth": 128})))
    points, mask, _ = gbuffer(wax, wax.cameras[0], 24, 15)
    rows = np.flatnonzero(mask & media_meshes(wax)[points.shape])
    light = np.mean(volumetric(wax, points[rows], 512, 3), axis=0).mean()
    # Pixels on the rim show the floor in part; four fifths of the ball's pixels do not.
    expected = picture.reshape(-1, 3)[rows].mean()
    assert abs(light / expected - 1) < 0.08
    surface = np.mean(static(wax, points[rows], 64, 3), axis=0).mean()
    assert abs(surface / expected - 1) > 0.5


@pytest.mark.slow
def test_targets_hold_the_light_that_left_the_medium(wax):
    made = chart(wax, 32, 0, 4, 0)
    eyes = eye_samples(wax, made, 500, 4, 1, made.image)
    assert np.isfinite(eyes.radiance).all() and eyes.weight.max() > 0
    # Red scatters most: the wax is reddish, which no surface of this scene is.
    light = np.average(eyes.radiance, axis=0, weights=eyes.weight)
    assert light[0] > 1.5 * light[2]


def test_odd_paths_are_refused(wax):
    with pytest.raises(ValueError, match="expected an even number"):
        volumetric(wax, draw_surface(wax, 8, 0).points, 3, 0)


def test_a_solid_with_a_medium_is_written_as_opaque(wax):
    made = charted(wax, chart(wax, 32, 0, 4, 0).atlas)
    (solid,) = (mesh for mesh in made.meshes if mesh.name == "wax")
    assert made.materials[solid.material].transmission == 0
    assert wax.materials[next(m.material for m in wax.meshes if m.name == "wax")].transmission == 1
