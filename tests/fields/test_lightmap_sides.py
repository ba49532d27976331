"""Which sides a light map stores and how many texels they get: a room under a dome a hundred times as large."""

from dataclasses import replace

import numpy as np
import pytest

from lightwell.fields.lightmap.density import seen_density
from lightwell.fields.lightmap.sides import flat_neighbours, flat_parts, lit_sides, sides_in_sight
from lightwell.scenes.assemble import assemble
from lightwell.scenes.default_light import under_sky
from lightwell.scenes.scene import Material, Mesh
from lightwell.transport.tables import tables

DOME, ROOM, TABLE = 0, 1, 2


def box(name: str, low, high, inwards: bool, grid: int = 1) -> Mesh:
    """A box with a hole in its upper face, of grid x grid squares each."""
    low, high = np.float32(low), np.float32(high)
    positions, indices = [], []
    for axis in range(3):
        for end in (0, 1):
            u, v = [a for a in range(3) if a != axis]
            for i in range(grid):
                for j in range(grid):
                    if (axis, end, i, j) == (1, 1, 0, 0):
                        continue
                    corner = np.zeros((4, 3), np.float32)
                    corner[:, axis] = end
                    corner[:, u] = (i + np.float32([0, 1, 1, 0])) / grid
                    corner[:, v] = (j + np.float32([0, 0, 1, 1])) / grid
                    indices += [[len(positions) + k for k in t] for t in ((0, 1, 2), (0, 2, 3))]
                    positions += list(low + corner * (high - low))
    found = np.float32(positions)
    triangles = np.uint32(indices)
    middle = (low + high) / 2
    normal = np.cross(found[triangles[:, 1]] - found[triangles[:, 0]], found[triangles[:, 2]] - found[triangles[:, 0]])
    out = ((found[triangles].mean(axis=1) - middle) * normal).sum(axis=1) > 0
    triangles[out == inwards] = triangles[out == inwards][:, ::-1]
    return Mesh(name, found, triangles, 0)


@pytest.fixture(scope="module")
def scene():
    parts = [
        box("dome", (-400, -1, -400), (400, 300, 400), inwards=True),
        box("room", (-3, 0, -3), (3, 2.5, 3), inwards=True, grid=4),
        box("table", (-1, 0.01, -1), (1, 1, 1), inwards=False),
    ]
    return under_sky(assemble("dome", parts, [Material("grey", (0.6, 0.6, 0.6, 1), metallic=0.0)]))


def test_a_room_gets_texels_under_a_dome(scene):
    lit = np.ones((2, len(tables(scene).area)), bool)
    density = seen_density(scene, lit, 0)
    t = tables(scene)
    texels = np.bincount(t.mesh_of, weights=t.area * density[t.mesh_of] ** 2)
    area = np.bincount(t.mesh_of, weights=t.area)
    assert area[ROOM] < 1e-3 * area[DOME]
    assert texels[ROOM] > 0.02 * texels[DOME]


def test_all_sides_inside_a_small_room_are_found(scene):
    seen = sides_in_sight(scene, 0)
    inside = tables(scene).mesh_of == ROOM
    assert seen[0, inside].all()
    assert lit_sides(scene, 0).lit[0, inside].all()


def test_sides_that_continue_a_lit_one_are_lit(scene):
    mesh = scene.meshes[ROOM]
    assert len(np.unique(flat_parts(mesh))) == 6
    lit = np.zeros((2, len(tables(scene).area)), bool)
    start = len(scene.meshes[DOME].indices)
    lit[1, start] = True
    grown = flat_neighbours(scene, lit)
    assert grown[1].sum() == 2 * 16 and not grown[0].any()


def test_a_closed_dark_room_does_not_read_the_light_outside():
    """Nobody sees its inside from free air, but a camera may stand there."""
    closed = replace(box("room", (-3, 0, -3), (3, 2.5, 3), inwards=True), name="closed")
    lid = np.float32([[-3, 2.5, -3], [-3, 2.5, 3], [3, 2.5, 3], [3, 2.5, -3]])
    meshes = [closed, Mesh("lid", lid, np.uint32([[0, 2, 1], [0, 3, 2]]), 0)]
    meshes += [box("ground", (-20, -0.2, -20), (20, -0.1, 20), inwards=False, grid=8)]
    meshes += [box("post", (15, -0.1, 15), (15.5, 10, 15.5), inwards=False)]
    scene = under_sky(assemble("closed", meshes, [Material("grey", (0.6, 0.6, 0.6, 1), metallic=0.0)]))
    sides = lit_sides(scene, 0)
    room = tables(scene).mesh_of == 0
    assert not sides.lit[0, room].any() and sides.dark[0, room].all()
    assert sides.lit[1, room].any()
