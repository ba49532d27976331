"""Lights and cameras: in free air, evenly spread, the same for the same seed."""

import numpy as np
import pytest
from built_scenes import built
from scipy.spatial import ConvexHull, Delaunay
from scipy.stats import chi2

from lightwell.scenes.assemble import assemble
from lightwell.scenes.builtin import NAMES
from lightwell.scenes.builtin.shapes import box, move, sphere
from lightwell.scenes.free_air import even_directions, free_air, is_closed, triangle_distance
from lightwell.scenes.placing import free_cells, held_out_lights, initial_light, sample_cameras, sample_lights
from lightwell.scenes.scene import Camera, Material, Mesh
from lightwell.scenes.variables import PointLight, default_variable, sun_arc
from lightwell.scenes.viewpoints import view_directions


@pytest.fixture(scope="module")
def scenes():
    return {name: built(name) for name in NAMES}


def record(name, part, material=0):
    return Mesh(name, part.positions.astype(np.float32), part.indices.astype(np.uint32), material)


def world(*parts, double_sided=False):
    """An untextured scene of the given parts."""
    meshes = [record(f"part{k}", part) for k, part in enumerate(parts)]
    return assemble("test", meshes, [Material("grey", metallic=0.0, double_sided=double_sided)], digest="0")


def brute_distance(scene, points):
    corners = np.concatenate([m.positions[m.indices] for m in scene.meshes]).astype(np.float64)
    return np.array([triangle_distance(p[None], corners).min() for p in points])


def test_triangle_distance_is_that_of_the_nearest_of_many_points():
    random = np.random.default_rng(1)
    corners, points = random.random((3, 3)), 2 * random.random((50, 3)) - 0.5
    t = np.linspace(0, 1, 301)
    u, v = (x[np.add.outer(t, t) <= 1] for x in np.meshgrid(t, t, indexing="ij"))
    dense = corners[0] + np.outer(u, corners[1] - corners[0]) + np.outer(v, corners[2] - corners[0])
    expected = np.linalg.norm(points[:, None] - dense, axis=-1).min(axis=1)
    found = triangle_distance(points, np.broadcast_to(corners, (50, 3, 3)))
    # The dense points lie at most one cell (1/300 of an edge under 1.5 m) from the true foot.
    assert (found <= expected + 1e-12).all() and (expected - found < 0.006).all()


@pytest.mark.parametrize("name", ["cornell", "two-rooms"])
def test_distance_is_that_to_all_triangles(scenes, name):
    """Within 2 %: at an edge the nearest point of the tree may lie a few centimetres away, on no better triangle."""
    points = sample_lights(scenes[name], default_variable(scenes[name]), 200, seed=3)
    exact = brute_distance(scenes[name], points)
    found = free_air(scenes[name]).distance(points)
    assert (found >= exact - 1e-9).all()
    assert (found <= 1.02 * exact).all()
    assert np.mean(found > exact + 1e-9) < 0.02


@pytest.mark.parametrize("name", NAMES)
def test_lights_keep_their_clearance_and_their_box(scenes, name):
    variable = default_variable(scenes[name])
    for lights in (sample_lights(scenes[name], variable, 256, 1), held_out_lights(scenes[name], variable, 32, 1)):
        assert lights.dtype == np.float32
        assert (lights >= np.float32(variable.low)).all() and (lights <= np.float32(variable.high)).all()
        # The distance is exact to the 12 nearest candidates; allow 1 % for a nearer triangle that is none of them.
        nearest = lights[np.argsort(free_air(scenes[name]).distance(lights))[:64]]
        assert brute_distance(scenes[name], nearest).min() >= 0.99 * variable.clearance


def test_lights_are_never_inside_the_blocks(scenes):
    lights = sample_lights(scenes["cornell"], default_variable(scenes["cornell"]), 2048, seed=5)
    for mesh in scenes["cornell"].meshes:
        if mesh.name.endswith("_block"):
            assert (Delaunay(mesh.positions[ConvexHull(mesh.positions).vertices]).find_simplex(lights) < 0).all()


def test_lights_are_never_in_the_masonry(scenes):
    """Outside the walls of the courtyard house, but inside its bounds, there is no light."""
    lights = sample_lights(scenes["courtyard"], default_variable(scenes["courtyard"]), 1024, seed=5)
    x, y, z = lights.T
    shaft = (np.abs(x) < 2.2) & (np.abs(z) < 2.2)
    assert (shaft | (y < 6.0)).all()
    assert (shaft | ((y < 3.0) | (y > 3.3))).all()


def test_lights_are_uniform_in_free_air(scenes):
    """χ² over 4 x 4 x 4 cells of the Cornell box against the free part of each; fails for a density off by 20 %."""
    scene, variable = scenes["cornell"], default_variable(scenes["cornell"])

    def cells(points):
        index = ((points - np.asarray(variable.low)) / (np.subtract(variable.high, variable.low)) * 4).astype(int)
        return np.bincount(np.ravel_multi_index(index.clip(0, 3).T, (4, 4, 4)), minlength=64)

    candidates = variable.sample(np.random.default_rng(7).random((40_000, 3)))
    free = cells(candidates[free_air(scene).accepts(candidates, variable.clearance)])
    lights = sample_lights(scene, variable, 4096, seed=2)
    expected = free / free.sum() * len(lights)
    used = expected > 8
    # A sheared copy of the lights stands for a wrong density.
    wrong = lights[lights[:, 0] + 0.4 * np.random.default_rng(1).standard_normal(len(lights)) > -0.6]
    limit = chi2.ppf(0.999, used.sum() - 1)
    assert ((cells(lights)[used] - expected[used]) ** 2 / expected[used]).sum() < limit
    wrong_expected = expected * len(wrong) / len(lights)
    assert ((cells(wrong)[used] - wrong_expected[used]) ** 2 / wrong_expected[used]).sum() > limit


def test_lights_are_seeded_and_splits_are_disjoint(scenes):
    scene, variable = scenes["two-rooms"], default_variable(scenes["two-rooms"])
    first = sample_lights(scene, variable, 128, seed=1)
    np.testing.assert_array_equal(first, sample_lights(scene, variable, 128, seed=1))
    # A longer list starts with the shorter one.
    np.testing.assert_array_equal(first, sample_lights(scene, variable, 300, seed=1)[:128])
    held_out = held_out_lights(scene, variable, 32, seed=1)
    np.testing.assert_array_equal(held_out, held_out_lights(scene, variable, 32, seed=1))
    assert not {tuple(p) for p in first} & {tuple(p) for p in held_out}
    assert len(np.unique(held_out, axis=0)) == 32
    assert not np.array_equal(first, sample_lights(scene, variable, 128, seed=2))


def test_held_out_lights_visit_walls_and_borders(scenes):
    scene, variable = scenes["two-rooms"], default_variable(scenes["two-rooms"])
    lights = held_out_lights(scene, variable, 32, seed=4)
    typical = np.median(free_air(scene).distance(sample_lights(scene, variable, 256, seed=4)))
    assert free_air(scene).distance(lights[:8]).max() < 0.6 * typical
    low, high = np.asarray(variable.low), np.asarray(variable.high)
    assert (np.abs(2 * (lights[8:16] - low) / (high - low) - 1).max(axis=1) > 0.8).all()


def test_a_box_inside_geometry_is_refused():
    scene = world(box((-1, -1, -1), (1, 1, 1)), box((-3, -3, -3), (3, -2.9, 3)))
    with pytest.raises(ValueError) as error:
        sample_lights(scene, PointLight((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5), 0.02), 16, seed=0)
    assert str(error.value) == (
        "vary: the declared box lies inside geometry (0 of 2048 positions of light.position="
        "box(-0.5,-0.5,-0.5,0.5,0.5,0.5) are in free air, 0.02 m from surfaces); move the box into a room or set a "
        "smaller light.clearance"
    )


def inside_out(part):
    return type(part)(part.positions, -part.normals, part.uv, part.indices[:, ::-1])


@pytest.mark.parametrize("double_sided", [False, True])
def test_what_counts_as_free_air(double_sided):
    """A room seen from inside with a ball in it: free between them, not in the ball, not behind the walls."""
    room = inside_out(box((-2, -2, -2), (2, 2, 2)))
    scene = world(room, move(sphere(0.5), (0, -0.5, 0)), double_sided=double_sided)
    points = np.array([[1.0, 0.5, 0], [0, 1, 0], [0, -0.5, 0], [0.1, -0.6, 0], [1.95, 0, 0]])
    assert free_air(scene).accepts(points, 0.1).tolist() == [True, True, False, False, False]
    if not double_sided:
        assert not free_air(scene).accepts(np.array([[2.5, 0, 0], [0, 3, 0.0]]), 0.1).any()


def test_two_sided_sheets_have_air_on_both_sides():
    sheet = box((-2, -0.0005, -2), (2, 0.0005, 2), skip=("-x", "+x", "-y", "-z", "+z"))
    scene = world(sheet, double_sided=True)
    assert free_air(scene).accepts(np.array([[0, 0.5, 0], [0, -0.5, 0]]), 0.1).all()
    assert not free_air(world(sheet)).accepts(np.array([[0, -0.5, 0.0]]), 0.1).any()


def test_closed_and_open_meshes_are_told_apart():
    assert is_closed(record("ball", sphere(1.0))) and is_closed(record("box", box((0, 0, 0), (1, 1, 1))))
    assert not is_closed(record("lid", box((0, 0, 0), (1, 1, 1), skip=("-y",))))


def test_positions_that_see_nothing_are_refused_unless_the_scene_is_open():
    ground = box((-5, -0.1, -5), (5, 0, 5))
    lone = world(move(sphere(0.2), (0, 1, 0)))
    assert free_air(lone).accepts(4 * even_directions(32) + np.array([0, 1, 0]), 0.1).all()
    both = world(ground)
    points = np.concatenate([even_directions(32) + np.array([0, 2, 0]), [[0, 500, 0]]])
    assert free_air(both).accepts(points, 0.1).tolist() == [True] * 32 + [False]


@pytest.mark.parametrize("name", NAMES)
def test_cameras_stand_in_free_air_and_look_at_something(scenes, name):
    scene, variable = scenes[name], default_variable(scenes[name])
    cameras = sample_cameras(scene, variable, 12, seed=1)
    assert cameras == sample_cameras(scene, variable, 12, seed=1)
    assert len(set(cameras)) == 12 and all(c.fov_y == 60 for c in cameras)
    eyes = np.array([c.position for c in cameras])
    assert free_air(scene).accepts(eyes, 0.01 * scene.extent).all()
    ahead = np.array([c.target for c in cameras]) - eyes
    hit, back, distance, _ = free_air(scene).trace(eyes, ahead / np.linalg.norm(ahead, axis=1, keepdims=True))
    assert not back.any() and distance[hit].min() > 0.05 * scene.extent
    # Diverse: no two are nearly the same.
    apart = np.linalg.norm(eyes[:, None] - eyes, axis=-1) + np.linalg.norm(ahead[:, None] - ahead, axis=-1)
    assert (apart + np.eye(12) * 9)[...].min() > 0.05 * scene.extent


def seen_part(scene, camera):
    """Shares of a coarse picture that show a front face, and a back face."""
    ways = view_directions(camera, 16, 10)
    hit, back, _, _ = free_air(scene).trace(np.repeat([camera.position], len(ways), axis=0), ways)
    return (hit & ~back).mean(), back.mean()


# None has air within its bounds.
LONE = {
    "floor": [box((-4, -0.001, -4), (4, 0, 4), skip=("-x", "+x", "-y", "-z", "+z"))],
    "wall": [box((-4, -4, -0.001), (4, 4, 0), skip=("-x", "+x", "-y", "+y", "-z"))],
    "solid": [box((-1, -1, -1), (1, 1, 1))],
}


@pytest.mark.parametrize("name", LONE)
def test_a_scene_without_air_of_its_own_is_seen_from_around_it(name):
    scene = world(*LONE[name])
    sun = sun_arc(90, 20, 270, 20)
    with pytest.raises(ValueError, match="no eye fits into the free air of scene 'test'; add a camera"):
        sample_cameras(scene, sun, 4, seed=1, outside=False)
    cameras = sample_cameras(scene, sun, 4, seed=1)
    assert cameras == sample_cameras(scene, sun, 4, seed=1) and len(set(cameras)) == 4
    for camera in cameras:
        front, back = seen_part(scene, camera)
        assert front > 0.1 and back == 0


def test_a_scene_that_shows_only_backs_is_seen_from_afar():
    """A ceiling alone, which faces down."""
    scene = world(box((-4, -0.001, -4), (4, 0, 4), skip=("-x", "+x", "+y", "-z", "+z")))
    cameras = sample_cameras(scene, sun_arc(90, 20, 270, 20), 2, seed=1)
    assert all(seen_part(scene, camera)[0] > 0.05 for camera in cameras)


def test_authored_cameras_come_first_when_wanted(scenes):
    scene = scenes["cornell"]
    own = scene.cameras
    assert sample_cameras(scene, default_variable(scene), 3, seed=1, authored=True) == own[:3]
    assert sample_cameras(scene, default_variable(scene), 8, seed=1, authored=True)[: len(own)] == own


@pytest.mark.parametrize("name", NAMES)
def test_the_first_light_is_allowed_and_lights_the_view(scenes, name):
    scene, variable = scenes[name], default_variable(scenes[name])
    light = initial_light(scene, variable, scene.cameras[0])
    assert light.shape == (3,)
    np.testing.assert_array_equal(light, initial_light(scene, variable, scene.cameras[0]))
    assert free_air(scene).accepts(light[None], variable.clearance).all()
    camera = scene.cameras[0]
    ahead = np.subtract(camera.target, camera.position)
    sight = light - np.asarray(camera.position)
    cosine = sight @ ahead / np.linalg.norm(sight) / np.linalg.norm(ahead)
    assert cosine < np.cos(np.radians(5))


def test_a_sun_needs_no_air(scenes):
    sun = sun_arc(90, 20, 270, 20)
    lights = sample_lights(scenes["courtyard"], sun, 64, seed=1)
    np.testing.assert_allclose(np.linalg.norm(lights, axis=1), 1, atol=1e-6)
    assert not {tuple(d) for d in lights} & {tuple(d) for d in held_out_lights(scenes["courtyard"], sun, 16, seed=1)}
    assert initial_light(scenes["courtyard"], sun, scenes["courtyard"].cameras[1])[1] > 0
    assert len(sample_cameras(scenes["courtyard"], sun, 4, seed=1)) == 4


def test_free_cells_mark_the_blocks(scenes):
    scene, variable = scenes["cornell"], default_variable(scenes["cornell"])
    cells = free_cells(scene, variable, n=12)
    assert cells.shape == (12, 12, 12) and cells.dtype == bool
    assert cells[:, -2].all()
    # Middle of the short block, 0.3 m high: x to the right, z to the viewer.
    x, y, z = (int((p - a) / (b - a) * 12) for p, a, b in zip((0.34, 0.3, 0.4), variable.low, variable.high))
    assert not cells[z, y, x]


def test_a_camera_that_sees_nothing_still_gets_a_light(scenes):
    away = Camera((0.0, 1.0, 5.0), (0.0, 1.0, 9.0))
    assert initial_light(scenes["cornell"], default_variable(scenes["cornell"]), away).shape == (3,)
