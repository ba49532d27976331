"""``indirect`` against Mitsuba's ``path`` minus ``direct`` at fixed lights, and bugs that this test must see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.scenes.variables import PointLight, Sun
from lightwell.transport.interactions import interaction
from lightwell.transport.paths import CONNECTIONS
from lightwell.transport.radiance import direct, indirect, static
from lightwell.transport.reference import indirect_reference
from lightwell.transport.surface import sample_surface
from lightwell.transport.tables import tables

from . import rooms
from .zscores import Estimate, mitsubas, of_groups, ours, with_view, z_test

pytestmark = pytest.mark.gpu

# Points per test and paths per point: 0.4 M paths, a standard error of about 4 % a point, 0.7 % of all points together.
POINTS, PATHS = 48, 1 << 13
# A shorter depth than the default keeps the reference quick; both sides count it in the same way.
DEPTH = 12
LIGHT = (-0.3, 1.5, 0.4)


def point_light(position, intensity=(1.0, 1.0, 1.0)) -> dict:
    spectrum = {"type": "rgb", "value": list(intensity)}
    return {"type": "point", "position": [float(x) for x in position], "intensity": spectrum}


def uncovered(scene, points):
    """Points that are not on the floor under a box: the two faces are in one plane, and a ray may meet either."""
    p = np.array(interaction(scene, points).p).T
    floor = np.abs(p[:, 1]) < 1e-6
    boxes = [(mesh.positions.min(0), mesh.positions.max(0)) for mesh in scene.meshes[-2:]]
    under = [(p[:, [0, 2]] > low[[0, 2]]).all(1) & (p[:, [0, 2]] < high[[0, 2]]).all(1) for low, high in boxes]
    return points[~(floor & np.any(under, axis=0))]


def opaque(scene, points):
    """Points that are not on glass, whose own light is only a part of what is seen there."""
    return points[~tables(scene).transmissive[points.shape]]


def reference(scene, points, emitters: dict, seed: int = 1) -> Estimate:
    """Mitsuba's ``path`` minus ``direct``."""
    path = mitsubas(scene, points, emitters, {"type": "path", "max_depth": DEPTH}, PATHS, seed)
    # Direct light has far less variance than a path.
    return path - mitsubas(scene, points, emitters, {"type": "direct"}, PATHS // 4, seed + 100)


def estimate(scene, points, light, variable, seed: int = 7) -> Estimate:
    return ours(scene, points, light, variable, PATHS, seed, max_depth=DEPTH)


@pytest.mark.parametrize(
    "name", ["principled", *(pytest.param(n, marks=pytest.mark.slow) for n in ("cornell", "glossy"))]
)
def test_point_light(name, request, roaming):
    scene = request.getfixturevalue(name)
    points = opaque(scene, sample_surface(scene, POINTS, 11, floor=4))
    passed, text = z_test(
        estimate(scene, points, LIGHT, roaming) - reference(scene, points, {"light": point_light(LIGHT)})
    )
    assert passed, text


@pytest.mark.parametrize("connections", [1, *(pytest.param(n, marks=pytest.mark.slow) for n in (0, 2))])
def test_every_number_of_light_rays_has_the_same_mean(cornell, roaming, connections):
    points = sample_surface(cornell, POINTS, 11, floor=4)
    few = ours(cornell, points, LIGHT, roaming, PATHS, 7, max_depth=DEPTH, connections=connections)
    passed, text = z_test(few - estimate(cornell, points, LIGHT, roaming, seed=8))
    assert passed, text


def test_light_rays_find_the_spot_that_a_light_near_a_wall_makes(cornell, roaming):
    points = sample_surface(cornell, 512, 13)
    near_a_wall = (-0.85, 1.0, 0.0)
    variance = []
    for connections in (0, CONNECTIONS):
        a, b = indirect(cornell, points, near_a_wall, roaming, 64, 9, connections=connections)
        variance.append(np.mean(np.square(a - b)))
    # A factor of 3.5 was measured.
    assert variance[1] < variance[0] / 2


def test_more_paths_shrink_the_noise_of_stratified_paths(cornell, roaming):
    # A lattice whose axes depend on each other stops converging: its noise would stay the same.
    points = sample_surface(cornell, 256, 14)
    noise = []
    for paths in (64, 4096):
        a, b = indirect(cornell, points, LIGHT, roaming, paths, 3)
        noise.append(np.mean(np.square(a - b)))
    assert noise[1] < 1.5 * noise[0] * 64 / 4096


@pytest.mark.parametrize(
    "name", ["glossy", *(pytest.param(n, marks=pytest.mark.slow) for n in ("cornell", "principled"))]
)
def test_sphere_light(name, request):
    # A large sphere, so that BSDF sampling finds it often. Mitsuba's is of null material: it blocks nothing.
    scene, radius = request.getfixturevalue(name), 0.2
    variable = PointLight((-0.8, 0.2, -0.8), (0.8, 1.8, 0.8), 0.3, radius=radius)
    points = opaque(scene, uncovered(scene, sample_surface(scene, 2 * POINTS, 12, floor=4)))[:POINTS]
    sphere = {"type": "sphere", "center": list(LIGHT), "radius": radius, "bsdf": {"type": "null"}}
    sphere["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": [1 / (np.pi * radius**2)] * 3}}
    passed, text = z_test(estimate(scene, points, LIGHT, variable) - reference(scene, points, {"light": sphere}))
    assert passed, text


def test_sun(cornell):
    direction = np.float32([0.2, 0.5, 1.0]) / np.linalg.norm([0.2, 0.5, 1.0])
    variable = Sun((1, 0, 0), (0, 1, 0), (0, 0, 1))
    points = sample_surface(cornell, POINTS, 13, floor=4)
    sun = {"type": "directional", "direction": [float(-x) for x in direction], "irradiance": 1.0}
    passed, text = z_test(estimate(cornell, points, direction, variable) - reference(cornell, points, {"light": sun}))
    assert passed, text


def test_two_colored_lights_are_sums_of_white_ones(cornell, roaming):
    points = sample_surface(cornell, POINTS, 14, floor=4)
    where = [(-0.3, 1.5, 0.4), (0.5, 0.9, 0.7)]
    color = np.float32([[2.0, 0.5, 0.1], [0.1, 0.6, 1.5]])
    lights = {f"light_{k}": point_light(where[k], color[k].tolist()) for k in range(2)}
    white = [estimate(cornell, points, where[k], roaming, seed=20 + k) * color[k] for k in range(2)]
    passed, text = z_test(white[0] + white[1] - reference(cornell, points, lights))
    assert passed, text


def test_static_light(roaming):
    # The scene's own lamp: ``path`` minus what it sees at depth 1, which is the emission of the points themselves.
    lamp = rooms.quad("lamp", (-0.3, 1.98, -0.3), (0.6, 0, 0), (0, 0, 0.6))
    meshes = [*rooms.room_walls(), rooms.box("box", (-0.4, 0, -0.4), (0.2, 0.7, 0.2)), lamp]
    metal = {"type": "roughconductor", "alpha": 0.3}
    bsdfs = [rooms.diffuse(rooms.WHITE)] * 5 + [metal, rooms.diffuse((0.2, 0.2, 0.2))]
    area = {"type": "area", "radiance": {"type": "rgb", "value": [3.0, 2.0, 1.0]}}
    scene = rooms.build("lamp", meshes, bsdfs, [None] * 6 + [area])
    points = sample_surface(scene, POINTS, 21, floor=2)
    rows = np.repeat(np.arange(POINTS), 32)
    a, b = static(scene, points[rows], PATHS // 32, 22, max_depth=DEPTH)
    found = of_groups(np.stack([a, b], axis=1).reshape(POINTS, 64, 3))
    truth = mitsubas(scene, points, {}, {"type": "path", "max_depth": DEPTH}, PATHS, 23)
    passed, text = z_test(found - (truth - mitsubas(scene, points, {}, {"type": "path", "max_depth": 1}, 64, 24)))
    assert passed, text


def test_direct(glossy, roaming):
    # One sample of a point light is exact but for rounding (2e-3, through 1 / distance²). Mitsuba starts 1 mm above the
    # points, so that one in a hundred may lie on the other side of a shadow's edge.
    points = sample_surface(glossy, 256, 15)
    found = direct(glossy, points, LIGHT, roaming)
    expected = mitsubas(glossy, points, {"light": point_light(LIGHT)}, {"type": "direct"}, 2, 1, groups=2)
    same = np.isclose(found, expected.mean, rtol=2e-3, atol=1e-5).all(axis=1)
    assert same.mean() >= 0.99


@pytest.mark.parametrize("name", ["cornell", pytest.param("principled", marks=pytest.mark.slow)])
def test_the_numpy_reference(name, request, roaming):
    scene = request.getfixturevalue(name)
    points = sample_surface(scene, POINTS, 16, floor=4)
    rng = np.random.default_rng(2)
    light = rng.uniform(roaming.low, roaming.high, (POINTS, 3)).astype(np.float32)
    mean, error = indirect_reference(scene, points, light, 1 << 13, 3, max_depth=6)
    found = ours(scene, points, light, roaming, 1 << 14, 4, max_depth=6)
    passed, text = z_test(found - Estimate(mean, error**2))
    assert passed, text


# ------------------------------------------- planted bugs -------------------------------------------


@pytest.fixture(scope="module")
def fair(principled):
    """Points on the principled scene, where everything matters, and their reference."""
    points = sample_surface(principled, POINTS, 17, floor=4)
    return points, reference(principled, points, {"light": point_light(LIGHT)})


# What the planted bugs are compared with; every run has ``test_point_light`` of the same scene.
@pytest.mark.slow
def test_no_planted_bug(principled, roaming, fair):
    points, truth = fair
    passed, text = z_test(estimate(principled, points, LIGHT, roaming) - truth)
    assert passed, text


@pytest.mark.slow
def test_planted_view_sign(principled, roaming, fair):
    points, truth = fair
    assert not z_test(estimate(principled, with_view(points, -points.view), LIGHT, roaming) - truth)[0]


def test_planted_view_of_the_incoming_ray(principled, roaming, fair):
    # The mirrored view stays on the right side of the surface: only glossy materials tell.
    points, truth = fair
    si = interaction(principled, points)
    mirrored = np.array(si.to_world(mi.Vector3f(-si.wi.x, -si.wi.y, si.wi.z))).T
    assert not z_test(estimate(principled, with_view(points, mirrored), LIGHT, roaming) - truth)[0]


@pytest.mark.slow
def test_planted_light_as_direction(principled, roaming, fair):
    points, truth = fair
    towards = np.float32(LIGHT) - np.array(interaction(principled, points).p).T
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    assert not z_test(estimate(principled, points, towards, roaming) - truth)[0]


def test_planted_albedo_twice(principled, roaming, fair):
    points, truth = fair
    assert not z_test(estimate(principled, points, LIGHT, roaming) * np.float32([0.7, 0.5, 0.3]) - truth)[0]


# The smallest of the planted bugs needs the most paths to be seen.
@pytest.mark.slow
def test_planted_direct_light_in_one_of_80_paths(cornell, roaming):
    points = sample_surface(cornell, 4 * POINTS, 18)
    truth = reference(cornell, points, {"light": point_light(LIGHT)})
    fair = estimate(cornell, points, LIGHT, roaming)
    extra = direct(cornell, points, LIGHT, roaming) / 80
    assert z_test(fair - truth)[0]
    assert not z_test(replace(fair, mean=fair.mean + extra) - truth)[0]


def test_halves_are_independent(cornell, roaming):
    # Noise of the halves, and of two seeds: the correlation of n = 4096 independent pairs is within 4 / √n = 0.06.
    points = sample_surface(cornell, 1, 19)[np.zeros(4096, int)]
    a, b = indirect(cornell, points, LIGHT, roaming, 8, 1)
    c, _ = indirect(cornell, points, LIGHT, roaming, 8, 2)
    for other in (b, c):
        assert abs(np.corrcoef(a[:, 0], other[:, 0])[0, 1]) < 0.06


def with_lamps(count: int):
    """A room with small lamps close to its walls, ``count`` squares and as many points, before a bright background."""
    places = [(-0.9 + 0.25 * (k % 8), 0.3 + 0.3 * (k // 8), -0.97) for k in range(count)]
    lamps = [rooms.quad(f"lamp {k}", place, (0, 0.1, 0), (0.1, 0, 0)) for k, place in enumerate(places)]
    meshes = [*rooms.room_walls(), rooms.box("box", (-0.4, 0, -0.4), (0.2, 0.7, 0.2)), *lamps]
    plastic = {"type": "principled", "base_color": {"type": "rgb", "value": [0.7, 0.3, 0.2]}, "roughness": 0.4}
    bsdfs = [rooms.diffuse(rooms.WHITE)] * 5 + [plastic] + [rooms.diffuse((0.2, 0.2, 0.2))] * count
    area = {"type": "area", "radiance": {"type": "rgb", "value": [3.0, 2.0, 1.0]}}
    spots = [point_light((0.9, 0.2 + 0.05 * k, 0.03 * k), (0.02, 0.02, 0.02)) for k in range(count)]
    lights = {f"light_{k}": e for k, e in enumerate(spots)}
    lights["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.05, 0.06, 0.1]}}
    emitters = [mi.load_dict(e) for e in lights.values()]
    return rooms.build("lamps", meshes, bsdfs, [None] * 6 + [area] * count, emitters=emitters), lights


@pytest.mark.parametrize("count", [6, 35])
def test_many_lamps(count):
    # 13 emitters are all compared at each vertex; of 71, a part.
    scene, lights = with_lamps(count)
    points = sample_surface(scene, POINTS, 25, floor=1)
    rows = np.repeat(np.arange(len(points)), 32)
    a, b = static(scene, points[rows], PATHS // 32, 26, max_depth=DEPTH)
    found = of_groups(np.stack([a, b], axis=1).reshape(len(points), 64, 3))
    path = mitsubas(scene, points, lights, {"type": "path", "max_depth": DEPTH}, 4 * PATHS, 27)
    truth = path - mitsubas(scene, points, lights, {"type": "path", "max_depth": 1}, 64, 28)
    passed, text = z_test(found - truth)
    assert passed, text
    # A planted bug: 4 % too much.
    assert not z_test(found * 1.04 - truth)[0]
    # Mitsuba chooses any emitter, and has four times the paths.
    assert found.variance.mean() < 2 * path.variance.mean()
