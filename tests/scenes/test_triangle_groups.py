"""Scenes of many triangles: groups of small ones, their charts, and the packing of boxes."""

from time import perf_counter

import numpy as np
import pytest

from lightwell.scenes import load
from lightwell.scenes.assemble import assemble
from lightwell.scenes.atlas import build, charted, padding
from lightwell.scenes.atlas_coverage import coverings, texel_hits
from lightwell.scenes.atlas_shelves import shelved
from lightwell.scenes.default_light import under_sky
from lightwell.scenes.scene import Material, Mesh
from lightwell.scenes.triangle_groups import MOST_GROUPS, MOST_TRIANGLES, triangle_groups
from lightwell.scenes.welding import equal_rows
from lightwell.transport.point_rejection import Rejection
from lightwell.transport.tables import tables
from lightwell.transport.visible import visible_sides

SQUARES, SIZE = 270, 512


def terrain(squares: int) -> Mesh:
    """Hills of squares x squares x 2 triangles over 10 x 10 m."""
    z, x = np.mgrid[0 : squares + 1, 0 : squares + 1] * (10.0 / squares)
    positions = np.stack([x, np.sin(x) * np.cos(z), z], axis=-1).reshape(-1, 3).astype(np.float32)
    row, column = np.mgrid[0:squares, 0:squares]
    a = (row * (squares + 1) + column).reshape(-1)
    b, c, d = a + squares + 1, a + squares + 2, a + 1
    return Mesh(
        "hills", positions, np.concatenate([np.stack(t, axis=1) for t in ((a, b, c), (a, c, d))]).astype("u4"), 0
    )


def roof() -> Mesh:
    positions = np.float32([[0, 4, 0], [0, 4, 10], [10, 4, 10], [10, 4, 0]])
    return Mesh("roof", positions, np.uint32([[0, 1, 2], [0, 2, 3]]), 0)


@pytest.fixture(scope="module")
def hills():
    grey = Material("grey", (0.5, 0.5, 0.5, 1), metallic=0.0)
    return under_sky(assemble("hills", [terrain(SQUARES), roof()], [grey]))


@pytest.fixture(scope="module")
def atlas(hills):
    lit = np.zeros((2, len(tables(hills).area)), bool)
    lit[0] = True
    return build(hills, SIZE, lit, mips=1)


def test_small_triangles_of_many_form_few_groups_and_large_ones_stay_alone(hills):
    groups = triangle_groups(hills)
    assert 2 * SQUARES**2 > MOST_TRIANGLES
    assert MOST_GROUPS / 4 < groups.count <= MOST_GROUPS
    assert np.flatnonzero(groups.alone).tolist() == [2 * SQUARES**2, 2 * SQUARES**2 + 1]
    assert groups.tested.sum() <= 4 * groups.count + 2


def test_scenes_of_few_triangles_have_no_groups():
    scene = assemble("roof", [roof()], [Material("grey", (0.5, 0.5, 0.5, 1))])
    assert triangle_groups(scene).count == 0
    assert triangle_groups(scene).tested.all()


def test_what_is_known_of_one_triangle_holds_for_its_group(hills):
    groups = triangle_groups(hills)
    sides = np.zeros((2, len(groups.label)), bool)
    sides[1, 5] = True
    found = groups.spread(sides)
    assert (found[1] == (groups.label == groups.label[5])).all()
    assert not found[0].any()


def test_the_search_for_visible_sides_tests_a_few_triangles_of_each_group(hills):
    groups, report = triangle_groups(hills), Rejection()
    seen = groups.spread(visible_sides(hills, report=report, within=groups.tested))
    assert report.candidates < 50_000
    assert seen[0].mean() > 0.99


def test_charts_of_groups_fill_the_square_and_do_not_touch(atlas):
    stored = atlas.chart >= 0
    assert stored[0].all() and not stored[1].any()
    # 512 x 512 texels are few for so many charts; most of the rest is padding.
    assert atlas.coverage > 0.2
    _, owner = texel_hits(atlas.uv[stored], atlas.chart[stored], SIZE)
    # Texels that lie nearer than the padding belong to the same chart.
    for step in range(1, padding(1) + 1):
        for here, there in ((owner[step:], owner[:-step]), (owner[:, step:], owner[:, :-step])):
            assert not ((here >= 0) & (there >= 0) & (here != there)).any()


def test_light_is_continuous_within_the_chart_of_a_group(hills, atlas):
    groups, mesh = triangle_groups(hills), hills.meshes[0]
    group = np.flatnonzero(groups.label == groups.label[1000])
    corner = mesh.indices[group].reshape(-1)
    uv = atlas.uv[0, group].reshape(-1, 2)
    first, kind = equal_rows(corner[:, None])
    assert len(first) < len(corner) / 3
    assert np.abs(uv - uv[first][kind]).max() < 1e-6


def test_the_written_mesh_has_one_vertex_for_every_place_in_the_light_map(hills, atlas):
    made = charted(hills, atlas)
    assert sum(len(mesh.indices) for mesh in made.meshes) == 2 * SQUARES**2 + 2
    # Vertices on the border of a group are there once for each of its charts; apart, there would be six of each.
    assert len(made.meshes[0].positions) < 2 * len(hills.meshes[0].positions)


def test_boxes_in_rows_do_not_overlap():
    rng = np.random.default_rng(0)
    square = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]])
    laid = [(square * rng.uniform(1, 40, 2).astype("f4"), np.uint32([[0, 1, 2], [0, 2, 3]]), 1) for _ in range(400)]
    scale, packing = shelved(laid, SIZE, 4)
    corners = np.concatenate([points[rows] for points, rows in packing.meshes])
    assert corners.min() >= 0 and corners.max() <= SIZE - 5
    assert coverings(corners, SIZE, SIZE).max() == 1
    for (points, _, _), (placed, _) in zip(laid, packing.meshes):
        assert sorted(np.ptp(placed, axis=0)) == pytest.approx(sorted(scale * np.ptp(points, axis=0)), rel=1e-4)


def test_too_many_boxes_for_the_padding_do_not_fit():
    corner = (np.float32([[0, 0], [1, 0], [0, 1]]), np.uint32([[0, 1, 2]]), 1)
    assert shelved([corner] * 400, 64, 4) is None


def test_equal_rows_are_numbered_as_numpy_does():
    rows = np.random.default_rng(0).integers(-2, 3, (500, 3)).astype(np.float32)
    found, inverse = np.unique(rows, axis=0, return_inverse=True)
    first, kind = equal_rows(rows)
    assert (rows[first] == found).all()
    assert (kind == inverse.reshape(-1)).all()


def test_a_search_whose_time_is_over_still_packs_all_charts():
    scene = load("two-rooms")
    lit = np.zeros((2, len(tables(scene).area)), bool)
    lit[0] = True
    atlas = build(scene, 512, lit, mips=1, deadline=perf_counter())
    stored = atlas.chart >= 0
    assert (stored == lit).all()
    assert texel_hits(atlas.uv[stored], atlas.chart[stored], 512)[0].max() == 1
    assert atlas.coverage < build(scene, 512, lit, mips=1).coverage
