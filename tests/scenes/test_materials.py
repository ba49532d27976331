"""What a viewer shows of a surface point, against the path tracer's textures and by hand."""

import io

import numpy as np
import pytest
from PIL import Image as PillowImage

from lightwell.backend import dr, mi
from lightwell.scenes import Image, Material, Mesh, Texture, assemble
from lightwell.scenes.assemble_textures import bitmap, linear_pixels
from lightwell.scenes.corners import Corners, vertices_of
from lightwell.scenes.materials import sampled, surface_lookup


def picture(pixels) -> Image:
    out = io.BytesIO()
    PillowImage.fromarray(np.asarray(pixels, np.uint8)).save(out, "PNG")
    return Image("picture", out.getvalue(), "image/png")


PIXELS = np.random.default_rng(3).integers(0, 256, (5, 7, 3))
TURNED = ((0.0, 1.7, 0.3), (-0.8, 0.0, 0.1), (0.0, 0.0, 1.0))


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("nearest", [False, True])
@pytest.mark.parametrize("transform", [None, TURNED])
def test_textures_are_those_of_the_path_tracer(wrap, nearest, transform):
    texture = Texture(picture(PIXELS), (wrap, wrap), nearest, 0, transform)
    uv = np.random.default_rng(4).uniform(-2.5, 2.5, (500, 2)).astype(np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, len(uv))
    si.uv = mi.Point2f(uv.T)
    expected = np.array(bitmap(linear_pixels(texture.image), texture).eval_3(si)).T
    found = sampled(texture, uv.T, linear=False).T
    # Half-precision texels are off by 2^-11; nearest texels may round to the neighbour at a border.
    off = np.abs(found - expected).max(axis=1) > 1e-3
    assert off.mean() <= (0.01 if nearest else 0)


def test_the_first_row_is_at_v_zero():
    texture = Texture(picture([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]]), nearest=True)
    uv = np.float32([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]])
    found = sampled(texture, uv.T, linear=False).T
    np.testing.assert_array_equal(found, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])


def test_halfway_between_texels_is_the_mean_of_linear_values():
    texture = Texture(picture([[[0, 0, 0], [255, 188, 255]]]))
    found = sampled(texture, np.float32([[0.5], [0.5]]), linear=False).T
    # sRGB 188 is 0.503 linear.
    np.testing.assert_allclose(found, [[0.5, 0.2515, 0.5]], atol=1e-3)


def scene_of(*materials: Material):
    square = np.float32([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])
    uv = square[:, [0, 2]]
    meshes = [
        Mesh("textured", square, np.uint32([[0, 2, 1], [0, 3, 2]]), 0, uv0=uv, uv1=1 - uv),
        Mesh(
            "coloured",
            square + np.float32([0, 1, 0]),
            np.uint32([[0, 2, 1]]),
            1,
            colors=np.float32([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [1, 1, 1, 1]]),
        ),
    ]
    return assemble("test", meshes, materials)


def looked_up(scene, shape, triangle, barycentric) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reflectance [N, 3], roughness [N] and metalness [N]."""
    vertices = vertices_of(scene)
    corners = Corners.of(vertices, shape, triangle, barycentric)
    reflectance, roughness, metallic = surface_lookup(scene, vertices, shape, corners)
    return reflectance.T, roughness, metallic


def test_factors_textures_and_vertex_colours():
    texture = Texture(picture([[[0, 128, 255]]]), uv_set=1)
    scene = scene_of(
        Material("a", (0.5, 1, 1, 1), metallic=0.5, roughness=0.25, metallic_roughness_texture=texture),
        Material("b", (0.8, 0.8, 0.8, 1), metallic=0, roughness=1),
    )
    reflectance, roughness, metallic = looked_up(
        scene, np.uint32([0, 1, 1]), np.uint32([1, 0, 0]), np.float32([[0.2, 0.3], [0, 0], [0.5, 0.25]])
    )
    assert (reflectance.shape, roughness.shape, metallic.shape) == ((3, 3), (3,), (3,))
    assert {a.dtype for a in (reflectance, roughness, metallic)} == {np.dtype(np.float32)}
    np.testing.assert_allclose(roughness[0], 0.25 * 128 / 255, rtol=1e-5)
    np.testing.assert_allclose(metallic[0], 0.5)
    np.testing.assert_allclose(reflectance[0], np.array([0.5, 1, 1]) + 0.02, rtol=1e-5)
    np.testing.assert_allclose(reflectance[1], [0.84, 0.04, 0.04], rtol=1e-5)
    # Vertices 0, 2, 1 weigh 0.25, 0.5, 0.25.
    np.testing.assert_allclose(reflectance[2], np.array([0.25, 0.25, 0.5]) * 0.8 + 0.04, rtol=1e-5)


def test_reflectance_is_never_zero():
    scene = scene_of(Material("a", (0, 0, 0, 1), metallic=1), Material("b"))
    reflectance, _, _ = looked_up(scene, np.uint32([0]), np.uint32([0]), np.float32([[0.1, 0.1]]))
    np.testing.assert_allclose(reflectance, 1e-3)


def test_texture_coordinates_are_those_of_the_path_tracer():
    texture = Texture(picture(PIXELS))
    scene = scene_of(Material("a", base_color_texture=texture, metallic=0), Material("b"))
    x, z = np.random.default_rng(5).uniform(0.01, 0.99, (2, 200)).astype(np.float32)
    ray = mi.Ray3f(mi.Point3f(x, -1, z), mi.Vector3f(0, 1, 0))
    pi = scene.mi.ray_intersect_preliminary(ray, True)
    si = pi.compute_surface_interaction(ray)
    reflectance, _, _ = looked_up(scene, np.zeros(200, np.uint32), np.array(pi.prim_index), np.array(pi.prim_uv).T)
    expected = np.array(bitmap(linear_pixels(texture.image), texture).eval_3(si)).T
    np.testing.assert_allclose(reflectance, expected + 0.04, atol=1e-3)
