"""Averages of denoised frames: reprojection against known light, limits of the average, error and flicker."""

from dataclasses import replace

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, settings_of
from lightwell.cache.temporal import Surfaces, TemporalHistory, clamped, film_of, first_surfaces, reprojected

from .scenes import SMALL, room, sensor

SIZE = 48


def camera(k: float):
    """A camera that moves sideways and turns, frame by frame."""
    made = sensor(SIZE, (0.03 * k, 0.01 * k, -0.9), (0.03 * k + 0.02 * k, 0.01 * k, 1), fov=75)
    return mi.load_dict(made)


def surfaces(scene, k: float) -> Surfaces:
    return first_surfaces(scene, camera(k), np.full((SIZE, SIZE, 3), 0.5))


def light_at(s: Surfaces) -> np.ndarray:
    """Light that is a smooth function of the place and another one on every side."""
    return 2 + np.sin(3 * s.p + 1) + 0.7 * s.n


def test_light_is_found_where_the_surface_was_and_nowhere_else():
    scene = room(SIZE)
    before, now = surfaces(scene, 0), surfaces(scene, 2)
    history = TemporalHistory(4)
    history.accumulate(light_at(before) * before.albedo, before, film_of(camera(0)))
    found, count = reprojected(history.past, now)
    seen = count > 0
    # Most is seen, the edge of the film and what the ball hid are not.
    assert 0.6 < seen.mean() < 0.97
    off = np.abs(found - light_at(now))[seen]
    # Between pixels the light is interpolated; at edges only those of the four are read that show the surface.
    assert off.mean() < 0.01 and off.max() < 0.3
    # The place in the frame before matters: read without motion, the light is another one.
    assert np.abs(light_at(before) - light_at(now))[seen].mean() > 0.1
    assert not found[~seen].any()


def test_an_average_covers_a_limited_number_of_frames():
    scene, values = room(SIZE), np.array([1.0, 2.0, 4.0, 8.0, 3.0])
    left = np.broadcast_to(np.arange(SIZE) < SIZE // 2, (SIZE, SIZE))
    rest, history = replace(surfaces(scene, 0), usable=left), TemporalHistory(3)
    # Bright and dark pixels everywhere widen the range, so that nothing is clamped; the others are tested.
    place = np.add(*np.mgrid[:SIZE, :SIZE] * np.array([3, 1]).reshape(2, 1, 1)) % 7
    noise = 100.0 * (place == 0) - 100.0 * (place == 3)
    expected = 0.0
    for k, value in enumerate(values):
        picture = np.repeat((value + noise)[..., None], 3, axis=-1)
        found = history.accumulate(picture, rest, film_of(camera(0)))
        expected += (value - expected) / min(k + 1, 3)
        # Films are projected in single precision: pixels are read with a weight of 1e-4 off.
        assert np.allclose(found[left & (noise == 0)], expected, atol=0.05)
    assert np.allclose(found[~left], picture[~left])


def test_earlier_light_is_clamped_to_the_light_around():
    light, usable = np.full((9, 9, 3), 2.0), np.ones((9, 9), bool)
    light[4, 4], light[0, 0], usable[0, 0] = 3.0, 100.0, False
    found = clamped(np.full((9, 9, 3), 50.0), light, usable)
    assert np.allclose(found[2:7, 2:7], 3) and np.allclose(found[8, 8], 2) and np.allclose(found[0, 0], 2)
    assert not clamped(light, light, np.zeros((9, 9), bool)).any()


def test_a_history_is_restored_from_its_arrays():
    scene = room(SIZE)
    one, other = TemporalHistory(4), TemporalHistory(4)
    one.accumulate(np.ones((SIZE, SIZE, 3)), surfaces(scene, 0), film_of(camera(0)))
    other.restore(one.arrays())
    pictures = [
        h.accumulate(np.full((SIZE, SIZE, 3), 2.0), surfaces(scene, 1), film_of(camera(1))) for h in (one, other)
    ]
    assert np.array_equal(*pictures)
    other.restore({})
    assert other.past is None and not other.arrays()


def test_averaged_frames_of_a_moving_camera_have_less_error_and_flicker():
    scene, path = room(SIZE), mi.load_dict({"type": "path", "max_depth": -1})
    options = {**SMALL, "mode": "frames", "denoise": True, "termination_c": "inf"}
    errors: dict[int, list[np.ndarray]] = {1: [], 8: []}
    sides = {most: NrcIntegrator(settings=settings_of({**options, "denoise_frames": most})) for most in errors}
    for k in range(7):
        reference = np.array(mi.render(scene, sensor=camera(k), integrator=path, spp=256, seed=500 + k))
        for most, nrc in sides.items():
            picture = np.array(mi.render(scene, sensor=camera(k), integrator=nrc, spp=2, seed=k))
            errors[most].append((picture - reference) / (reference + 0.1 * reference.mean()))
    late = {most: np.array(each[3:]) for most, each in errors.items()}
    error = {most: np.mean(each**2) for most, each in late.items()}
    flicker = {most: np.mean(np.diff(each, axis=0) ** 2) for most, each in late.items()}
    assert np.allclose(errors[1][0], errors[8][0], atol=1e-4)  # the first frame has no history
    assert error[8] < 0.95 * error[1] and flicker[8] < 0.75 * flicker[1]


def test_a_change_of_the_scene_begins_anew_and_stills_are_refused():
    scene = room(SIZE)
    nrc = NrcIntegrator(settings=settings_of({**SMALL, "mode": "frames", "denoise": True, "denoise_frames": 4}))
    mi.render(scene, integrator=nrc, spp=1)
    assert nrc.temporal.past is not None
    nrc.scene_changed("camera")
    assert nrc.temporal.past is not None
    nrc.scene_changed("light")
    assert nrc.temporal.past is None
    for wrong in ({"denoise": False}, {"denoise": True, "mode": "still"}):
        with pytest.raises(ValueError, match="denoise_frames averages denoised frames; set denoise=true"):
            settings_of({"denoise_frames": 4, **wrong})
