"""Which sides a light map stores and how many texels they get: a room under a dome a hundred times as large."""

from dataclasses import replace

import numpy as np
import pytest

from lightwell.fields.lightmap.density import seen_density
from lightwell.fields.lightmap.sides import before_rooms, flat_neighbours, flat_parts, lit_sides, sides_in_sight
from lightwell.fields.lightmap.trace import chart
from lightwell.fields.lightmap.views import eye_points, eye_samples
from lightwell.scenes.assemble import assemble
from lightwell.scenes.default_light import under_sky
from lightwell.scenes.scene import Material, Mesh
from lightwell.transport.point_rejection import reject
from lightwell.transport.queries import frames, make_query
from lightwell.transport.tables import tables
from lightwell.transport.visible import side_points

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


def rectangle(low, high, into) -> tuple[np.ndarray, np.ndarray]:
    """Corners and triangles of a rectangle between opposite corners, whose normal points towards ``into``."""
    low, high = np.float32(low), np.float32(high)
    u, v = np.flatnonzero(high > low)
    corners = np.tile(low, (4, 1))
    corners[[1, 2], u], corners[[2, 3], v] = high[u], high[v]
    flat = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    turned = flat @ (np.float32(into) - corners[0]) < 0
    return corners, np.uint32([[0, 2, 1], [0, 3, 2]] if turned else [[0, 1, 2], [0, 2, 3]])


def sheets(name: str, rectangles, into) -> Mesh:
    corners, triangles = zip(*(rectangle(low, high, into) for low, high in rectangles))
    return Mesh(
        name, np.concatenate(corners), np.concatenate([t + 4 * np.uint32(k) for k, t in enumerate(triangles)]), 0
    )


@pytest.mark.slow
def test_rooms_below_large_ground_are_searched():
    """Nearly all air is above the ground; a shaft and two corridors lead to the room."""
    ground = [
        ((-30, 0, -30), (0, 0, 30)),
        ((2, 0, -30), (30, 0, 30)),
        ((0, 0, -30), (2, 0, 0)),
        ((0, 0, 2), (2, 0, 30)),
    ]
    shaft = [((0, -10, 0), (0, 0, 2)), ((0, -10, 0), (2, 0, 0)), ((0, -10, 2), (2, 0, 2)), ((2, -8, 0), (2, 0, 2))]
    shaft += [((0, -10, 0), (2, -10, 2))]
    corridor = [((2, y, 0), (12, y, 2)) for y in (-10, -8)] + [((2, -10, z), (10, -8, z)) for z in (0, 2)]
    corridor += [((10, -10, 0), (12, -8, 0)), ((12, -10, 0), (12, -8, 2))]
    turn = [((10, y, 2), (12, y, 8)) for y in (-10, -8)] + [((x, -10, 2), (x, -8, 8)) for x in (10, 12)]
    room = [((7, y, 8), (15, y, 16)) for y in (-10, -6)] + [((x, -10, 8), (x, -6, 16)) for x in (7, 15)]
    room += [((7, -10, 16), (15, -6, 16)), ((7, -10, 8), (10, -6, 8)), ((12, -10, 8), (15, -6, 8))]
    room += [((10, -8, 8), (12, -6, 8))]
    meshes = [sheets("ground", ground, (0, 9, 0)), sheets("shaft", shaft, (1, -1, 1))]
    meshes += [sheets("corridor", corridor, (11, -9, 1)), sheets("turn", turn, (11, -9, 5))]
    meshes += [sheets("room", room, (11, -9, 12)), box("post", (20, 0, 20), (21, 15, 21), inwards=False)]
    white = Material("white", (0.8, 0.8, 0.8, 1), metallic=0.0)
    scene = under_sky(assemble("cellar", meshes, [white]))
    sides, room = lit_sides(scene, 0), tables(scene).mesh_of == 4
    assert (sides.lit | sides.dark)[0, room].all() and not sides.lit[1].any()


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
    grey = Material("grey", (0.6, 0.6, 0.6, 1), metallic=0.0, double_sided=True)
    scene = under_sky(assemble("closed", meshes, [grey]))
    sides = lit_sides(scene, 0)
    room = tables(scene).mesh_of == 0
    assert not sides.lit[0, room].any() and sides.dark[0, room].all()
    assert sides.lit[1, room].any()


def test_backs_of_one_sided_materials_are_not_stored(scene):
    whole = replace(scene, materials=[replace(m, double_sided=True) for m in scene.materials])
    both, front = lit_sides(whole, 0), lit_sides(scene, 0)
    assert both.lit[1].any() and not front.lit[1].any() and not front.dark[1].any()
    np.testing.assert_array_equal(front.lit[0], both.lit[0])


def test_samples_towards_views_lie_on_stored_sides_alone(scene):
    """Backs of one-sided materials share texture coordinates with the fronts, and have light of their own."""
    glossy = replace(scene, materials=[replace(m, roughness=0.3) for m in scene.materials])
    made = chart(glossy, 64, 0, 4, 0)
    eyes = eye_samples(glossy, made, 1 << 12, 2, 5, made.image)
    points = eye_points(glossy, 1 << 12, 5, made)[0]
    triangle = tables(glossy).first[points.shape] + points.triangle
    back = (frames(glossy, points)[2] * points.view).sum(axis=1) < 0
    stored = made.atlas.chart[back.astype(int), triangle] >= 0
    assert stored.mean() > 0.9 and not eyes.weight[~stored].any() and (eyes.weight[stored] > 0).mean() > 0.99


@pytest.mark.slow
def test_texels_of_rooms_without_light_have_samples_towards_views():
    """Random walks from a closed room find no light: area-uniform points there are rejected."""
    walls = (
        [((-3, y, -3), (3, y, 3)) for y in (0, 2.5)]
        + [((x, 0, -3), (x, 2.5, 3)) for x in (-3, 3)]
        + [((-3, 0, z), (3, 2.5, z)) for z in (-3, 3)]
    )
    lit = [((20 + x0, y0, z0), (20 + x1, y1, z1)) for (x0, y0, z0), (x1, y1, z1) in walls[:1] + walls[2:]]
    # A closed mesh would be a solid.
    meshes = [
        sheets("dark", walls[1:], (0, 1, 0)),
        sheets("floor", walls[:1], (0, 1, 0)),
        sheets("lit", lit, (20, 1, 0)),
    ]
    gloss = Material("gloss", (0.6, 0.6, 0.6, 1), metallic=0.0, roughness=0.3)
    scene = under_sky(assemble("two", meshes, [gloss]))
    sides = lit_sides(scene, 0)
    sides.lit[0, :] = True
    made = chart(scene, 64, 0, 4, 0, sides=sides)
    dark = [(eye_points(scene, 1 << 12, 5, known)[0].shape <= 1).mean() for known in (None, made)]
    assert dark[0] == 0 and 0.04 < dark[1] < 0.09


@pytest.mark.slow
def test_the_floor_of_a_closed_dark_room_does_not_take_the_light_outside():
    """One triangle of the floor lies inside and outside; of what lies under a solid block nothing is seen, ever."""

    def walls_and_lid(name: str, low, high, inwards: bool) -> list[Mesh]:
        (x0, _, z0), (x1, y1, z1) = low, high
        lid = np.float32([[x0, y1, z0], [x0, y1, z1], [x1, y1, z1], [x1, y1, z0]])
        triangles = np.uint32([[0, 2, 1], [0, 3, 2]] if inwards else [[0, 1, 2], [0, 2, 3]])
        return [box(name, low, high, inwards), Mesh("lid", lid, triangles, 0)]

    # The block is one closed mesh, a solid; the room is not.
    walls, lid = walls_and_lid("block", (-8, -0.5, -3), (-2, 2.5, 3), False)
    corners = np.concatenate([walls.positions, lid.positions])
    block = replace(
        walls, positions=corners, indices=np.concatenate([walls.indices, lid.indices + len(walls.positions)])
    )
    floor = np.float32([[-20, 0, -20], [-20, 0, 20], [20, 0, 20], [20, 0, -20]])
    meshes = [Mesh("floor", floor, np.uint32([[0, 1, 2], [0, 2, 3]]), 0)]
    meshes += [*walls_and_lid("room", (2, -0.5, -3), (8, 2.5, 3), True), block]
    scene = under_sky(assemble("closed", meshes, [Material("grey", (0.6, 0.6, 0.6, 1), metallic=0.0)]))
    made = chart(scene, 256, 0, 16, 0)
    place = make_query(scene, made.texels.points, np.zeros(3, np.float32)).position
    on_floor = (made.texels.points.shape == 0) & (made.texels.points.view[:, 1] > 0) & (np.abs(place[:, 2]) < 2.5)
    inside, under = (on_floor & (np.abs(place[:, 0] - x) < 2.5) for x in (5, -5))
    assert inside.sum() > 100 and made.stored[inside].all()
    assert made.light.mean[inside].max() < 0.01 * made.light.mean[on_floor].mean()
    assert under.sum() > 100 and not made.stored[under].any()


def test_no_points_are_rejected_of_none(scene):
    points = side_points(scene, np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2), np.float32))
    assert len(reject(scene, points)) == 0
    assert len(before_rooms(scene, points)) == 0
