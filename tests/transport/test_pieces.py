"""The part of a surface that points are drawn from: the core of scenes with a sky dome or ground of kilometres."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.transport.interactions import interaction
from lightwell.transport.pieces import FINEST, of_core, whole
from lightwell.transport.surface import draw_surface

from . import rooms


@pytest.fixture(scope="module")
def town():
    """Ten boxes on two kilometres of ground, which are two triangles."""
    ground = rooms.quad("ground", (-1000, 0, -1000), (0, 0, 2000), (2000, 0, 0))
    houses = [rooms.box(f"house {k}", (8 * k, 0, -3), (8 * k + 5, 6, 3)) for k in range(10)]
    return rooms.build("town", [ground, *houses], [rooms.diffuse(rooms.WHITE)] * 11)


def test_a_scene_that_is_its_own_core_keeps_its_triangles(cornell):
    every, core = whole(cornell), of_core(cornell)
    assert np.array_equal(every.triangle, core.triangle) and np.array_equal(every.area, core.area)


def test_the_pieces_of_wide_ground_have_the_area_of_the_core(town):
    low, high = town.core
    asked = float((high - low)[0] * (high - low)[2])
    assert asked < 0.01 * whole(town).mesh_area[0]
    # The border is rounded to the finest pieces.
    edge = FINEST * town.core_extent
    assert abs(of_core(town).mesh_area[0] - asked) < 2 * edge * (high - low)[[0, 2]].sum()
    assert np.allclose(of_core(town).mesh_area[1:], whole(town).mesh_area[1:])


def test_points_are_area_uniform_in_the_core(town):
    draw = draw_surface(town, 4096, 3, floor=0, core=True)
    p = np.array(interaction(town, draw.points).p).T
    edge = FINEST * town.core_extent
    assert (p >= town.core[0] - edge).all() and (p <= town.core[1] + edge).all()
    ground = p[draw.points.shape == 0]
    assert np.abs(ground[:, 1]).max() < 1e-3
    # Each quarter of the ground that no house covers, behind and before the row of houses, has its share.
    free = ground[np.abs(ground[:, 2]) > 4]
    middle = town.core.mean(axis=0)
    counts = np.histogram2d(free[:, 0], free[:, 2], bins=[[-1e3, middle[0], 1e3], [-1e3, 0, 1e3]])[0]
    assert np.abs(counts / counts.mean() - 1).max() < 5 / np.sqrt(counts.mean())


def test_without_pieces_hardly_a_point_would_be_on_the_houses(town):
    """The share of the houses in all area: what was drawn before the core was."""
    assert whole(town).mesh_area[1:].sum() < 0.001 * whole(town).mesh_area.sum()
    draw = draw_surface(town, 4096, 3, floor=0, core=True)
    assert (draw.points.shape > 0).mean() > 0.2
