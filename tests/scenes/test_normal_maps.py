"""Shading normals: closed forms on a quad, what the path tracer shows, scenes without relief."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image as PillowImage

from lightwell.backend import dr, mi
from lightwell.scenes import load
from lightwell.scenes.assemble import assemble
from lightwell.scenes.corners import Corners, vertices_of
from lightwell.scenes.normal_maps import relief, shading_normals
from lightwell.scenes.scene import Image, Material, Mesh, Texture

# 192 166 231: what web/test/renderers.test.ts asks of the pages.
TEXEL, BENT = (192, 166, 231), np.float32([0.5044, 0.3011, 0.8093])


def wall(texel=TEXEL, scale: float = 1.0, mirrored: bool = False):
    """A square of 2 m at z = -1, u along +x (or −x), v along −y."""
    u = np.float32([0, 1, 1, 0])
    uv = np.stack([1 - u if mirrored else u, np.float32([1, 1, 0, 0])], axis=1)
    corners = np.float32([[-1, 0, -1], [1, 0, -1], [1, 2, -1], [-1, 2, -1]])
    mesh = Mesh("wall", corners, np.uint32([[0, 1, 2], [0, 2, 3]]), 0, uv0=uv)
    PillowImage.fromarray(np.tile(np.uint8(texel), (2, 2, 1))).save(png := io.BytesIO(), "PNG")
    picture = Texture(Image("bumps", png.getvalue(), "image/png"))
    material = Material("wall", metallic=0.0, normal_texture=picture, normal_scale=scale)
    return assemble("wall", [mesh], [material])


def bent(scene, shape, triangle, barycentric, normal) -> np.ndarray:
    """Shading normals [N, 3]."""
    vertices = vertices_of(scene)
    corners = Corners.of(vertices, shape, triangle, barycentric)
    return shading_normals(scene, vertices, relief(scene), shape, corners, normal.T).T


def at(scene, normal, count: int = 8) -> np.ndarray:
    rng = np.random.default_rng(2)
    barycentric = 0.5 * rng.random((count, 2), np.float32)
    zero = np.zeros(count, int)
    return bent(scene, zero, rng.integers(0, 2, count), barycentric, np.tile(np.float32(normal), (count, 1)))


def test_the_axes_are_those_of_gltf():
    assert np.abs(at(wall(), [0, 0, 1]) - BENT).max() < 2e-4


def test_the_back_of_a_bump_is_a_dent():
    assert np.abs(at(wall(), [0, 0, -1]) + BENT).max() < 2e-4


def test_a_mirrored_picture_bends_the_other_way():
    assert np.abs(at(wall(mirrored=True), [0, 0, 1]) - BENT * [-1, 1, 1]).max() < 2e-4


def test_the_scale_flattens_and_a_texel_without_direction_bends_nothing():
    flat = at(wall(scale=0.5), [0, 0, 1])
    expected = BENT * [0.5, 0.5, 1] / np.linalg.norm(BENT * [0.5, 0.5, 1])
    assert np.abs(flat - expected).max() < 2e-3
    assert not relief(wall(scale=0.0)).any()
    dark = at(wall(texel=(127, 128, 127), scale=1e-5), [0, 0, 1])
    assert np.isfinite(dark).all() and np.abs(np.linalg.norm(dark, axis=1) - 1).max() < 1e-5


def test_a_texel_that_points_inwards_is_mirrored_back():
    assert np.abs(at(wall(texel=(192, 166, 255 - 231)), [0, 0, 1]) - BENT).max() < 2e-4


def test_a_scene_without_relief_keeps_its_normals():
    scene = load("cornell")
    normal = np.tile(np.float32([[0, 1, 0]]), (4, 1))
    zero = np.zeros(4, int)
    assert not relief(scene).any()
    assert (bent(scene, zero, zero, np.full((4, 2), 0.2, np.float32), normal) == normal).all()
    bare = wall()
    stripped = assemble("bare", [replace(bare.meshes[0], uv0=None)], bare.materials)
    assert not relief(stripped).any()


def test_the_path_tracer_bends_them_alike():
    """Three cosines of a white Lambertian surface under Mitsuba's normal map give its normal."""
    from lightwell.transport.interactions import DevicePoints, gather_interaction
    from lightwell.transport.queries import make_query
    from lightwell.transport.surface import draw_surface

    scene = load("courtyard")
    points = draw_surface(scene, 1000, 1, floor=0, only=relief(scene)).points
    query = make_query(scene, points, np.zeros(3, np.float32))
    ours = bent(scene, points.shape, points.triangle, points.barycentric, query.normal)
    texture = scene.materials[scene.meshes[int(np.flatnonzero(relief(scene))[0])].material].normal_texture
    pixels = texture.image.pixels[..., :3].astype(np.float32) / 255
    bitmap = {"type": "bitmap", "data": mi.TensorXf(pixels), "raw": True, "wrap_mode": "repeat"}
    nested = {"type": "diffuse", "reflectance": 1.0}
    bsdf = mi.load_dict({"type": "twosided", "n": {"type": "normalmap", "normalmap": bitmap, "nested": nested}})
    si = gather_interaction(scene, DevicePoints(points), dr.arange(mi.UInt32, len(points)))
    rng, directions, cosines = np.random.default_rng(0), [], []
    for _ in range(3):
        d = query.normal + 0.35 * rng.normal(size=query.normal.shape)
        d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
        wo = si.to_local(mi.Vector3f(*(mi.Float(np.ascontiguousarray(c)) for c in d.T)))
        cosines.append(np.array(bsdf.eval(mi.BSDFContext(), si, wo))[0] * np.pi)
        directions.append(d.astype(np.float64))
    good = np.flatnonzero((np.stack(cosines) > 0.05).all(axis=0))
    found = np.linalg.solve(np.stack(directions, axis=1)[good], np.stack(cosines, axis=1)[good][..., None])[..., 0]
    length = np.linalg.norm(found, axis=1, keepdims=True)
    # Where the eye grazes, Mitsuba turns the bent normal towards it.
    angle = np.degrees(np.arccos(np.clip((found / length * ours[good]).sum(axis=1), -1, 1)))
    tilt = np.degrees(np.arccos(np.clip((ours * query.normal).sum(axis=1), -1, 1)))
    assert np.quantile(tilt, 0.9) > 20 and len(good) > 900
    assert np.quantile(angle, 0.9) == pytest.approx(0, abs=1)
