"""Balls that probes light, beside path tracing: where they stand, their direct light, their scores."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.baking.moved_objects import ball_in_view, ball_normals, lights_air, smoothed
from lightwell.fields.protocol import Lowered
from lightwell.graph import Builder
from lightwell.probes.trace import direct_irradiance
from lightwell.report.picture_metrics import flip_of_part
from lightwell.scenes import load
from lightwell.scenes.free_air import free_air
from lightwell.scenes.variables import declare
from lightwell.scenes.viewpoints import camera_frame, sample_cameras


@pytest.fixture(scope="module")
def cornell():
    return load("cornell")


def test_a_ball_stands_in_free_air_in_the_middle_of_a_view(cornell):
    for camera in sample_cameras(cornell, declare((), cornell), 4, 3):
        middle, radius = ball_in_view(cornell, camera)
        assert free_air(cornell).distance(middle[None])[0] > 2 * radius > 0
        assert free_air(cornell).accepts(middle[None], radius)[0]
        way = middle - np.asarray(camera.position)
        assert way @ camera_frame(camera)[2] == pytest.approx(np.linalg.norm(way))


def test_normals_of_a_ball_face_the_eye(cornell):
    camera = cornell.cameras[0]
    normals, mask = ball_normals(camera)
    assert len(normals) == mask.sum() > 2000
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-9)
    right, up, forward = camera_frame(camera)
    assert (normals @ forward < 0).all()
    rows, columns = np.nonzero(mask)
    assert np.corrcoef(normals @ right, columns)[0, 1] > 0.99 and np.corrcoef(normals @ up, rows)[0, 1] < -0.99


def test_smoothing_takes_noise_from_irradiance_and_keeps_its_shape(cornell):
    normals, _ = ball_normals(cornell.cameras[0])
    truth = np.maximum(normals @ np.array([[0.2, 0.9, 0.1]]).T, 0) + np.array([0.2, 0.4, 0.6])
    noisy = truth + 0.3 * np.random.default_rng(0).standard_normal(truth.shape)
    assert np.abs(smoothed(noisy, normals) - truth).mean() < 0.1 * np.abs(noisy - truth).mean()
    assert (smoothed(truth - 1, normals) >= 0).all()


def test_direct_light_of_a_point_light_is_that_of_the_closed_form(cornell):
    variable, light = declare((), cornell), np.array([0.3, 1.2, 0.6])
    points = np.array([[0.0, 1.7, 0.7], [0.5, 0.6, 0.9]])
    normals = (light - points) / np.linalg.norm(light - points, axis=1, keepdims=True)
    found = direct_irradiance(cornell, points, normals, variable, light, 0)
    expected = 1 / np.square(light - points).sum(axis=1)
    np.testing.assert_allclose(found, np.repeat(expected[:, None], 3, axis=1), rtol=1e-4)
    assert not direct_irradiance(cornell, points, -normals, variable, light, 0).any()
    # Behind the walls of the box there is none.
    outside = np.array([[3.0, 1.0, 0.0]])
    assert not direct_irradiance(cornell, outside, np.array([[-1.0, 0.0, 0.0]]), variable, light, 0).any()


def test_flip_of_a_part_heeds_that_part_alone():
    rng = np.random.default_rng(1)
    y = np.full((32, 32, 3), 0.4)
    f, mask = y.copy(), np.zeros((32, 32), bool)
    f[:, :16], mask[:, 24:] = rng.random((32, 16, 3)), True
    assert flip_of_part(f, y, mask) < 0.01 < 0.1 < flip_of_part(f, y, ~mask)


def test_a_graph_that_needs_a_view_lights_no_air():
    def graph(**inputs: int):
        b = Builder(position=3, **inputs)
        total = "position"
        for name in inputs:
            total = b.add(total, name)
        return b.build(radiance=total)

    assert lights_air(Lowered(graph(normal=3, light=3))) is not None
    assert lights_air(Lowered(graph(normal=3, view=3))) is None
    assert lights_air(Lowered(graph(normal=3, view=3), probes=graph(normal=3))) is not None
