"""The built-in scenes: sound geometry, closed where they claim it, the same bytes every time."""

import numpy as np
import pytest
from built_scenes import built

from lightwell.core.lamps import parse_lamps
from lightwell.scenes.builtin import NAMES, build
from lightwell.scenes.builtin.kit import content_digest
from lightwell.scenes.free_air import even_directions, free_air, is_closed
from lightwell.scenes.lamps import group_lamps


@pytest.fixture(scope="module", params=NAMES)
def scene(request):
    return built(request.param)


@pytest.fixture(scope="module")
def courtyard():
    return built("courtyard")


def test_names():
    assert NAMES == ("cornell", "courtyard", "courtyard-day", "doorway", "loft", "two-rooms")


def test_an_unknown_name_says_which_exist():
    message = "no built-in scene 'atrium'; choose one of cornell, courtyard, courtyard-day, doorway, loft, two-rooms"
    with pytest.raises(ValueError, match=message):
        build("atrium")


def test_the_scene_is_clean_and_only_loft_and_doorway_have_lamps(scene):
    assert scene.warnings == []
    assert scene.has_static_light == (scene.name in ("loft", "doorway"))
    assert scene.source == f"builtin:{scene.name}"
    assert scene.cameras[0].name == "home"
    assert 5 <= len(scene.cameras) <= 7
    assert len({c.name for c in scene.cameras}) == len(scene.cameras)
    assert len({m.name for m in scene.meshes}) == len(scene.meshes)


def test_geometry_is_sound(scene):
    for mesh in scene.meshes:
        assert np.isfinite(mesh.positions).all() and np.isfinite(mesh.uv0).all(), mesh.name
        assert mesh.indices.max() < len(mesh.positions), mesh.name
        assert mesh.triangle_areas.min() > 0, mesh.name
        # float32 rounding of unit vectors
        assert np.abs(np.linalg.norm(mesh.normals, axis=1) - 1).max() < 1e-5, mesh.name


def test_normals_agree_with_the_winding(scene):
    for mesh in scene.meshes:
        a, b, c = (mesh.positions[mesh.indices[:, k]].astype(np.float64) for k in range(3))
        face = np.cross(b - a, c - a)
        face /= np.linalg.norm(face, axis=1, keepdims=True)
        agreement = np.einsum("tvk,tk->tv", mesh.normals[mesh.indices], face)
        # The roundest surface is the leaf, folded by 25 degrees and bent: its normals stay within 60 degrees.
        assert agreement.min() > 0.5, mesh.name


def test_cameras_are_in_free_air_and_see_the_scene(scene):
    air = free_air(scene)
    eyes = np.array([c.position for c in scene.cameras])
    views = air.views(eyes)
    inside = np.all((eyes > scene.bounds[0]) & (eyes < scene.bounds[1]), axis=1)
    # The home camera of the Cornell box stands before its open front, where half of the rays meet nothing.
    assert inside[1:].all()
    assert (views.back[inside] < 0.05).all()
    assert (air.distance(eyes) > 0.03).all()


@pytest.mark.parametrize("name, inside", [("two-rooms", (1.5, 1.2, 0.3)), ("two-rooms", (-1.5, 1.2, 0.3))])
def test_closed_rooms_have_no_gap(name, inside):
    """From inside no ray escapes and none meets a back face."""
    scene = built(name)
    points = np.asarray(inside) + 0.2 * even_directions(64)
    hit, back, *_ = free_air(scene).trace(np.repeat(points, 1024, axis=0), np.tile(even_directions(1024), (64, 1)))
    assert hit.all()
    assert not back.any()


@pytest.mark.parametrize("room", [(3.9, 1.5, 0.5), (-4.2, 1.5, -5.7), (-5.0, 1.5, 0.0), (0.0, 5.0, 5.0)])
def test_rooms_of_the_courtyard_see_the_sky_through_the_shaft_only(courtyard, room):
    """Rays that escape leave through the open top of the shaft; back faces are furniture standing on a floor."""
    air = free_air(courtyard)
    ways = even_directions(8192)
    hit, back, *_ = air.trace(np.tile(room, (len(ways), 1)), ways)
    assert back.mean() < 0.002
    top = np.asarray(room) + ways[~hit] * ((6.9 - room[1]) / ways[~hit][:, 1:2])
    assert (ways[~hit][:, 1] > 0).all()
    assert (np.abs(top[:, [0, 2]]) <= 2.2).all()


def test_the_wall_between_the_rooms_is_thin_and_has_two_sides():
    walls = [m for m in built("two-rooms").meshes if m.name in ("warm_white", "cool_white")]
    ends = [np.unique(np.abs(m.positions[:, 0]).round(4)).min() for m in walls]
    np.testing.assert_allclose(ends, 0.025, atol=1e-4)


def test_solid_furniture_is_closed(courtyard):
    """Things that do not stand with an open bottom on the floor are closed by themselves."""
    closed = {m.name for m in courtyard.meshes if is_closed(m)}
    assert {"vase", "bowl", "teal_door", "plant_stems", "railing_grip"} <= closed


def test_the_courtyard_is_small_enough_for_the_web(courtyard):
    assert 2_000 < sum(len(m.indices) for m in courtyard.meshes) < 20_000


def test_textures_repeat_without_a_seam(courtyard):
    """The step across the border is no larger than the steps inside (the paintings do not repeat)."""
    for material in courtyard.materials:
        if material.base_color_texture is None or material.name.startswith("painting"):
            continue
        pixels = material.base_color_texture.image.pixels[..., :3].astype(float)
        assert pixels.shape[:2] == (512, 512)
        for axis in (0, 1):
            inner = np.abs(np.diff(pixels, axis=axis)).mean(axis=(1 - axis, 2))
            seam = np.abs(pixels.take(0, axis) - pixels.take(-1, axis)).mean()
            # Joints are the largest steps; one of them may lie on the border.
            assert seam <= 1.1 * inner.max() + 1, material.name


def test_the_loft_has_nine_lamps_and_a_screen():
    groups = group_lamps(built("loft"), parse_lamps(()))
    names = {"counter", "cove", "pendants", "floor", "ball", "desk", "bath", "bed_left", "bed_right", "screen"}
    assert {group.name for group in groups} == names


def test_the_digest_is_the_same_every_time(scene):
    again = build(scene.name)
    assert again.digest == scene.digest
    assert [m.name for m in again.meshes] == [m.name for m in scene.meshes]


def test_digests_tell_scenes_apart():
    assert built("cornell").digest != built("two-rooms").digest


def test_the_digest_notices_a_moved_vertex():
    scene = build("two-rooms")
    before = content_digest("x", scene.meshes, scene.materials)
    scene.meshes[0].positions[0, 0] += 1e-3
    assert content_digest("x", scene.meshes, scene.materials) != before
