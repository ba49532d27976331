"""The progressive picture of the live page: its mean is that of the path tracer, and light follows its surfaces."""

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.cache import RadianceCache, settings_of
from lightwell.cache.live_picture import MOST, MOST_CHANGED, LivePicture
from lightwell.cache.live_samples import LightHistory, frozen_history, frozen_surfaces, samples_of
from lightwell.cache.orbit_camera import OrbitCamera
from lightwell.cache.restir import world_to_film
from lightwell.scenes.scene import Camera

from .scenes import SMALL, furnace, room, sensor

SIZE = 48


def cache_of(scene):
    cache = RadianceCache(settings_of(SMALL))
    cache.prepare(scene)
    return cache


def camera(k: float, size=SIZE):
    """A camera that moves sideways and turns, frame by frame."""
    made = sensor(size, (0.03 * k, 0.01 * k, -0.9), (0.03 * k + 0.02 * k, 0.01 * k, 1), fov=75)
    return mi.load_dict(made)


def surfaces(scene, k: float, context):
    return frozen_surfaces(SIZE, f"{k}")(scene, camera(k), context)


def light_of(surface):
    """Light that is a smooth function of the place and another one on every side."""
    return 2 + mi.Color3f(dr.sin(3 * mi.Vector3f(surface.p) + 1)) + 0.7 * mi.Color3f(surface.n)


def carried(scene, past, surface, light, film, most=MOST):
    flat = dr.ravel(light + dr.zeros(mi.Color3f, SIZE**2))
    dr.eval(flat)
    return frozen_history(SIZE)(scene, surface, flat, past, film, dr.opaque(mi.Float, most))


def test_at_rest_the_picture_becomes_that_of_the_path_tracer():
    scene = room(SIZE)
    cache, picture = cache_of(scene), LivePicture(SIZE, caching=False)
    eye = camera(0)
    for _ in range(4 * 256):
        picture.advance(scene, eye, cache, 1.0)
    assert picture.spp == 256 and not picture.advance(scene, eye, cache, 1.0)
    path = mi.load_dict({"type": "path", "max_depth": -1})
    truth = np.array(mi.render(scene, sensor=eye, integrator=path, spp=512, seed=3))[..., :3]
    found = np.array(picture.image).reshape(SIZE, SIZE, 3)
    # Denoised, so that edges differ; every pixel is in its place, and no light is lost.
    assert abs(found.mean() / truth.mean() - 1) < 0.02
    assert np.abs(found - truth).mean() < 0.03 * truth.mean()
    assert np.abs(found - truth[:, ::-1]).mean() > 0.1 * truth.mean()


def test_every_pixel_is_traced_once_in_four_frames():
    scene = room(SIZE)
    # An odd edge: squares at the border hold pixels twice.
    cache, picture = cache_of(scene), LivePicture(47, caching=False)
    eye = camera(0, 47)
    for frame in range(9):
        assert picture.spp == frame // 4
        picture.advance(scene, eye, cache, 1.0)
    assert np.isfinite(np.array(picture.image)).all() and dr.width(picture.image) == 3 * 47 * 47


def test_light_is_found_where_the_surface_was_and_nowhere_else():
    scene = room(SIZE)
    context = cache_of(scene).region.context
    before, now = surfaces(scene, 0, context), surfaces(scene, 2, context)
    film = world_to_film(camera(0)).matrix
    dark = mi.Color3f(0)
    past = carried(scene, LightHistory(SIZE**2), before, light_of(before), film)
    assert np.allclose(np.array(past.light).reshape(-1, 4)[:, 3], 1)
    # Ten frames before, so that the black frame that finds them has a weight that is known.
    for _ in range(9):
        past = carried(scene, past, before, light_of(before), film)
    found = np.array(carried(scene, past, now, dark, film).light).reshape(-1, 4)
    seen = found[:, 3] > 1
    assert 0.6 < seen.mean() < 0.97
    light = found[:, :3] * (found[:, 3:] / np.maximum(found[:, 3:] - 1, 1e-9))
    wanted = np.array(light_of(now)).T
    off = np.abs(light - wanted)[seen]
    assert off.mean() < 0.015
    assert np.abs(np.array(light_of(before)).T - wanted)[seen].mean() > 0.1
    assert not found[~seen, :3].any()


def test_after_a_change_light_of_before_soon_has_no_weight():
    scene = room(SIZE)
    context = cache_of(scene).region.context
    here, film = surfaces(scene, 0, context), world_to_film(camera(0)).matrix
    past = LightHistory(SIZE**2)
    for _ in range(20):
        past = carried(scene, past, here, mi.Color3f(1), film)
    for _ in range(4):
        past = carried(scene, past, here, mi.Color3f(0), film, MOST_CHANGED)
    left = np.array(past.light).reshape(-1, 4)[np.array(here.usable), :3]
    assert left.max() < 0.07


def test_mirrors_carry_no_light():
    scene = room(SIZE, bsdf={"type": "conductor"})
    context = cache_of(scene).region.context
    here = surfaces(scene, 0, context)
    usable = np.array(here.usable)
    assert 0.02 < (~usable).mean() < 0.4
    film = world_to_film(camera(0)).matrix
    past = carried(scene, LightHistory(SIZE**2), here, mi.Color3f(1), film)
    again = carried(scene, past, here, mi.Color3f(1), film)
    frames = np.array(again.light).reshape(-1, 4)[:, 3]
    assert np.allclose(frames[~usable], 1) and (frames[usable] > 1.9).mean() > 0.95


def test_the_light_of_a_sample_is_its_radiance_without_emission_over_albedo():
    scene = furnace(size=SIZE)
    cache, eye = cache_of(scene), camera(0)
    numbers = [dr.opaque(mi.UInt32, n) for n in (0, 0, 0, 3)]
    traced = samples_of(cache.predictor.model, SIZE, False, eye)
    found, L, light = traced(scene, eye, cache.region.context, cache.predictor.packed("ema"), *numbers)
    assert np.allclose(np.array(found.emission), 1) and np.allclose(np.array(found.white), 0.55)
    assert np.allclose(np.array(light).reshape(-1, 3) * 0.55 + 1, np.array(L).T, rtol=1e-4)
    # Radiance in a closed sphere of albedo 1/2 that emits 1: 2; means differ by 0.015 from seed to seed.
    assert abs(np.array(L).mean() - 2) < 0.06


@pytest.mark.parametrize("two_sided", [False, True])
def test_backs_of_one_sided_walls_are_looked_through(two_sided):
    # From behind the wall that the room's own camera has at its back: a rasteriser culls it.
    scene = room(SIZE, two_sided=two_sided)
    cache, picture = cache_of(scene), LivePicture(SIZE, caching=False)
    eye = mi.load_dict(sensor(SIZE, (0, 0, -3), (0, 0, 1), fov=30))
    found = frozen_surfaces(SIZE, f"outside {two_sided}")(scene, eye, cache.region.context)
    place, t = np.array(found.p).T, np.array(found.t)
    assert (np.abs(place[:, 2] + 1) < 1e-3).all() if two_sided else (place[:, 2] > -0.99).all()
    # Rays begin at the near plane.
    assert np.abs(t - np.linalg.norm(place - [0, 0, -3], axis=1)).max() < 0.02
    for _ in range(8):
        picture.advance(scene, eye, cache, 1.0)
    seen = np.array(picture.image)
    assert seen.mean() < 1e-3 if two_sided else seen.mean() > 0.05, seen.mean()


def test_a_camera_that_starts_steep_can_be_tilted_towards_the_horizon():
    camera = OrbitCamera(Camera((0.0, 2.0, 0.1), (0.0, 0.0, 0.0)), np.full(3, -1.0), np.full(3, 1.0))
    before = (camera.position - camera.target) / np.linalg.norm(camera.position - camera.target)
    for _ in range(5):
        camera.orbit(0, -0.02, 0)
    after = (camera.position - camera.target) / np.linalg.norm(camera.position - camera.target)
    assert after[1] < before[1] - 0.005
    for _ in range(50):
        camera.orbit(0, 0.02, 0)
    up = (camera.position - camera.target) / np.linalg.norm(camera.position - camera.target)
    assert up[1] < 0.9999  # not over the pole
