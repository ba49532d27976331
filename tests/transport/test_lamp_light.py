"""Shares of groups of lamps: their sum is the light of the scene, and each is the light of its lamp alone."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.core.lamps import parse_lamps
from lightwell.scenes.lamps import group_lamps
from lightwell.scenes.load import load
from lightwell.scenes.scene import Scene
from lightwell.transport import static
from lightwell.transport.lamp_light import LampLight, LampShares
from lightwell.transport.queries import frames
from lightwell.transport.radiosity import Radiosity
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.surface import draw_surface
from lightwell.transport.uneven_light import FEW_GROUPS, sums_by_group
from tests.transport.rooms import build, diffuse, quad, room_walls

POINTS = 512


def lit_room(*shining: str) -> Scene:
    """A closed room with a warm panel on one side and a cool one on the other; those that are named shine."""
    walls = [*room_walls(), quad("front", (-1, 0, 1), (0, 2, 0), (2, 0, 0))]
    panels = {
        "warm": (quad("warm", (-0.9, 0.6, -0.2), (0, 0.4, 0), (0, 0, 0.4)), [4.0, 2.0, 1.0]),
        "cool": (quad("cool", (0.2, 1.9, 0.2), (0.5, 0, 0), (0, 0, 0.5)), [0.5, 1.0, 2.0]),
    }
    meshes = walls + [mesh for mesh, _ in panels.values()]
    glow = [
        {"type": "area", "radiance": {"type": "rgb", "value": radiance}} if name in shining else None
        for name, (_, radiance) in panels.items()
    ]
    return build("room", meshes, [diffuse((0.6, 0.5, 0.4))] * len(meshes), [None] * len(walls) + glow)


@pytest.fixture(scope="module")
def traced() -> tuple[SurfacePoints, LampShares]:
    scene = lit_room("warm", "cool")
    points = draw_surface(scene, POINTS, 3, floor=1).points
    groups = group_lamps(scene, parse_lamps(()))
    assert [group.name for group in groups] == ["warm", "cool"]
    radiosity = Radiosity(scene, points, 4, 1024)
    return points, LampLight(radiosity, groups, 5).shares(points, 64, 6)


@pytest.mark.parametrize(("shining", "columns"), [(("warm", "cool"), [0, 1]), (("warm",), [0]), (("cool",), [1])])
def test_shares_are_the_light_of_their_lamps(traced, shining, columns):
    points, shares = traced
    a, b = static(lit_room(*shining), points, 256, 7)
    reference, found = 0.5 * (a + b), shares.radiance[:, columns].sum(axis=1)
    np.testing.assert_allclose(found.mean(axis=0), reference.mean(axis=0), rtol=0.05)
    scale = reference.mean()
    assert np.mean(np.abs(found - reference)) < 0.2 * scale
    assert np.corrcoef(found.ravel(), reference.ravel())[0, 1] > 0.95


def test_halves_are_independent_and_not_negative(traced):
    _, shares = traced
    assert shares.half_a.shape == (POINTS, 2, 3) and min(shares.half_a.min(), shares.half_b.min()) >= 0
    difference = np.abs(shares.half_a - shares.half_b).mean()
    assert 0 < difference < 0.5 * shares.radiance.mean()


def test_a_group_of_several_lamps_has_the_light_of_them_all(traced):
    points, apart = traced
    scene = lit_room("warm", "cool")
    groups = group_lamps(scene, parse_lamps(("all",)))
    assert [len(group.emitters) for group in groups] == [2]
    found = LampLight(Radiosity(scene, points, 4, 1024), groups, 8).shares(points, 64, 9).radiance[:, 0]
    expected = apart.radiance.sum(axis=1)
    np.testing.assert_allclose(found.mean(axis=0), expected.mean(axis=0), rtol=0.03)
    assert np.mean(np.abs(found - expected)) < 0.2 * expected.mean()


def test_glass_has_the_light_that_it_reflects():
    # A frosted pane across the room: what it lets through is no light of its own, in shares as in paths.
    room = lit_room("warm", "cool")
    pane = quad("pane", (-0.3, 0, -0.9), (0, 1.8, 0), (0, 0, 1.8))
    glass = {"type": "principledthin", "spec_trans": 0.5, "roughness": 0.5, "eta": 1.5}
    glow = [{"type": "area", "radiance": {"type": "rgb", "value": v}} for v in ([4.0, 2.0, 1.0], [0.5, 1.0, 2.0])]
    meshes = [*room.meshes, pane]
    bsdfs = [diffuse((0.6, 0.5, 0.4))] * len(room.meshes) + [glass]
    scene = build("frosted", meshes, bsdfs, [None] * (len(room.meshes) - 2) + [*glow, None])
    everywhere = draw_surface(scene, 4096, 3, floor=256).points
    points = everywhere[np.flatnonzero(everywhere.shape == len(meshes) - 1)]
    shares = LampLight(Radiosity(scene, everywhere, 4, 1024), group_lamps(scene, parse_lamps(())), 5).shares(
        points, 64, 6
    )
    a, b = static(scene, points, 256, 7)
    reference, found = 0.5 * (a + b), shares.radiance.sum(axis=1)
    np.testing.assert_allclose(found.mean(axis=0), reference.mean(axis=0), rtol=0.05)
    assert np.mean(np.abs(found - reference)) < 0.25 * reference.mean()


def test_a_floor_that_sees_no_other_surface_has_the_light_of_its_lamp():
    lamp = mi.load_dict({"type": "point", "position": [0, 1, 0], "intensity": {"type": "rgb", "value": [1, 1, 1]}})
    scene = build("floor", [quad("floor", (-1, 0, -1), (0, 0, 2), (2, 0, 0))], [diffuse((0.5,) * 3)], emitters=[lamp])
    points = draw_surface(scene, POINTS, 3, floor=1).points
    groups = group_lamps(scene, parse_lamps(()))
    found = LampLight(Radiosity(scene, points, 4, 64), groups, 5).shares(points, 16, 6).radiance[:, 0]
    a, b = static(scene, points, 16, 7)
    # The light of a point has no noise.
    np.testing.assert_allclose(found, 0.5 * (a + b), rtol=1e-3, atol=1e-6)


BULB = """<scene version="3.0.0">
    <shape type="cube" id="room"><boolean name="flip_normals" value="true"/>
        <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
    <shape type="rectangle" id="lamp"><transform name="to_world"><scale value="0.05"/><translate z="-0.6"/></transform>
        <bsdf type="diffuse"/><emitter type="area"><rgb name="radiance" value="100"/></emitter></shape>
    {glass}</scene>"""
THIN = """<shape type="rectangle" id="pane"><bsdf type="thindielectric"/></shape>"""
SLAB = """<shape type="cube" id="slab"><transform name="to_world"><scale x="0.999" y="0.999" z="0.05"/></transform>
    <bsdf type="dielectric"/></shape>"""


@pytest.mark.parametrize("glass", [THIN, SLAB], ids=["thin", "slab"])
def test_a_small_lamp_behind_clear_glass_is_found_by_shadow_rays(glass, tmp_path):
    # Of the rays that a BSDF chooses, one in hundreds meets the lamp: all that a point has would be noise.
    (tmp_path / "bulb.xml").write_text(BULB.format(glass=glass))
    scene = load(str(tmp_path / "bulb.xml"))
    everywhere = draw_surface(scene, 4096, 3, floor=1).points
    points = everywhere[np.flatnonzero(frames(scene, everywhere)[0][:, 2] > 0.99)[:POINTS]]
    light = LampLight(Radiosity(scene, everywhere, 4, 1024), group_lamps(scene, parse_lamps(())), 5)
    found = light.shares(points, 64, 6, 8)
    a, b = static(scene, points, 4096, 7)
    reference = 0.5 * (a + b)
    # Refraction brings the lamp 3 cm of 1.6 m nearer, 4 %; rays of the BSDF alone differ by 1.4 times the mean.
    np.testing.assert_allclose(found.radiance[:, 0].mean(axis=0), reference.mean(axis=0), rtol=0.06)
    assert np.abs(found.half_a - found.half_b).mean() < 0.1 * reference.mean()


@pytest.mark.parametrize("groups", [1, FEW_GROUPS, FEW_GROUPS + 3])
def test_lanes_are_added_up_by_block_and_group(groups):
    rng, lanes = np.random.default_rng(groups), 8
    light, group = rng.random((96, 3), np.float32), rng.integers(0, groups + 1, 96)
    expected = np.zeros((96 // lanes, groups, 3))
    for lane in np.flatnonzero(group < groups):
        expected[lane // lanes, group[lane]] += light[lane]
    L = mi.Spectrum(*(mi.Float(np.ascontiguousarray(c)) for c in light.T))
    found = sums_by_group(L, mi.UInt32(group.astype(np.uint32)), groups, lanes)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
