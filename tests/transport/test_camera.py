"""G-buffers, truth images and pictures agree with each other and with the camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lightwell.transport.camera import gbuffer, reference_image, total_image
from lightwell.transport.queries import frames

from . import rooms

LIGHT = (0.0, 1.6, 0.2)


def test_gbuffer_points_project_to_their_pixels(cornell):
    camera, width, height = cornell.cameras[0], 40, 24
    points, mask, emission = gbuffer(cornell, camera, width, height)
    position = frames(cornell, points[np.flatnonzero(mask)])[0]
    # The camera looks along -Z: x to the right, y up, vertical field of view 36 degrees.
    offset = position - np.float32(camera.position)
    half = np.tan(np.radians(18))
    x = (offset[:, 0] / -offset[:, 2] / half * height / width + 1) / 2 * width
    y = (1 - offset[:, 1] / -offset[:, 2] / half) / 2 * height
    pixel = np.flatnonzero(mask)
    np.testing.assert_allclose(x, pixel % width + 0.5, atol=1e-3)  # a thousandth of a pixel: rounding
    np.testing.assert_allclose(y, pixel // width + 0.5, atol=1e-3)
    assert 0.2 < mask.mean() < 1 and not emission.any()


def test_gbuffer_emission():
    scene = rooms.furnace(0.5, emission=3.0)
    camera = rooms.Camera((0, 0, 0.5), (0, 0, -1))
    _, mask, emission = gbuffer(scene, camera, 8, 8, seed=1)
    assert mask.all() and (emission == 3).all()


def test_cut_away_surfaces_are_looked_through():
    mask = {"type": "mask", "opacity": 0.0, "bsdf": {"type": "diffuse"}}
    curtain = rooms.quad("curtain", (-1, 0, 0.9), (2, 0, 0), (0, 2, 0))
    scene = rooms.build("curtain", [*rooms.room_walls(), curtain], [rooms.diffuse(rooms.WHITE)] * 5 + [mask])
    points, mask, _ = gbuffer(scene, rooms.Camera((0, 1, 3), (0, 1, 0), fov_y=20), 8, 8)
    assert mask.all() and (points.shape == 2).all()


@pytest.mark.parametrize("double_sided", [False, True])
def test_backs_of_one_sided_walls_are_looked_through(double_sided, roaming):
    # A closed room from outside: rasterisers cull the near wall, which lets no light in all the same.
    front = rooms.quad("front", (-1, 0, 1), (0, 2, 0), (2, 0, 0))
    scene = rooms.build("doll's house", [*rooms.room_walls(), front], [rooms.diffuse(rooms.WHITE)] * 6)
    scene.materials[0] = replace(scene.materials[0], double_sided=double_sided)
    camera = rooms.Camera((0, 1, 3), (0, 1, 0), fov_y=20)
    points, mask, _ = gbuffer(scene, camera, 8, 8)
    assert mask.all() and (points.shape == (5 if double_sided else 2)).all()
    lit = total_image(scene, camera, LIGHT, roaming, 8, 8, 64).mean()
    assert lit < 1e-9 if double_sided else lit > 0.01


def test_pictures_agree(cornell, roaming):
    # Pixel centres with 2 x 64 paths against an antialiased picture: means within 2 % (noise 0.5 %, edges 1 %).
    camera = cornell.cameras[0]
    truth = reference_image(cornell, camera, LIGHT, roaming, 48, 48, 128)
    total = total_image(cornell, camera, LIGHT, roaming, 48, 48, 128, intensity=2.0, color=(1.0, 0.5, 0.25))
    indirect = 0.5 * (truth["indirect_a"] + truth["indirect_b"])
    expected = (truth["direct"] + indirect) * np.float32([2.0, 1.0, 0.5]) + truth["emission"]
    np.testing.assert_allclose(total.mean(axis=(0, 1)), expected.mean(axis=(0, 1)), rtol=0.02)
    assert total.dtype == np.float32 and truth["mask"].shape == (48, 48)
    # Red light comes from the left wall, green from the right.
    assert indirect[:, :12, 0].sum() > 1.5 * indirect[:, :12, 1].sum()
    assert indirect[:, -12:, 1].sum() > 1.5 * indirect[:, -12:, 0].sum()


def test_static_light_of_the_picture():
    # A camera in a furnace of albedo 1/2 sees 1 / (1 - ρ) = 2 everywhere; 4096 paths a mean: 1 %, taken 3 times.
    scene = rooms.furnace(0.5)
    from lightwell.scenes.variables import PointLight

    variable = PointLight((-0.5,) * 3, (0.5,) * 3, 0.1)
    image = total_image(
        scene, rooms.Camera((0, 0, 0.5), (0, 0, -1)), (0, 0, 0), variable, 16, 16, 64, intensity=0, with_static=True
    )
    assert image.mean() == pytest.approx(2, rel=0.03)
