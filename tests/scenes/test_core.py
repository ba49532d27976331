"""The core of a scene: where its objects are, without ground of kilometres and domes of sky."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.probes.bake import bake_geometry
from lightwell.scenes.free_air import free_air
from lightwell.scenes.placing import sample_cameras
from lightwell.scenes.variables import default_variable
from lightwell.scenes.viewpoints import view_directions
from lightwell.transport.surface import draw_surface
from tests.transport.rooms import WHITE, box, build, diffuse

GROUND = ((-1000, -1.0, -1000), (1000, 0.0, 1000))
TOWN = [((8.0 * k, 0.0, 5.0 * k), (8.0 * k + 4, 6.0, 5.0 * k + 4)) for k in range(6)]


def box_scene(boxes):
    meshes = [box(f"box {k}", low, high) for k, (low, high) in enumerate(boxes)]
    return build(f"{len(boxes)} boxes", meshes, [diffuse(WHITE)] * len(meshes))


@pytest.fixture(scope="module")
def town():
    return box_scene([GROUND, *TOWN])


def test_ground_of_kilometres_is_not_part_of_the_core(town):
    low, high = town.core
    assert (low <= (0, 0, 0)).all() and (high >= (44, 6, 29)).all()
    assert (high - low).max() < 100 < town.extent


def test_probes_stand_in_the_core(town):
    lattice = bake_geometry(town, 12.0, "relu-field").volume.lattice
    low, high = lattice.origin, lattice.origin + lattice.spacing * np.array(lattice.cells)
    assert (low <= town.core[0]).all() and (high >= town.core[1]).all()
    assert (high - low <= town.core[1] - town.core[0] + 3 * lattice.spacing).all()


def test_a_light_and_cameras_are_placed_in_the_core(town):
    light = default_variable(town)
    assert (np.array(light.low) >= town.core[0]).all() and (np.array(light.high) <= town.core[1]).all()
    for camera in sample_cameras(town, light, 4, 0):
        assert np.linalg.norm(np.array(camera.position) - town.core.mean(axis=0)) < 100


def test_cameras_look_at_the_core(town):
    low, high = town.core
    for camera in sample_cameras(town, default_variable(town), 4, 0):
        rays = view_directions(camera, 16, 10)
        hit, _, distance, _ = free_air(town).trace(np.repeat([camera.position], len(rays), axis=0), rays)
        places = np.array(camera.position) + distance[:, None] * rays
        beside = 0.1 * (high - low).max()
        within = hit & ((places >= low - beside) & (places <= high + beside)).all(axis=1)
        # Not at the plain behind.
        assert within.mean() > 0.6


@pytest.mark.parametrize("boxes", [[((0, 0, 0), (10, 3, 10)), ((4, 0, 4), (4.5, 1, 4.5))], TOWN])
def test_rooms_and_places_without_wide_ground_are_their_own_core(boxes):
    scene = box_scene(boxes)
    assert np.array_equal(scene.core, scene.bounds)


def test_thin_things_under_a_sky_are_lit():
    """A pane of 4 mm is thin beside ground of kilometres, and a thing of its own beside a town."""
    pane = ((2.0, 8.0, 2.0), (4.0, 8.004, 4.0))
    scene = box_scene([GROUND, *TOWN, pane])
    draw = draw_surface(scene, 4096, 1, floor=64, is_open=True)
    area = draw.visible_area[len(TOWN) + 1]
    assert area == pytest.approx(2 * 4 + 4 * 2 * 0.004, rel=0.05)
