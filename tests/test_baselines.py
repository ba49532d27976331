"""Baselines of the literature against closed forms: virtual point lights, the irradiance cache."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.rendering import irradiance_cache as cache
from lightwell.rendering.virtual_point_lights import VplIntegrator, gather, trace_lights

# A bright rectangle under the ceiling, and a point on the floor with a tilted normal.
LOW, HIGH, COLOR = np.array([-0.5, -0.4]), np.array([1.0, 0.6]), np.array([1.0, 2.0, 0.0])
POINT, NORMAL = np.array([0.3, 0.2, 0.0]), np.array([0.2, -0.1, 1.0]) / np.sqrt(1.05)
T = mi.ScalarTransform4f


def polygon_irradiance(x, normal) -> float:
    """Irradiance at x from the rectangle with radiance 1 (Lambert 1760)."""
    corners = np.array([[LOW[0], LOW[1], 1], [HIGH[0], LOW[1], 1], [HIGH[0], HIGH[1], 1], [LOW[0], HIGH[1], 1]])
    d = corners - x
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    e = np.roll(d, -1, axis=0)
    cross = np.cross(d, e)
    length = np.linalg.norm(cross, axis=1)
    return abs(float(((np.arctan2(length, (d * e).sum(axis=1)) / length)[:, None] * cross).sum(axis=0) @ normal) / 2)


def looked(positions, normals, rings=32, sectors=96) -> cache.Records:
    """Records below the rectangle, ray by ray in closed form."""
    frames = cache.frames_of(normals)
    way = cache.directions(frames, rings, sectors, np.random.default_rng(0))
    distance = (1 - positions[:, 2])[:, None, None] / np.maximum(way[..., 2], 1e-9)
    hit = positions[:, None, None] + distance[..., None] * way
    inside = ((hit[..., :2] > LOW) & (hit[..., :2] < HIGH)).all(axis=-1) & (way[..., 2] > 1e-6)
    distance = np.where(way[..., 2] > 1e-6, distance, np.inf)
    return cache.integrate(positions, frames, inside[..., None] * COLOR, distance, 2.0)


@pytest.fixture(scope="module")
def repeated():
    """200 records of the same point."""
    return looked(np.tile(POINT, (200, 1)), np.tile(NORMAL, (200, 1)))


def test_irradiance_of_a_record(repeated):
    # 200 records with a deviation of 0.4 % each.
    np.testing.assert_allclose(repeated.irradiance.mean(axis=0), COLOR * polygon_irradiance(POINT, NORMAL), rtol=2e-3)


def test_gradients_of_a_record_are_those_of_the_closed_form(repeated):
    h = 1e-4
    slope = [(polygon_irradiance(POINT + h * e, NORMAL) - polygon_irradiance(POINT - h * e, NORMAL)) / (2 * h)
             for e in np.eye(3)]  # fmt: skip
    slope = np.array(slope) - NORMAL * (slope @ NORMAL)
    # The published formula takes the nearer of two distances at an edge: a few per cent of the slope's length.
    moving = repeated.moving.mean(axis=0)
    np.testing.assert_allclose(moving[0], slope, atol=0.04 * np.linalg.norm(slope))
    np.testing.assert_allclose(moving[1], 2 * moving[0], rtol=1e-6)
    for axis in cache.frames_of(NORMAL[None])[0, :2]:
        turned = [NORMAL * np.cos(s) + np.cross(axis, NORMAL) * np.sin(s) for s in (h, -h)]
        expected = (polygon_irradiance(POINT, turned[0]) - polygon_irradiance(POINT, turned[1])) / (2 * h)
        assert repeated.turning.mean(axis=0)[0] @ axis == pytest.approx(expected, abs=0.005)


def test_gradients_make_interpolation_more_accurate():
    grid = np.stack(np.meshgrid(np.linspace(-0.3, 0.7, 5), np.linspace(-0.3, 0.5, 5), [0.0]), axis=-1).reshape(-1, 3)
    rng = np.random.default_rng(1)
    asked = np.column_stack([rng.uniform(-0.25, 0.65, 100), rng.uniform(-0.25, 0.45, 100), np.zeros(100)])
    normal = np.tile([0.0, 0.0, 1.0], (100, 1))
    records = looked(grid, normal[: len(grid)])
    truth = np.array([polygon_irradiance(x, normal[0]) for x in asked])
    errors = []
    for gradients in (1.0, 0.0):
        plain = cache.Records(records.position, records.normal, records.irradiance, gradients * records.turning,
                              gradients * records.moving, records.radius)  # fmt: skip
        found, near = cache.interpolate(plain, asked, normal, 0.6)
        assert near.mean() > 0.95
        errors.append(np.sqrt(np.mean((found[near, 0] - truth[near]) ** 2)))
    # 0.9 % of the mean with gradients, 3.2 % without.
    assert errors[0] < 0.015 * truth.mean() and errors[0] < errors[1] / 2


def test_a_record_is_not_used_beyond_its_accuracy_nor_behind_a_corner():
    records = looked(POINT[None], np.array([[0.0, 0.0, 1.0]]))
    radius = records.radius[0]
    near, far = (POINT + np.array([share * radius, 0, 0]) for share in (0.2, 0.4))
    up, side = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    _, used = cache.interpolate(records, np.array([near, far, near]), np.array([up, up, side]), 0.3)
    assert used.tolist() == [True, False, False]


def corner(albedo=0.5):
    """A floor that a sun in the zenith lights with 1, and a wall beside it."""
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [albedo] * 3}}
    wall = T().translate([0, 0.5, -1]).scale([1, 0.5, 1])
    floor = T().rotate([1, 0, 0], -90)
    # Merged by Mitsuba 3.9, shapes of one material have no bounds, and the sun starts its light in a single point.
    return mi.load_dict(
        {
            "type": "scene",
            "floor": {"type": "rectangle", "to_world": floor, "bsdf": white},
            "wall": {"type": "rectangle", "to_world": wall, "bsdf": white},
            "sun": {"type": "directional", "direction": [0, -1, 0], "irradiance": {"type": "rgb", "value": 1.0}},
        },
        optimize=False,
    )


def seen_on_the_wall(scene, count=32):
    """Interactions on the wall, and their heights."""
    height = np.linspace(0.3, 0.9, count)
    origin = mi.Point3f(mi.Float(0), mi.Float(height.astype(np.float32)), mi.Float(0))
    return scene.ray_intersect(mi.Ray3f(origin, mi.Vector3f(0, 0, -1))), height


def test_one_bounce_of_virtual_point_lights_is_that_of_the_polygon():
    scene = corner()
    si, height = seen_on_the_wall(scene)
    lights = trace_lights(scene, 1 << 14, 3, 1)
    assert len(lights) > 2000
    found = np.array(gather(scene, si, lights, np.inf, si.is_valid()))[0]
    floor = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], float)
    expected = []
    for y in height:
        d = floor - [0, y, -1]
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        cross = np.cross(d, np.roll(d, -1, axis=0))
        length = np.linalg.norm(cross, axis=1)
        angle = np.arctan2(length, (d * np.roll(d, -1, axis=0)).sum(axis=1))
        expected.append(abs((cross * (angle / length)[:, None]).sum(axis=0)[2]) / 2)
    expected = np.array(expected) * 0.5 / np.pi * 0.5 / np.pi
    # Some 5,000 lights on the floor: 2 % of noise each, shared by all points.
    np.testing.assert_allclose(found, expected, rtol=0.1)
    assert found.mean() == pytest.approx(expected.mean(), rel=0.06)
    clamped = np.array(gather(scene, si, lights, 0.05, si.is_valid()))[0]
    assert (clamped <= found + 1e-7).all() and clamped.mean() < 0.9 * found.mean()


def furnace(albedo=0.5, size=8):
    """A camera in a closed box of one albedo that emits 1 everywhere."""
    bsdf = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [albedo] * 3}}
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
    sensor = {
        "type": "perspective",
        "fov": 60,
        "to_world": T().look_at(origin=[0.3, 0, 0], target=[0.3, 0, 1], up=[0, 1, 0]),
        "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
    }
    box = {"type": "cube", "flip_normals": True, "bsdf": bsdf, "emitter": emitter}
    return mi.load_dict({"type": "scene", "sensor": sensor, "box": box})


def test_furnace():
    # Radiance E / (1 - ρ) = 2, of which 1.5 is emitted or direct.
    scene = furnace()
    vpl = VplIntegrator()
    vpl.paths, vpl.clamp = 512, np.inf
    picture = np.array(mi.render(scene, integrator=vpl, spp=4, seed=1))
    # Near lights make single pixels bright: the median is under the mean, which 6,000 lights bring to a few per cent.
    assert picture.mean() == pytest.approx(2, rel=0.05)
    ward = cache.IrradianceCacheIntegrator()
    picture = np.array(mi.render(scene, integrator=ward, spp=4, seed=1))
    assert picture.mean() == pytest.approx(2, rel=0.03) and ward.records is not None and len(ward.records) >= 1
    np.testing.assert_allclose(picture, 2, rtol=0.15)


def test_both_are_plugins_of_mitsuba():
    from lightwell.rendering import irradiance_cache, virtual_point_lights

    for module, name in ((virtual_point_lights, "lightwell_vpl"), (irradiance_cache, "lightwell_irradiance_cache")):
        module.register()
        assert mi.load_dict({"type": name, "max_depth": 5}).longest == 5
    assert dr.isfinite(mi.load_dict({"type": "lightwell_vpl", "clamp": 7.0}).clamp)
