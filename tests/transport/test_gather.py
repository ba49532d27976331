"""Final gather: the mean is that of full paths, the noise is less, and a wrong light map shows."""

import numpy as np
import pytest

from lightwell.fields.lightmap.sides import matte
from lightwell.fields.lightmap.trace import chart
from lightwell.fields.lightmap.views import corrected
from lightwell.scenes import load
from lightwell.scenes.default_light import under_sky
from lightwell.transport.gather import KnownIrradiance, gathered, settled
from lightwell.transport.radiance import static
from lightwell.transport.surface import draw_surface


@pytest.fixture(scope="module")
def court():
    scene = under_sky(load("cornell"))
    made = chart(scene, 128, 0, 64, 0)
    points = draw_surface(scene, 1500, 4).points
    return scene, made, points, np.mean(static(scene, points, 256, 1), axis=0)


def mean_light(pair) -> float:
    return float(np.nanmean(pair))


def test_the_mean_is_that_of_full_paths(court):
    scene, made, points, truth = court
    known = KnownIrradiance.of(scene, made.atlas, made.image, matte(scene))
    light, _ = gathered(scene, points, known, 32, 2)
    assert mean_light(light) == pytest.approx(mean_light(truth), rel=0.02)


def test_the_control_variate_takes_noise_away_and_no_light(court):
    scene, made, points, truth = court
    known = KnownIrradiance.of(scene, made.atlas, made.image, matte(scene))
    raw, _ = gathered(scene, points, known, 16, 2)
    calm = corrected(scene, made.atlas, points, made.image, 16, 2)
    noise = lambda pair: float(np.abs(pair[0] - pair[1]).mean())  # noqa: E731
    assert noise(calm) < 0.5 * noise(raw)
    assert mean_light(calm) == pytest.approx(mean_light(truth), rel=0.03)


def test_a_light_map_that_is_too_bright_is_seen(court):
    scene, made, points, truth = court
    known = KnownIrradiance.of(scene, made.atlas, 2 * made.image, matte(scene))
    light, _ = gathered(scene, points, known, 16, 2)
    assert mean_light(light) > 1.05 * mean_light(truth)


def test_odd_paths_are_refused(court):
    scene, made, points, _ = court
    known = KnownIrradiance.of(scene, made.atlas, made.image, matte(scene))
    with pytest.raises(ValueError, match="expected an even number"):
        gathered(scene, points, known, 3, 0)


def test_paths_do_not_end_on_glass_mirrors_and_blended_surfaces():
    from lightwell.scenes.scene import Material

    wall = Material("wall", metallic=0.0, roughness=0.9)
    assert settled(wall, False)
    for change in (
        {"transmission": 1.0},
        {"delta": True},
        {"alpha_mode": "BLEND"},
        {"roughness": 0.1},
        {"metallic": 1.0},
    ):
        assert not settled(Material(**{"name": "x", "metallic": 0.0, "roughness": 0.9} | change), False)
