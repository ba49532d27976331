"""Light that arrives at texels, against closed forms."""

import numpy as np
import pytest

from lightwell.scenes.assemble import assemble
from lightwell.scenes.atlas import build
from lightwell.scenes.default_light import under_sky, with_lamp
from lightwell.scenes.scene import Material, Mesh
from lightwell.transport.irradiance import irradiance
from lightwell.transport.lightmap_query import query_of_lightmap
from lightwell.transport.queries import frames
from lightwell.transport.texels import texels

pytestmark = pytest.mark.gpu

# Four standard errors.
SIGMAS = 4


def square(y=0.0, size=1.0, turned=False) -> Mesh:
    corners = size * np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], np.float32) + np.float32([0, y, 0])
    indices = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    return Mesh("square", corners, indices[:, ::-1] if turned else indices, 0)


def scene_of(*meshes, albedo=0.5):
    return assemble("plane", list(meshes), [Material("grey", (albedo,) * 3 + (1,), metallic=0.0, ior=1.0)])


def charted(scene, sides=(True, False), size=32):
    lit = np.repeat(np.array(sides)[:, None], sum(len(m.indices) for m in scene.meshes), axis=1)
    atlas = build(scene, size, lit, mips=0)
    return atlas, texels(scene, atlas)


def test_a_plane_under_a_white_sky_receives_one():
    scene = under_sky(scene_of(square()))
    found = irradiance(scene, charted(scene)[1].points, 64, 1)
    error = found.mean.std(axis=0) / np.sqrt(len(found.mean))
    assert (np.abs(found.mean.mean(axis=0) - 1) < SIGMAS * error).all() and (error < 2e-3).all()
    assert found.valid.all()
    # The mean direction of even light is the normal, 2/3 long.
    error = found.direction.std(axis=0) / np.sqrt(len(found.direction))
    assert (np.abs(found.direction.mean(axis=0) - [0, 2 / 3, 0]) < SIGMAS * error + 0.01).all()


def test_a_lamp_gives_the_inverse_square_law():
    scene = with_lamp(scene_of(square()), (0.3, 2.0, 0.1))
    atlas, covered = charted(scene)
    found = irradiance(scene, covered.points, 2, 1)
    at = query_of_lightmap(scene, atlas, covered.points).position
    offset = np.array([0.3, 2.0, 0.1]) - at
    distance = np.linalg.norm(offset, axis=1)
    expected = 10.0 / np.pi * offset[:, 1] / distance**3
    assert np.abs(found.mean / expected[:, None] - 1).max() < 1e-3


def test_a_lid_as_large_as_the_plane_takes_its_view_factor_away():
    """Two parallel squares of side 2 at distance 2: the view factor of each quarter of the lid from the middle
    is x / √(1 + x²) atan(x / √(1 + x²)) / π with x = 1/2 (Howell, catalogue B-4)."""
    scene = under_sky(scene_of(square(), square(2.0, turned=True), albedo=0.0))
    points = charted(scene, size=64)[1].points
    position = frames(scene, points)[0]
    middle = (np.abs(position[:, [0, 2]]).max(axis=1) < 0.1) & (position[:, 1] < 1)
    found = irradiance(scene, points[np.flatnonzero(middle)], 256, 1).mean
    x = 0.5
    corner = x / np.sqrt(1 + x * x) * np.arctan(x / np.sqrt(1 + x * x)) / np.pi
    error = found.std() / np.sqrt(found.size / 3)
    assert abs(found.mean() - (1 - 4 * corner)) < SIGMAS * error + 0.003


@pytest.mark.parametrize("side", [0, 1])
def test_each_side_of_a_sheet_has_its_own_light(side):
    scene = with_lamp(scene_of(square()), (0.0, 1.0, 0.0))
    _, covered = charted(scene, (True, True))
    up = covered.points.view[:, 1] > 0
    found = irradiance(scene, covered.points, 2, 1).mean
    assert found[up].min() > 0 and found[~up].max() == 0


def test_a_texel_is_the_point_that_reads_it():
    scene = scene_of(square())
    atlas, covered = charted(scene)
    uv = query_of_lightmap(scene, atlas, covered.points).uv1 * atlas.size
    centre = np.stack([covered.index % atlas.size, covered.index // atlas.size], axis=1) + 0.5
    assert np.abs(uv - centre).max() <= 0.5
    assert np.median(np.abs(uv - centre)) < 0.02


def test_odd_paths_are_refused():
    scene = under_sky(scene_of(square()))
    with pytest.raises(ValueError, match="even number"):
        irradiance(scene, charted(scene)[1].points, 3, 1)
