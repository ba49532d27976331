"""Seams: found on a cube and a cylinder, told apart from edges where light may jump."""

import numpy as np
import pytest

from lightwell.scenes.assemble import assemble
from lightwell.scenes.atlas import build
from lightwell.scenes.atlas_seams import seams
from lightwell.scenes.scene import Material, Mesh

N = 24


def scene_of(mesh: Mesh):
    floor = Mesh(
        "floor", np.float32([[-9, -3, -9], [-9, -3, 9], [9, -3, 9], [9, -3, -9]]), np.uint32([[0, 1, 2], [0, 2, 3]]), 0
    )
    return assemble("seams", [mesh, floor], [Material("grey", (0.5, 0.5, 0.5, 1), metallic=0.0)])


def cube() -> Mesh:
    corners = np.float32([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh("cube", corners, np.uint32([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]), 0)


def cylinder() -> Mesh:
    """An open tube with smooth normals, of N quads round."""
    angle = 2 * np.pi * np.arange(N) / N
    ring = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1).astype(np.float32)
    positions = np.concatenate([ring, ring + np.float32([0, 2, 0])])
    k, j = np.arange(N), (np.arange(N) + 1) % N
    indices = np.concatenate([np.stack([k, k + N, j], axis=1), np.stack([j, k + N, j + N], axis=1)]).astype(np.uint32)
    return Mesh("tube", positions, indices, 0, normals=np.concatenate([ring, ring]))


def fronts(scene) -> np.ndarray:
    return np.repeat(np.array([[True], [False]]), sum(len(m.indices) for m in scene.meshes), axis=1)


def test_a_cube_has_at_most_twelve_and_none_of_them_is_smooth():
    scene = scene_of(cube())
    atlas = build(scene, 256, fronts(scene), mips=0)
    found = seams(scene, atlas)
    assert atlas.charts == 7 and len(found) == 12
    assert not found.smooth.any() and np.allclose(found.length, 1)


def test_a_cylinder_is_cut_open_along_smooth_seams():
    scene = scene_of(cylinder())
    atlas = build(scene, 256, fronts(scene), mips=0)
    found = seams(scene, atlas)
    # As many cuts from rim to rim as the tube has charts; one when it is unrolled as a whole.
    assert found.smooth.all()
    assert found.length.sum() == pytest.approx(2.0 * (atlas.charts - 1), rel=0.2)


def test_both_sides_of_a_seam_name_the_same_place():
    scene = scene_of(cylinder())
    atlas = build(scene, 256, fronts(scene), mips=0)
    found = seams(scene, atlas)
    rows, t = np.arange(len(found)), np.full(len(found), 0.3, np.float32)
    mesh = scene.meshes[0]
    places = []
    for which in (0, 1):
        b = found.barycentric(rows, which, t)
        weights = np.concatenate([1 - b.sum(axis=1, keepdims=True), b], axis=1)
        places.append(np.einsum("nk,nkc->nc", weights, mesh.positions[mesh.indices[found.triangle[:, which]]]))
    assert np.allclose(*places, atol=1e-6)
