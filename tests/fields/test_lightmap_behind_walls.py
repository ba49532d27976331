"""Light beside walls that stand on a larger floor, on bodies that touch it, and on wires: as bright as path traced."""

from dataclasses import replace

import numpy as np
import pytest

from lightwell.fields.lightmap.behind_walls import in_rooms
from lightwell.fields.lightmap.trace import chart
from lightwell.scenes.assemble import assemble
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.default_light import under_sky
from lightwell.scenes.scene import Camera, Material, Mesh
from lightwell.transport.irradiance import irradiance
from lightwell.transport.queries import frames
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.texels import texels
from lightwell.transport.visible import seen_side, side_points

PATHS = 64
TWO_SIDED = Material("grey", (0.6, 0.6, 0.6, 1), metallic=0.0, double_sided=True)


def box(name: str, low, high, lid: bool = True) -> Mesh:
    """The walls of a box, whose faces look outwards, and its lid."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    ring = [(x0, z0), (x1, z0), (x1, z1), (x0, z1)]
    positions, indices = [], []
    for (xa, za), (xb, zb) in zip(ring, ring[1:] + ring[:1]):
        first = len(positions)
        positions += [(xa, y0, za), (xb, y0, zb), (xb, y1, zb), (xa, y1, za)]
        indices += [(first, first + 2, first + 1), (first, first + 3, first + 2)]
    if lid:
        first = len(positions)
        positions += [(x, y1, z) for x, z in ring]
        indices += [(first, first + 2, first + 1), (first, first + 3, first + 2)]
    return Mesh(name, np.float32(positions), np.uint32(indices), 0)


def floor(half: float) -> Mesh:
    corners = np.float32([[-half, 0, -half], [-half, 0, half], [half, 0, half], [half, 0, -half]])
    return Mesh("floor", corners, np.uint32([[0, 1, 2], [0, 2, 3]]), 0)


def floor_points(scene, places) -> SurfacePoints:
    """Points on the upper side of the floor, the first mesh, at places [N, 2] (x, z)."""
    corners = scene.meshes[0].positions[scene.meshes[0].indices.astype(np.int64)].astype(np.float64)
    triangle, weights = [], []
    for place in np.asarray(places, np.float64):
        for k, c in enumerate(corners[:, :, [0, 2]]):
            w = np.linalg.solve(np.stack([c[1] - c[0], c[2] - c[0]], axis=1), place - c[0])
            if w.min() >= 0 and w.sum() <= 1:
                triangle.append(k)
                weights.append(w)
                break
    points = side_points(scene, np.array(triangle), np.zeros(len(triangle), int), np.float32(weights))
    side = (frames(scene, points)[2][:, 1] < 0).astype(int)
    return side_points(scene, np.array(triangle), side, np.float32(weights))


def shown(made, points: SurfacePoints, scene) -> np.ndarray:
    """[N] irradiance / π that a bilinear read of the light map gives."""
    n = made.atlas.size
    uv = made.atlas.lookup(points.shape, points.triangle, points.barycentric, seen_side(scene, points))
    at = uv * n - 0.5
    first = np.floor(at).astype(int)
    found = np.zeros(len(points))
    for step in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = np.abs(1 - np.array(step) - (at - first)).prod(axis=1)
        column, row = np.clip(first + step, 0, n - 1).T
        found += weight * made.image[row, column].mean(axis=-1)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("seen", [False, True], ids=["closed", "an eye is inside"])
def test_the_floor_before_a_wall_is_not_darkened_by_the_floor_inside_it(seen):
    """A hollow wall is as high as a room and too narrow to stand in."""
    scene = under_sky(assemble("yard", [floor(10.0), box("wall", (-0.25, -0.2, -3), (0.25, 2.5, 3))], [TWO_SIDED]))
    eye = Camera((0.0, 1.0, 0.0), (0.0, 1.0, 2.0))
    scene = replace(scene, cameras=[eye]) if seen else scene
    made = chart(scene, 128, 0, PATHS, 0)
    # Nearer to the wall than a texel.
    points = floor_points(scene, [(side * 0.27, z) for z in np.linspace(-2, 2, 41) for side in (-1, 1)])
    traced = irradiance(scene, points, 1024, 7).mean.mean(axis=1)
    # Noise of 64 paths after the filter is a few percent; a black neighbour takes up to all of the light.
    assert (shown(made, points, scene) > 0.75 * traced).all()


def test_a_dark_room_does_not_take_the_light_before_its_walls():
    scene = under_sky(assemble("yard", [floor(10.0), box("walls", (-3, -0.2, -3), (3, 2.5, 3))], [TWO_SIDED]))
    made = chart(scene, 128, 0, PATHS, 0)
    inside = floor_points(scene, [(x, z) for x in np.linspace(-2.5, 2.5, 41) for z in np.linspace(-2.5, 2.5, 41)])
    assert in_rooms(scene, inside).all()
    assert shown(made, inside, scene).max() < 0.02 * made.light.mean.mean()


@pytest.mark.slow
def test_the_floor_beside_a_plate_is_not_darkened_by_the_gap_under_it():
    """Some light enters the gap, so that the texels under the edge of the plate are not black."""
    turn, corners = 0.1, np.float64([[-3, -3], [-3, 3], [3, 3], [3, -3]])
    x = corners @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    plate = np.float32([[a, 0.006, b] for a, b in x])
    meshes = [floor(10.0), Mesh("plate", plate, np.uint32([[0, 1, 2], [0, 2, 3]]), 0)]
    meshes.append(box("post", (8, 0, 8), (9, 2.5, 9)))
    scene = under_sky(assemble("yard", meshes, [TWO_SIDED]))
    made = chart(scene, 256, 0, PATHS, 0)
    places = np.concatenate([np.linspace(0.1, 0.9, 300)[:, None] * (b - a) + a for a, b in zip(x, np.roll(x, -1, 0))])
    points = floor_points(scene, places * (1 + 0.01 / 3))
    assert shown(made, points, scene).min() > 0.6 * irradiance(scene, points, 256, 7).mean.mean()


def test_a_wire_far_narrower_than_a_texel_has_texels_along_its_length():
    """Its chart passes between the places at which texels are tested, and each of its points is near an edge."""
    length, width = 10.0, 1e-3
    corners = np.float32([[0, 1, 0], [width, 1, 0], [width, 1, length], [0, 1, length]])
    wire = Mesh("wire", corners, np.uint32([[0, 2, 1], [0, 3, 2]]), 0)
    scene = under_sky(assemble("yard", [floor(10.0), wire], [TWO_SIDED]))
    n, side = 64, 0
    strip = np.float32([[10.35, 5.5], [10.45, 5.5], [10.45, 45.5], [10.35, 45.5]])
    uv = np.zeros((2, 4, 3, 2), np.float32)
    uv[:, 2:] = strip[wire.indices.astype(int)] / n
    charts = np.int32([[-1, -1, 0, 0], [-1, -1, -1, -1]])
    atlas = Atlas(n, 0, uv, charts, np.array([0, 2, 4]), "test")
    found = texels(scene, atlas)
    assert set(found.index) >= {row * n + 10 for row in range(6, 45)}
    along = frames(scene, found.points)[0][:, 2]
    assert len(np.unique(np.round(along, 1))) > 30
    assert seen_side(scene, found.points).max() == side
