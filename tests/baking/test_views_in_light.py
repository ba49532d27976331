"""Views of light that stands still: no camera of them stands in a room that no light enters."""

from dataclasses import replace

import numpy as np
import pytest

from lightwell.baking.evaluate import lit_views
from lightwell.scenes.assemble import assemble
from lightwell.scenes.scene import Camera, Light, Material, Mesh


def room(name: str, low, high) -> Mesh:
    """A closed room that is seen from inside."""
    low, high = np.float32(low), np.float32(high)
    corners = np.float32([[(k >> axis) & 1 for axis in range(3)] for k in range(8)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.uint32([t for a, b, c, d in faces for t in ((a, c, b), (a, d, c))])
    positions = low + corners * (high - low)
    centre = positions[triangles].mean(axis=1) - (low + high) / 2
    edges = positions[triangles]
    out = (np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]) * centre).sum(axis=1) > 0
    triangles[out] = triangles[out][:, ::-1]
    return Mesh(name, positions, triangles, 0)


@pytest.fixture(scope="module")
def two_rooms():
    meshes = [room("lit", (0, 0, 0), (5, 3, 5)), room("dark", (6, 0, 0), (16, 3, 10))]
    lamp = Light("point", "lamp", position=(2.5, 2.5, 2.5), intensity=10.0)
    return assemble("rooms", meshes, [Material("white", (0.8, 0.8, 0.8, 1), metallic=0.0)], lights=[lamp])


def test_sampled_views_are_in_the_lit_room(two_rooms):
    views = lit_views(two_rooms, None, 4, 0)
    assert len(views) == 4 and all(camera.position[0] < 5 for camera, _ in views)
    assert [camera.name for camera, _ in views] == [f"view {k}" for k in range(1, 5)]


def test_the_scene_s_own_camera_stays_where_it_is(two_rooms):
    own = Camera((8.0, 1.5, 5.0), (14.0, 1.5, 5.0), fov_y=60.0, name="in the dark")
    views = lit_views(replace(two_rooms, cameras=[own]), None, 3, 0)
    assert views[0][0] == own and all(camera.position[0] < 5 for camera, _ in views[1:])


def test_a_scene_without_light_has_as_many_views(two_rooms):
    assert len(lit_views(replace(two_rooms, lights=[]), None, 4, 0)) == 4
