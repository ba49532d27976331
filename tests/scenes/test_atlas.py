"""The atlas: charts that do not touch, padding that holds at every mip level, the author's coordinates, sheets."""

import types
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from lightwell.scenes import load
from lightwell.scenes.assemble import assemble
from lightwell.scenes.atlas import build, charted, own_fault, padding, texel_hits
from lightwell.scenes.atlas_charts import FAINT, TWICE, coverings, fitted
from lightwell.scenes.scene import Material, Mesh

SIZE, LIT_FRONTS = 256, np.array([[True], [False]])


@pytest.fixture(scope="module")
def rooms():
    scene = load("two-rooms")
    triangles = sum(len(mesh.indices) for mesh in scene.meshes)
    return scene, build(scene, 512, np.repeat(LIT_FRONTS, triangles, axis=1), mips=3)


def quads(**second) -> list[Mesh]:
    """A floor and a wall."""
    floor = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]], np.float32)
    wall = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    indices = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    return [Mesh(n, p, indices, 0, uv1=second.get(n)) for n, p in (("floor", floor), ("wall", wall))]


def scene_of(meshes: list[Mesh]):
    return assemble("quads", meshes, [Material("grey", (0.5, 0.5, 0.5, 1), metallic=0.0)])


def fronts(scene) -> np.ndarray:
    return np.repeat(LIT_FRONTS, sum(len(mesh.indices) for mesh in scene.meshes), axis=1)


def leaking(atlas, mip: int) -> int:
    """Texels of charts whose bilinear read at a mip level mixes in a texel that belongs to another chart."""
    stored = atlas.chart >= 0
    _, owner = texel_hits(atlas.uv[stored], atlas.chart[stored], atlas.size)
    index = distance_transform_edt(owner < 0, return_indices=True)[1]
    owns = owner[tuple(index)]  # dilation: every texel holds the value of the nearest chart
    block = 2**mip
    tiles = owns.reshape(atlas.size // block, block, atlas.size // block, block).transpose(0, 2, 1, 3)
    low, high = tiles.min(axis=(2, 3)), tiles.max(axis=(2, 3))
    y, x = np.nonzero(owner >= 0)
    at = [np.clip((c + 0.5) / block - 0.5, 0, atlas.size // block - 1) for c in (y, x)]
    wrong = np.zeros(len(y), bool)
    for dy in (0, 1):
        for dx in (0, 1):
            row, column = (np.minimum(np.floor(a).astype(int) + d, len(tiles) - 1) for a, d in zip(at, (dy, dx)))
            wrong |= (low[row, column] != owner[y, x]) | (high[row, column] != owner[y, x])
    return int(wrong.sum())


@pytest.mark.parametrize("mip", [0, 1, 2, 3])
def test_no_texel_of_a_chart_reads_another_at_any_promised_mip(rooms, mip):
    assert leaking(rooms[1], mip) == 0


def test_less_padding_than_promised_is_caught(rooms):
    scene, atlas = rooms
    tight = build(scene, 512, atlas.chart >= 0, mips=0)
    assert leaking(tight, 0) == 0
    assert leaking(tight, 3) > 0


def test_charts_do_not_overlap_and_cover_most_of_the_square(rooms):
    scene, atlas = rooms
    stored = atlas.chart >= 0
    hits, _ = texel_hits(atlas.uv[stored], atlas.chart[stored], atlas.size)
    assert hits.max() == 1
    roomy = build(scene, 1024, stored, mips=1)
    assert roomy.coverage > 0.7


def test_the_area_of_a_chart_is_that_of_its_triangles(rooms):
    """Texels per metre are the same everywhere, but that charts are rounded up to whole texels."""
    scene, atlas = rooms
    a, b, c = (atlas.uv[0][:, k].astype(float) for k in range(3))
    u, v = b - a, c - a
    texels = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    area = np.concatenate([mesh.triangle_areas for mesh in scene.meshes])
    large = area > 1.0
    ratio = texels[large] / area[large]
    assert large.sum() > 8 and ratio.std() / ratio.mean() < 0.02


def test_a_valid_second_set_is_kept():
    own = np.array([[0.1, 0.1], [0.1, 0.4], [0.4, 0.4], [0.4, 0.1]], np.float32)
    scene = scene_of(quads(floor=own, wall=own + np.float32([0.5, 0])))
    atlas = build(scene, SIZE, fronts(scene), mips=1)
    assert atlas.origin.startswith("the author")
    assert np.array_equal(atlas.uv[0, 0], own[[0, 1, 2]])


@pytest.mark.parametrize(
    ("shift", "scale", "fault"),
    [
        ((0.0, 0.0), 1.0, "used twice"),
        ((0.8, 0.0), 1.0, "leave"),
        ((0.303, 0.0), 1.0, "within"),
        ((0.5, 0.0), 0.0, "no area"),
        ((np.nan, 0.0), 1.0, "NaN"),
    ],
)
def test_an_invalid_second_set_is_replaced_and_the_reason_told(shift, scale, fault):
    own = np.array([[0.1, 0.1], [0.1, 0.4], [0.4, 0.4], [0.4, 0.1]], np.float32)
    scene = scene_of(quads(floor=own, wall=own))
    other = own * np.float32(scale) + np.float32(shift)
    scene.meshes[1] = replace(scene.meshes[1], uv1=other)
    assert fault in own_fault(scene, SIZE, fronts(scene), 1)
    assert build(scene, SIZE, fronts(scene), 1).origin.startswith("xatlas")


def test_triangles_of_no_area_are_laid_flat_beside_the_others():
    wall = quads()[0]
    # Three corners on a line but for rounding: xatlas flattens them to NaN.
    line = np.array([[0, 2, 0], [0.46895778, 2, 0], [0.44403672, 2, 1e-8]], np.float32)
    sliver = Mesh("sliver", line, np.array([[0, 1, 2]], np.uint32), 0)
    scene = scene_of([wall, sliver])
    atlas = build(scene, SIZE, fronts(scene), mips=1)
    assert np.isfinite(atlas.uv).all()
    assert atlas.coverage > 0.3
    assert np.array_equal(atlas.chart[0] >= 0, np.ones(3, bool))


def test_a_sheet_lit_from_both_sides_gets_two_charts_and_two_meshes():
    scene = scene_of(quads()[:1])
    atlas = build(scene, SIZE, np.ones((2, 2), bool), mips=1)
    front, back = (
        atlas.lookup(np.zeros(1, int), np.zeros(1, int), np.full((1, 2), 1 / 3), np.full(1, s)) for s in (0, 1)
    )
    assert np.abs(front - back).max() * SIZE > 2 * padding(1)
    meshes = charted(scene, atlas).meshes
    assert [mesh.name for mesh in meshes] == ["floor", "floor (back)"]
    normals = [
        np.cross(m.positions[i[1]] - m.positions[i[0]], m.positions[i[2]] - m.positions[i[0]])
        for m in meshes
        for i in m.indices[:1]
    ]
    assert np.dot(*normals) < 0


def test_the_meshes_of_a_double_sided_sheet_are_culled_and_the_rest_is_not():
    # Drawn from both sides, the two meshes of a sheet would cover each other.
    scene = scene_of(quads())
    scene = replace(scene, materials=[replace(scene.materials[0], double_sided=True)])
    sides = np.ones((2, 4), bool)
    sides[1, 1:] = False
    made = charted(scene, build(scene, SIZE, sides, mips=1))
    found = {mesh.name: (len(mesh.indices), made.materials[mesh.material].double_sided) for mesh in made.meshes}
    assert found == {"floor (one chart)": (1, True), "floor": (1, False), "floor (back)": (1, False), "wall": (2, True)}
    assert made.materials[0].double_sided and len(made.materials) == 2


def test_the_back_of_a_lamp_whose_back_is_dark_does_not_emit():
    scene = scene_of(quads()[:1])
    lamp = replace(scene.materials[0], emissive=(5.0, 5.0, 5.0), double_sided=True, dark_back=True)
    scene = replace(scene, materials=[lamp], meshes=[replace(scene.meshes[0], emission=(5.0, 5.0, 5.0))])
    made = charted(scene, build(scene, SIZE, np.ones((2, 2), bool), mips=1))
    found = {mesh.name: (mesh.emission, made.materials[mesh.material].emissive) for mesh in made.meshes}
    dark = (0.0, 0.0, 0.0)
    assert found == {"floor": ((5.0, 5.0, 5.0), (5.0, 5.0, 5.0)), "floor (back)": (dark, dark)}


def test_triangles_that_are_not_stored_read_the_nearest_that_is():
    scene = scene_of(quads())
    sides = fronts(scene)
    sides[:, 3] = False
    atlas = build(scene, SIZE, sides, mips=1)
    other = atlas.uv[0, 2].mean(axis=0)
    assert np.allclose(atlas.uv[:, 3], other) and atlas.chart[0, 3] < 0


def test_a_side_that_is_not_stored_reads_the_other_one():
    scene = scene_of(quads()[:1])
    atlas = build(scene, SIZE, fronts(scene), mips=1)
    assert np.array_equal(atlas.uv[0], atlas.uv[1])


def test_written_meshes_keep_every_corner(rooms):
    scene, atlas = rooms
    for number, (mesh, made) in enumerate(zip(scene.meshes, charted(scene, atlas).meshes)):
        assert np.array_equal(made.positions[made.indices], mesh.positions[mesh.indices])
        rows = slice(atlas.first[number], atlas.first[number + 1])
        assert np.array_equal(made.uv1[made.indices], atlas.uv[0, rows])


def test_too_small_a_square_is_one_line():
    scene = load("two-rooms")
    with pytest.raises(
        ValueError, match=r"atlas: \d+ charts with 13 texels of padding do not fit into 64 x 64"
    ) as error:
        build(scene, 64, fronts(scene), mips=3)
    assert "--size" in str(error.value) and "\n" not in str(error.value)


def test_faint_sides_get_fewer_texels_and_the_others_more():
    scene = scene_of(quads())
    lit = fronts(scene)
    faint = lit & (np.arange(lit.shape[1]) >= 2)

    def texels(atlas):
        a, b, c = (atlas.uv[0][:, k] for k in range(3))
        (ux, uy), (vx, vy) = (b - a).T, (c - a).T
        return np.abs(ux * vy - uy * vx) / 2 * atlas.size**2

    even, made = (texels(build(scene, SIZE, lit, 0, faint=f)) for f in (None, faint))
    # Floor and wall are of the same size.
    assert made[2:].sum() / made[:2].sum() == pytest.approx(FAINT**2, rel=0.1)
    assert made[:2].sum() > 1.3 * even[:2].sum()


def test_scales_that_happen_to_fill_the_square_are_tried():
    """A packer that leaves a tenth of the edge free at most scales, but not at one that covers 0.704."""
    points, corners = np.float32([[0, 0], [1, 0], [0, 1]]), np.uint32([[0, 1, 2]])
    edge = lambda coverage: np.sqrt(2 * coverage) * 100  # noqa: E731

    def pack(charts, pad, brute):
        scale = float(charts[0][0].max())
        lucky = abs(scale - edge(0.704)) < 1e-3
        return types.SimpleNamespace(squares=1, extent=scale / edge(0.7041 if lucky else 0.6) * 100 - 1)

    given = [(points, corners, 1)], 100, 0, edge(0.5), pack, lambda packing: True
    scale, _ = fitted(*given)
    assert scale == pytest.approx(edge(0.704), rel=1e-6)
    assert fitted(*given, rounds=0)[0] < edge(0.61)


def test_a_scale_at_which_charts_lie_over_one_another_is_not_taken():
    points, corners = np.float32([[0, 0], [1, 0], [0, 1]]), np.uint32([[0, 1, 2]])
    pack = lambda charts, pad, brute: types.SimpleNamespace(squares=1, extent=float(charts[0][0].max()) - 1)  # noqa: E731
    scale, _ = fitted([(points, corners, 1)], 100, 0, 80.0, pack, lambda packing: packing.extent < 89)
    assert scale < 90


def test_texels_that_two_triangles_cover_are_counted():
    """Against the loop over triangles; a fan has no texel twice, a copy of it has all."""
    rng = np.random.default_rng(3)
    rim = 0.5 + 0.4 * np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 12)), np.sin(a)], axis=1)
    fan = np.stack([np.full((11, 2), 0.5) + 0.01 * rng.random(2), rim[:-1], rim[1:]], axis=1)
    hits = coverings(64 * fan, 64, 64)
    other, _ = texel_hits(fan.astype(np.float32), np.zeros(11, int), 64)
    assert hits.max() == 1 and np.abs(hits - other).sum() <= 2
    assert (coverings(64 * np.concatenate([fan, fan]), 64, 64) == 2 * hits).all()


def test_charts_of_given_scenes_lie_apart(rooms):
    _, atlas = rooms
    hits = coverings(atlas.uv[atlas.chart >= 0] * atlas.size, atlas.size, atlas.size)
    assert (hits > 1).sum() <= TWICE * (hits > 0).sum()
