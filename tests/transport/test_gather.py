"""Final gather: the mean is that of full paths, the noise is less, and a wrong light map shows."""

import numpy as np
import pytest

from lightwell.fields.lightmap.sides import matte
from lightwell.fields.lightmap.trace import chart
from lightwell.fields.lightmap.views import corrected
from lightwell.scenes import load
from lightwell.scenes.default_light import under_sky
from lightwell.transport.gather import KnownIrradiance, gathered, gathered_irradiance, known_arrays, settled
from lightwell.transport.irradiance import irradiance
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
    with pytest.raises(ValueError, match="expected an even number"):
        gathered_irradiance(scene, points, known_arrays(scene, made.atlas, made.image, matte(scene)), 3, 0)


def test_gathered_irradiance_has_the_mean_of_full_paths_and_less_noise(court):
    scene, made, points, _ = court
    whole = irradiance(scene, points, 64, 1)
    known = known_arrays(scene, made.atlas, made.image, matte(scene), scattered=True)
    (a, b), direction = gathered_irradiance(scene, points, known, 64, 2)
    error = np.abs(whole.half_a - whole.half_b).mean() / np.sqrt(whole.half_a.size)
    assert mean_light(a + b) == pytest.approx(mean_light(whole.half_a + whole.half_b), rel=0.015, abs=4 * error)
    assert np.abs(a - b).mean() < 0.75 * np.abs(whole.half_a - whole.half_b).mean()
    assert np.abs(direction - whole.direction).mean() < 0.2 * np.abs(whole.direction).mean()
    brighter, _ = gathered_irradiance(scene, points, known | {"image": 2 * known["image"]}, 64, 2)
    assert mean_light(brighter) > 1.1 * mean_light(a)


def test_paths_do_not_end_at_texels_that_are_not_sure(court):
    scene, made, points, _ = court
    size = made.atlas.size
    wrong = np.full((size, size, 3), 50, np.float32)
    known = known_arrays(scene, made.atlas, wrong, matte(scene), np.ones((size, size), bool), scattered=True)
    found, _ = gathered_irradiance(scene, points, known, 16, 2)
    whole = irradiance(scene, points, 64, 1)
    assert mean_light(found) == pytest.approx(mean_light(whole.mean), rel=0.03)


def test_a_chart_of_gathered_light_is_that_of_full_paths(court):
    scene, made, _, _ = court
    found = chart(scene, 128, 0, 16, 3, atlas=made.atlas, gathers=32)
    full = chart(scene, 128, 0, 16, 3, atlas=made.atlas)
    noise = [np.abs(c.light.half_a - c.light.half_b)[made.stored].mean() for c in (found, full)]
    assert noise[0] < 0.6 * noise[1]
    assert found.image.mean() == pytest.approx(made.image.mean(), rel=0.02)
    assert (found.light.wrong <= 1).all() and np.isfinite(found.light.direction[found.stored]).all()


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
    assert settled(Material("metal", metallic=1.0, roughness=0.3), False, scattered=True)
    assert not settled(Material("mirror", metallic=1.0, roughness=0.1), False, scattered=True)
