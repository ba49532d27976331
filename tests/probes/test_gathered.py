"""Light of many places of a light at once: against path tracing, and what its bases lose."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.probes.gathered import air_ends, bin_light, gathered_light, gathers
from lightwell.probes.low_rank import LowRank
from lightwell.probes.samples import ProbeSampling, sample_light
from lightwell.probes.state_light import light_of_states, points_at_once
from lightwell.probes.trace import air_light
from lightwell.scenes import load
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.turning import Turning
from lightwell.scenes.variables import declare

POINTS = np.array([[0.0, 1.0, 0.0], [-0.6, 1.5, 0.3], [0.5, 1.3, 0.6], [0.3, 1.7, -0.6], [-0.2, 0.5, 0.8]])
NUMBERS = np.arange(len(POINTS))


@pytest.fixture(scope="module")
def box():
    scene = load("cornell")
    return scene, declare((), scene)


def off(a: np.ndarray, b: np.ndarray) -> float:
    """Norm of the difference over that of the second."""
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def test_gathered_light_is_that_of_path_tracing(box):
    scene, variable = box
    lights = sample_lights(scene, variable, 4, 1)
    found = gathered_light(scene, POINTS, 2048, 3, variable=variable, lights=lights, numbers=NUMBERS)
    traced = np.stack([air_light(scene, POINTS, 1 << 14, 5, variable=variable, light=p).sh for p in lights])
    # 2 % of noise in the paths, 3 % in the rays, 3 % of blur by the bins; more beside a wall that is lit from near.
    error = [off(f, t) for f, t in zip(found.mean(axis=0).reshape(-1, 27), traced.reshape(-1, 27))]
    assert np.median(error) < 0.08 and max(error) < 0.25, error
    assert found[..., 0, :].mean() == pytest.approx(traced[..., 0, :].mean(), rel=0.06)


@pytest.mark.slow
def test_the_gathered_sky_of_a_day_is_that_of_path_tracing(box):
    scene, _ = box
    day = declare(("day=2026-06-21,48.1,11.6", "day.north=180"), scene)
    lights = np.float32([day.direction(t) for t in (0.15, 0.5, 0.85)])
    found = gathered_light(scene, POINTS, 2048, 3, variable=day, lights=lights, numbers=NUMBERS).mean(axis=0)
    traced = np.stack([air_light(scene, POINTS, 1 << 14, 5, variable=day, light=p).sh for p in lights])
    assert off(found, traced) < 0.12


def test_places_of_a_light_share_the_noise_of_their_rays(box):
    scene, variable = box
    near = np.array([[0.1, 1.2, 0.2], [0.12, 1.2, 0.2], [0.1, 1.22, 0.2]], np.float32)
    found = light_of_states(scene, POINTS, 16, 3, NUMBERS, True, variable, near).mean(axis=0)
    apart = [air_light(scene, POINTS, 16, 3 + k, variable=variable, light=p).sh for k, p in enumerate(near)]
    assert off(found[1], found[0]) < 0.5 * off(apart[1], apart[0])


def test_a_point_is_gathered_alike_alone_and_among_others(box):
    scene, variable = box
    more = {"variable": variable, "lights": sample_lights(scene, variable, 5, 2)}
    whole = gathered_light(scene, POINTS, 32, 3, numbers=NUMBERS, **more)
    alone = gathered_light(scene, POINTS[3:4], 32, 3, numbers=NUMBERS[3:4], **more)
    assert np.array_equal(whole[:, :, 3:4], alone)


def test_points_that_are_traced_in_parts_have_the_same_light(box):
    scene, variable = box
    lights = sample_lights(scene, variable, 5, 2)
    place = np.random.default_rng(0).uniform((-0.8, 0.2, -0.8), (0.8, 1.8, 0.8), (40, 3))
    # Cells of one to ten points, in no order; with so few rays, some get more.
    cell = np.random.default_rng(1).permutation(np.repeat(np.arange(6), [1, 10, 9, 8, 7, 5]))
    given = (scene, place, np.arange(40), cell, ProbeSampling(paths=16, most=4), 3, variable, lights)
    light, noise = sample_light(*given)
    # So many bytes as five points have: no cell of more than that is divided.
    found = sample_light(*given, at_once=5 * 2 * len(lights) * 27 * 4)
    assert np.array_equal(found[0], light) and np.array_equal(found[1], noise)
    assert points_at_once(lights, 5 * 2 * len(lights) * 27 * 4) == 5 and points_at_once(None, 1) == 1


def test_the_last_bin_is_dark_and_the_halves_are_independent(box):
    scene, variable = box
    light = bin_light(scene, variable, sample_lights(scene, variable, 3, 1))
    assert not light[-1].any() and light[:-1].any()
    ends = air_ends(scene, variable, POINTS, 64, 3, NUMBERS)
    assert ends.bin.max() < len(light) and not np.array_equal(ends.way[:, :32], ends.way[:, 32:])
    np.testing.assert_allclose(np.linalg.norm(ends.way, axis=2), 1, rtol=1e-5)


def test_what_turns_around_a_scene_is_path_traced():
    assert not gathers(Turning(0.0, 360.0)) and not gathers(None)


def lamps_near_walls(states: int, probes: int) -> np.ndarray:
    """[S, P, 9, 3] light of lamps on a line of probes, each very bright at the probes beside it."""
    x, y = np.linspace(0, 1, states)[:, None], np.linspace(0, 1, probes)[None]
    level = 0.2 + 0.1 * np.sin(3 * x + 2 * y) + 30 * np.exp(-1000 * (x - y) ** 2)
    shape = 1 + 0.3 * np.cos(np.arange(27) * (1 + y[..., None]))
    return (level[..., None] * shape).reshape(states, probes, 9, 3)


def test_few_bases_keep_the_light_of_probes_far_from_the_lamp():
    light = lamps_near_walls(60, 80)
    low = LowRank.of(light, np.arange(80), 8)
    found = np.einsum("pjck,sk->spjc", low.bases(light), low.factors)
    flat = light.reshape(60, -1)
    *_, vt = np.linalg.svd(flat / np.linalg.norm(flat, axis=1, keepdims=True), full_matrices=False)
    singular = (flat @ vt[:8].T @ vt[:8]).reshape(light.shape)
    size = np.linalg.norm(light, axis=(2, 3))
    error = lambda f: np.mean(np.linalg.norm(f - light, axis=(2, 3)) / size)  # noqa: E731
    assert error(found) < 0.5 * error(singular), f"{error(found):.3f}, of singular vectors {error(singular):.3f}"


def test_light_of_as_many_states_as_bases_is_kept_and_darkness_stays_dark():
    light = np.random.default_rng(0).random((5, 30, 9, 3)) + 0.1
    light[2] = 0
    low = LowRank.of(light, np.arange(30), 8)
    found = np.einsum("pjck,sk->spjc", low.bases(light), low.factors)
    np.testing.assert_allclose(found, light, atol=1e-3)


def test_bases_of_a_probe_depend_on_its_own_light_alone():
    light = lamps_near_walls(20, 30)
    low = LowRank.of(light, np.arange(30), 4)
    whole = low.bases(light)
    assert np.array_equal(whole[7:9], low.bases(light[:, 7:9]))
