"""Reconstruction from thin-lens samples of a Mitsuba scene."""

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.lens import Camera, LensError
from lightwell.lens.samples import LensSamples, reconstruct
from lightwell.lens.thin_lens import trace, view

T = mi.ScalarTransform4f


@pytest.fixture(scope="module")
def scene():
    glow = {"type": "area", "radiance": {"type": "rgb", "value": [0.9, 0.4, 0.1]}}
    wall = {"type": "area", "radiance": {"type": "checkerboard", "to_uv": T().scale([14, 14, 1])}}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "sensor": {
                "type": "thinlens", "fov": 50, "fov_axis": "x", "aperture_radius": 0.08, "focus_distance": 3.0,
                "near_clip": 0.001, "to_world": T().look_at([0, 0, 0], [0, 0, 1], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 96, "height": 64, "rfilter": {"type": "box"}},
            },
            "ball": {"type": "sphere", "center": [0.15, 0.1, 1.3], "radius": 0.15, "emitter": glow},
            "wall": {
                "type": "rectangle", "emitter": wall,
                "to_world": T().translate([0, 0, 6]).scale(6).rotate([0, 1, 0], 180),
            },
        }
    )  # fmt: skip


def test_few_samples_come_near_many(scene):
    many = np.array(mi.render(scene, spp=512, seed=3))[..., :3]
    seen = view(scene)
    samples = trace(scene, 2, seed=1)
    made, report = reconstruct(samples, seen.height, seen.width, seen.camera)
    plain = np.zeros((64 * 96, 3))
    np.add.at(plain, samples.y.astype(int) * 96 + samples.x.astype(int), samples.rgb / 2)
    inner = (slice(6, -6), slice(6, -6))
    errors = [np.sqrt(np.mean((p[inner] - many[inner]) ** 2)) for p in (made[..., :3], plain.reshape(64, 96, 3))]
    assert errors[0] < 0.5 * errors[1] and report.bad == 0
    wrong = LensSamples(samples.x, samples.y, samples.rgb, samples.depth, -samples.lens)
    flipped, _ = reconstruct(wrong, seen.height, seen.width, seen.camera)
    assert np.sqrt(np.mean((flipped[..., :3][inner] - many[inner]) ** 2)) > 1.3 * errors[0], "the lens' sign matters"


def test_bad_samples_are_left_out_and_shapes_checked():
    n = 400
    rng = np.random.default_rng(0)
    x, y = rng.random((2, n)) * 20
    rgb = np.full((n, 3), 0.5)
    rgb[0] = np.nan
    samples = LensSamples(x, y, rgb, np.full(n, 3.0), np.zeros((n, 2)), rng.random(n), np.zeros((n, 2)))
    made, report = reconstruct(samples, 20, 20, Camera(focus=3.0))
    assert report.bad == 1 and np.abs(made[5:15, 5:15, :3] - 0.5).max() < 1e-3
    with pytest.raises(LensError, match="lens has shape"):
        reconstruct(LensSamples(x, y, rgb, np.full(n, 3.0), np.zeros((n, 3))), 20, 20, Camera(focus=3.0))
    with pytest.raises(LensError, match="no sample"):
        reconstruct(LensSamples(x, y, rgb, np.full(n, -3.0), np.zeros((n, 2))), 20, 20, Camera(focus=3.0))


def test_a_sensor_without_a_lens_is_refused():
    scene = mi.load_dict({"type": "scene", "sensor": {"type": "perspective"}})
    with pytest.raises(LensError, match="not a 'thinlens'"):
        view(scene)
