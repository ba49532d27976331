"""Surface points: uniform in area, on sides that see air, rebuilt exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from lightwell.scenes import load
from lightwell.scenes.assemble import assemble
from lightwell.scenes.scene import Material
from lightwell.transport.interactions import interaction
from lightwell.transport.pieces import whole
from lightwell.transport.point_rejection import Rejection, reject, room
from lightwell.transport.queries import ROWS_AT_ONCE, frames, make_query
from lightwell.transport.samples import columns_of
from lightwell.transport.surface import candidates, draw_surface, sample_surface

from . import rooms


def test_samples_are_uniform_in_area(cornell):
    # χ² over 8 x 8 cells of ceiling, back wall and side walls, all of 4 m², seen from inside alone.
    points = sample_surface(cornell, 20000, 1)
    position = frames(cornell, points)[0]
    counts = []
    for shape, (i, j) in {1: (0, 2), 2: (0, 1), 3: (1, 2), 4: (1, 2)}.items():
        p = position[points.shape == shape] + [1, 0, 1]
        counts.append(np.histogram2d(p[:, i], p[:, j], bins=8, range=[[0, 2], [0, 2]])[0])
    # Scrambled Sobol points are more even than random ones, so that only the upper tail counts.
    assert stats.chisquare(np.ravel(counts)).pvalue > 0.01


def test_a_clumped_histogram_fails_the_chi_square(cornell):
    # The planted bug: barycentric weights without the square root crowd one corner of every triangle.
    u = np.random.default_rng(0).random((20000, 7))
    u[:, 1] **= 2
    points = candidates(cornell, u, whole(cornell), np.eye(7)[1])
    p = frames(cornell, points)[0] + [1, 0, 1]
    counts = np.histogram2d(p[:, 0], p[:, 2], bins=8, range=[[0, 2], [0, 2]])[0]
    assert stats.chisquare(np.ravel(counts)).pvalue < 1e-6


def test_shares_of_objects(cornell):
    draw = draw_surface(cornell, 16384, 2)
    # Floor less two footprints of 0.6 m x 0.6 m; boxes without their undersides.
    expected = np.array([4 - 0.72, 4, 4, 4, 4, 4 * 0.6 * 1.2 + 0.36, 4 * 0.36 + 0.36])
    # 35,000 candidates: 0.5 % of an area at one standard deviation, taken 4 times.
    np.testing.assert_allclose(draw.visible_area, expected, rtol=0.02)
    shares = np.bincount(draw.points.shape) / len(draw.points)
    np.testing.assert_allclose(shares, expected / expected.sum(), rtol=0.03)
    # The weights undo what little the floors changed.
    assert draw.weight.mean() == pytest.approx(1, abs=1e-3)


def test_small_objects_get_their_floor():
    tiny = rooms.box("tiny", (0, 0.5, 0), (0.02, 0.52, 0.02))
    scene = rooms.build("tiny", [*rooms.room_walls(), tiny], [rooms.diffuse(rooms.WHITE)] * 6)
    draw = draw_surface(scene, 8192, 3, floor=256)
    is_tiny = draw.points.shape == 5
    assert is_tiny.sum() == 256
    # Weighted, it counts for its area again: 24 cm² of 20 m² (of so many points, 5 % at one deviation).
    share = draw.weight[is_tiny].sum() / draw.weight.sum()
    assert share == pytest.approx(6 * 0.02**2 / 20, rel=0.2)


def test_a_lone_solid_is_no_room():
    """Rays from within its bounds meet its inside alone."""
    white, solid = rooms.diffuse(rooms.WHITE), {"type": "diffuse"}
    scene = rooms.build("solid", [rooms.box("solid", (-1, -1, -1), (1, 1, 1))], [solid])
    assert not room(scene) and len(draw_surface(scene, 64, 1).points) == 64
    # A closed box that is seen from inside, and one with something in it.
    assert room(rooms.furnace(0.5))
    shell = rooms.box("shell", (-1, -1, -1), (1, 1, 1), inward=True)
    assert room(rooms.build("shell", [shell, rooms.box("inner", (0, 0, 0), (0.2, 0.2, 0.2))], [white, solid]))


@pytest.mark.parametrize("is_open", [False, True])
def test_nothing_under_a_box_on_a_floor(is_open):
    low, high = (-0.3, 0, -0.3), (0.3, 0.6, 0.3)
    walls = rooms.room_walls() if not is_open else rooms.room_walls()[:1]
    scene = rooms.build("box", [*walls, rooms.box("box", low, high)], [rooms.diffuse(rooms.WHITE)] * (len(walls) + 1))
    assert room(scene) is not is_open
    report = Rejection()
    points = sample_surface(scene, 16384, 4, report=report)
    position, _, flat = frames(scene, points)
    up = np.sign((flat * points.view).sum(axis=1)) * flat[:, 1] > 0.5
    under = (np.abs(position[:, [0, 2]]) < 0.3).all(axis=1) & (position[:, 1] < 1e-4)
    # The floor's upper side beneath the box, and the box's underside, are gone; the rest of the floor is not.
    assert not (under & (up | (points.shape == len(walls)))).any()
    assert ((points.shape == 0) & ~under).any()
    assert report.covered > 0 and report.candidates == report.dropped + (report.candidates - report.dropped)


def plate(bsdf: dict):
    """A room of 2 m with a plate 3 cm above the middle of its floor, and points on both."""
    cover = rooms.quad("plate", (-0.7, 0.03, -0.7), (0, 0, 1.4), (1.4, 0, 0))
    scene = rooms.build("plate", [*rooms.room_walls(), cover], [rooms.diffuse(rooms.WHITE)] * 5 + [bsdf])
    report = Rejection()
    points = sample_surface(scene, 16384, 4, report=report)
    position, _, flat = frames(scene, points)
    up = (flat * points.view).sum(axis=1) * flat[:, 1] > 0
    # Away from the edge of the plate, from below which some rays leave.
    middle = (np.abs(position[:, [0, 2]]) < 0.3).all(axis=1)
    return report, points.shape, position, middle, up


def test_a_floor_under_a_floor_is_buried():
    report, shape, position, middle, up = plate(rooms.diffuse(rooms.WHITE))
    floor = (shape == 0) & (position[:, 1] < 1e-4) & up
    assert report.buried > 100
    # The rest of the floor has more than 500 points per square metre; of 0.36 m² one ray in 300 leaves.
    assert (floor & ~middle).sum() > 1500 and (floor & middle).sum() < 0.2 * 500 * 0.36
    # What people see of the plate is not.
    assert (middle & (shape == 5) & up).sum() > 100


def test_a_floor_under_glass_is_not_buried():
    report, shape, position, middle, up = plate({"type": "thindielectric"})
    assert report.buried == 0
    assert ((shape == 0) & (position[:, 1] < 1e-4) & up & middle).sum() > 60


def test_the_inside_of_a_flat_case_is_not_buried():
    # All that people see of it is near its other side.
    shell = rooms.box("case", (-1, 0, -1), (1, 0.01, 1), inward=True)
    scene = rooms.build("case", [shell], [rooms.diffuse(rooms.WHITE)])
    report = Rejection()
    assert len(sample_surface(scene, 1024, 1, report=report)) > 512 and report.buried == 0


@pytest.mark.parametrize(("edge", "buried"), [(0.01, True), (0.3, False)])
def test_what_small_bodies_enclose_is_buried(edge, buried):
    # A case without a bottom on the floor, drawn from inside alone: of a small one nobody sees that.
    case = rooms.box("case", (0.2, 0, 0.2), (0.2 + edge, edge, 0.2 + edge), inward=True)
    case = replace(case, indices=np.delete(case.indices, [4, 5], axis=0))
    white = Material("white", base_color=(0.8, 0.8, 0.8, 1.0), metallic=0.0)
    scene = assemble("case", [*rooms.room_walls(), case], [white], digest="case")
    report = Rejection()
    draw_surface(scene, 4096, 4, only=np.arange(6) == 5, report=report)
    assert (report.buried > 0.4 * report.candidates) == buried and (report.buried == 0) != buried


def test_points_inside_a_solid_are_dropped():
    # A shelf that runs through a closed block: the part within the block goes, the rest stays, on both sides.
    block = rooms.box("block", (-0.5, 0, -0.5), (0.5, 1, 0.5))
    shelf = rooms.quad("shelf", (-0.9, 0.5, -0.3), (0, 0, 0.6), (1.8, 0, 0))
    scene = rooms.build("shelf", [*rooms.room_walls(), block, shelf], [rooms.diffuse(rooms.WHITE)] * 7)
    points = sample_surface(scene, 8192, 5)
    on_shelf = points.shape == 6
    position, _, flat = frames(scene, points)
    assert not (np.abs(position[on_shelf, 0]) < 0.5).any()
    side = (flat * points.view).sum(axis=1)[on_shelf] > 0
    assert 0.4 < side.mean() < 0.6


def test_hidden_skins_are_dropped():
    # A second skin outside the room and a hollow box without a lid face down: neither is closed, both are hidden.
    skin = rooms.quad("skin", (-1.2, -0.2, -1.2), (2.4, 0, 0), (0, 2.4, 0))
    hollow = rooms.box("hollow", (-0.3, 0, -0.3), (0.3, 0.5, 0.3))
    hollow = replace(hollow, indices=hollow.indices[[k for k in range(12) if k not in (4, 5)]])
    meshes = [*rooms.room_walls(), skin, hollow]
    camera = rooms.Camera((0, 1, 0.9), (0, 1, 0))
    scene = rooms.build("skins", meshes, [rooms.diffuse(rooms.WHITE)] * 7, cameras=[camera])
    report = Rejection()
    draw = draw_surface(scene, 8192, 9, report=report)
    # The inner back wall (4 m²) is seen; its outside and the inside of the skin see each other alone.
    np.testing.assert_allclose(draw.visible_area[[2, 5]], [4, 0], rtol=0.03)
    assert not (draw.points.shape == 5).any()
    # The box shows four sides and its top, outside only.
    assert draw.visible_area[6] == pytest.approx(4 * 0.6 * 0.5 + 0.36, rel=0.05)
    assert report.unreachable > 0


def test_a_camera_inside_a_body_is_no_witness():
    block = rooms.box("block", (-0.5, 0, -0.5), (0.5, 1, 0.5))
    camera = rooms.Camera((0, 0.5, 0), (0, 1, 0))
    scene = rooms.build("blind", [*rooms.room_walls(), block], [rooms.diffuse(rooms.WHITE)] * 6, cameras=[camera])
    assert draw_surface(scene, 2048, 10).visible_area[1] == pytest.approx(4, rel=0.1)


def test_one_sided_materials_have_one_side():
    wall = {"type": "diffuse"}
    scene = rooms.build("one-sided", [rooms.quad("floor", (-1, 0, -1), (0, 0, 2), (2, 0, 0))], [wall])
    points = sample_surface(scene, 512, 6, is_open=True)
    assert (points.view[:, 1] > 0).all()


def test_a_scene_without_air_says_so():
    with pytest.raises(ValueError, match=r"has no surface that sees air .* is_open=True"):
        sample_surface(rooms.plane(), 16, 0, is_open=False)


def test_rejection_counts_add_up(cornell):
    points = candidates(cornell, np.random.default_rng(1).random((4096, 7)), whole(cornell))
    report = Rejection()
    keep = reject(cornell, points, report=report)
    assert report.candidates == 4096 and report.dropped == (~keep).sum()
    assert "of 4096 candidate points dropped" in str(report)


def test_seeds(cornell):
    first, same, other = (sample_surface(cornell, 1024, s) for s in (1, 1, 2))
    for name in ("shape", "triangle", "barycentric", "view"):
        np.testing.assert_array_equal(getattr(first, name), getattr(same, name))
    assert not np.array_equal(first.barycentric, other.barycentric)


def test_views_are_on_the_viewers_side(glossy):
    points = sample_surface(glossy, 4096, 7)
    query = make_query(glossy, points, (0, 1, 0))
    np.testing.assert_allclose(np.linalg.norm(query.view, axis=1), 1, rtol=1e-5)
    cosine = (query.normal * query.view).sum(axis=1)
    assert (cosine >= -1e-6).all()
    # Diffuse walls: uniform over the hemisphere, cosine uniform in [0, 1]; Kolmogorov-Smirnov.
    assert stats.kstest(cosine[points.shape == 1], "uniform").pvalue > 0.01
    # The floor of rough plastic: half of the views by projected area, whose cosine has the distribution c².
    assert stats.kstest(cosine[points.shape == 0], lambda c: 0.5 * c + 0.5 * c * c).pvalue > 0.01


def test_interactions_are_exact(cornell):
    points = sample_surface(cornell, 512, 8)
    si = interaction(cornell, points)
    position, _, flat = frames(cornell, points)
    np.testing.assert_allclose(np.array(si.p).T, position, atol=1e-6)  # a rounding or two of single precision
    np.testing.assert_allclose(np.array(si.n).T, flat, atol=1e-5)
    np.testing.assert_allclose(np.array(si.to_world(si.wi)).T, points.view, atol=1e-5)


def test_points_on_some_meshes_only(cornell):
    only = np.isin(np.arange(len(cornell.meshes)), [1, 3])
    draw = draw_surface(cornell, 4000, 1, floor=0, only=only)
    assert set(np.unique(draw.points.shape)) == {1, 3} and len(draw.points) == 4000
    # Both are walls of 4 m^2 that are seen from inside alone.
    assert np.mean(draw.points.shape == 1) == pytest.approx(0.5, abs=0.03)
    assert draw.visible_area[~only].sum() == 0


def test_backs_of_one_sided_materials_can_be_left_out():
    # A sheet in a room is seen from both sides; rasterisers draw one.
    sheet = rooms.quad("sheet", (-0.5, 0.5, 0), (1, 0, 0), (0, 1, 0))
    scene = rooms.build("sheet", [*rooms.room_walls(), sheet], [rooms.diffuse(rooms.WHITE)] * 6)
    for shown, share in ((False, 0.5), (True, 0.0)):
        points = draw_surface(scene, 4096, 1, floor=512, shown=shown).points
        points = points[np.flatnonzero(points.shape == 5)]
        assert np.mean(points.view[:, 2] < 0) == pytest.approx(share, abs=0.05)


def test_what_is_seen_from_behind_alone_keeps_its_backs():
    # A sheet on a box, turned towards it: nothing sees its front.
    sheet = rooms.quad("sheet", (-1, 1, -1), (2, 0, 0), (0, 0, 2))
    block = rooms.box("block", (-2, 0, -2), (2, 1, 2))
    scene = rooms.build("backs", [sheet, block], [rooms.diffuse(rooms.WHITE)] * 2)
    draw = draw_surface(scene, 256, 1, floor=0, is_open=True, only=np.array([True, False]), shown=True)
    assert (draw.points.shape == 0).all() and (draw.points.view[:, 1] > 0).all()


def test_points_are_the_same_one_by_one_and_in_blocks_of_many_threads():
    scene = load("courtyard")
    points = draw_surface(scene, 2 * ROWS_AT_ONCE + 100, 3).points
    rows = np.r_[0:20, ROWS_AT_ONCE - 20 : ROWS_AT_ONCE + 20, 2 * ROWS_AT_ONCE : 2 * ROWS_AT_ONCE + 20]
    many, few = make_query(scene, points, (0, 1, 0)), make_query(scene, points[rows], (0, 1, 0))
    for name, values in columns_of(few).items():
        np.testing.assert_array_equal(getattr(many, name)[rows], values)
    for found, expected in zip(frames(scene, points), frames(scene, points[rows])):
        np.testing.assert_array_equal(found[rows], expected)
    # By the shortest formula: the middle of the corners, weighted.
    for row in rows[:5]:
        mesh, (b1, b2) = scene.meshes[points.shape[row]], points.barycentric[row].astype(np.float64)
        corners = mesh.positions[mesh.indices[points.triangle[row]]].astype(np.float64)
        np.testing.assert_allclose(many.position[row], [1 - b1 - b2, b1, b2] @ corners, rtol=1e-6, atol=1e-6)
