"""glTF materials, textures and their orientation in the path tracer."""

import io

import numpy as np
import pytest
from gltf_builder import SQUARE_UV, Builder
from PIL import Image as PillowImage

from lightwell.backend import mi
from lightwell.core.color import linear
from lightwell.scenes import load

RED, GREEN, BLUE, WHITE = [255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]


def loaded(tmp_path, material: dict, file: Builder | None = None, **mesh):
    file = file or Builder()
    file.mesh(uv=mesh.pop("uv", SQUARE_UV), material=file.add("materials", material), **mesh)
    return load(file.save(tmp_path))


def hit(scene, x: float, y: float):
    """The surface of the square that is seen at (x, y) from +Z."""
    return scene.mi.ray_intersect(mi.Ray3f(mi.Point3f(x, y, 1), mi.Vector3f(0, 0, -1)))


def radiance(scene, x: float, y: float, wo) -> np.ndarray:
    """[3] BSDF times cosine towards ``wo`` (world; the frame of the square is that of the world up to a turn)."""
    si = hit(scene, x, y)
    value = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(mi.Vector3f(wo) / np.linalg.norm(wo)))
    return np.array(value).ravel()


def test_the_first_row_of_a_texture_is_on_top(tmp_path):
    file = Builder()
    texture = file.texture(np.array([[RED, GREEN], [BLUE, WHITE]]), magFilter=9728)
    scene = loaded(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": texture, "metallicFactor": 0}}, file)
    for (x, y), color in (((-0.5, 0.5), RED), ((0.5, 0.5), GREEN), ((-0.5, -0.5), BLUE), ((0.5, -0.5), WHITE)):
        seen = radiance(scene, x, y, [0.3, 0.2, 1.0])
        assert ((seen > 0.1) == (np.array(color) > 0)).all(), (x, y, seen)


def test_texture_transform_moves_the_picture_as_viewers_do(tmp_path):
    file = Builder()
    texture = file.texture(np.array([[RED, GREEN], [BLUE, WHITE]]), magFilter=9728)
    # KHR_texture_transform: offset after rotation after scale. u' = u + 0.5 swaps the columns.
    texture["extensions"] = {"KHR_texture_transform": {"offset": [0.5, 0]}}
    scene = loaded(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": texture, "metallicFactor": 0}}, file)
    assert (
        np.argmax(radiance(scene, -0.5, 0.5, [0, 0.2, 1])),
        scene.materials[0].base_color_texture.transform[0][2],
    ) == (
        1,
        0.5,
    )


def test_colour_space_and_factors(tmp_path):
    file = Builder()
    texture = file.texture(np.full((2, 2, 3), 128))
    pbr = {"baseColorTexture": texture, "baseColorFactor": [0.5, 1, 1, 1], "metallicFactor": 0}
    scene = loaded(tmp_path, {"pbrMetallicRoughness": pbr}, file)
    flat = loaded(tmp_path, {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0}})
    wo = [0.3, 0.2, 1.0]
    # The specular lobe is the same in both; what is left is the diffuse one, proportional to the base colour.
    left = radiance(scene, 0, 0, wo) - radiance(flat, 0, 0, wo)
    assert left[0] / left[1] == pytest.approx(0.5, rel=1e-2)
    white = loaded(tmp_path, {"pbrMetallicRoughness": {"metallicFactor": 0}})
    whole = radiance(white, 0, 0, wo) - radiance(flat, 0, 0, wo)
    # Half precision keeps 11 bits.
    assert left[1] / whole[1] == pytest.approx(float(linear(np.array(128 / 255))), rel=2e-3)


@pytest.mark.parametrize("uv", [SQUARE_UV, SQUARE_UV * [-1, 1] + [1, 0]], ids=["plain", "mirrored"])
def test_green_of_a_normal_map_points_to_the_top_of_the_picture(tmp_path, uv):
    file = Builder()
    material = {
        "pbrMetallicRoughness": {"metallicFactor": 0},
        "normalTexture": file.texture(np.full((2, 2, 3), [128, 200, 230])),
    }
    scene = loaded(tmp_path, material, file, uv=uv)
    up, down = (radiance(scene, 0, 0, [0, y, 1])[1] for y in (1, -1))
    assert up > 1.5 * down
    left, right = (radiance(scene, 0, 0, [x, 0, 1])[1] for x in (1, -1))
    assert left == pytest.approx(right, rel=0.05)


@pytest.mark.parametrize("uv,side", [(SQUARE_UV, 1), (SQUARE_UV * [-1, 1] + [1, 0], -1)], ids=["plain", "mirrored"])
def test_red_of_a_normal_map_points_along_u(tmp_path, uv, side):
    file = Builder()
    normal = file.texture(np.full((2, 2, 3), [200, 128, 230]))
    scene = loaded(tmp_path, {"pbrMetallicRoughness": {"metallicFactor": 0}, "normalTexture": normal}, file, uv=uv)
    towards, away = (radiance(scene, 0, 0, [x * side, 0, 1])[1] for x in (1, -1))
    assert towards > 1.5 * away


def test_a_normal_map_without_coordinates_is_flat(tmp_path):
    file = Builder()
    material = {"normalTexture": file.texture(np.full((2, 2, 3), [230, 128, 200]))}
    light = [0.4, 0.1, 1.0]
    bent = radiance(loaded(tmp_path, material, file, uv=None), 0, 0, light)
    flat = radiance(loaded(tmp_path, {}, uv=None), 0, 0, light)
    np.testing.assert_allclose(bent, flat, rtol=1e-5)


def test_both_sides_reflect(tmp_path):
    scene = loaded(tmp_path, {"pbrMetallicRoughness": {"metallicFactor": 0}})
    si = scene.mi.ray_intersect(mi.Ray3f([0, 0, -1], [0, 0, 1]))
    assert np.array(si.bsdf().eval(mi.BSDFContext(), si, si.to_local([0, 0, -1]))).min() > 0.1


def test_emission_strength_and_texture(tmp_path):
    file = Builder()
    material = {
        "emissiveFactor": [1, 0.5, 0],
        "emissiveTexture": file.texture(np.array([[WHITE, [0, 0, 0]], [WHITE, [0, 0, 0]]]), magFilter=9728),
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 40}},
    }
    scene = loaded(tmp_path, material, file)
    assert scene.has_static_light
    assert scene.materials[0].emissive == (40, 20, 0)
    assert scene.meshes[0].emission == pytest.approx((20, 10, 0))
    for x, expected in ((-0.5, [40, 20, 0]), (0.5, [0, 0, 0])):
        si = hit(scene, x, 0)
        np.testing.assert_allclose(np.array(si.emitter(scene.mi).eval(si)).ravel(), expected, rtol=1e-3)


def test_alpha_mask_cuts_holes(tmp_path):
    file = Builder()
    pixels = np.full((2, 2, 4), 255)
    pixels[:, 0, 3] = 60
    material = {
        "alphaMode": "MASK",
        "alphaCutoff": 0.3,
        "pbrMetallicRoughness": {"metallicFactor": 0, "baseColorTexture": file.texture(pixels)},
    }
    scene = loaded(tmp_path, material, file)
    opacity = [float(hit(scene, x, 0).bsdf().eval_null_transmission(hit(scene, x, 0))[0][0]) for x in (-0.5, 0.5)]
    assert opacity == [1, 0]


def test_a_thickness_is_a_length_of_the_mesh(tmp_path):
    """The asset's geometry is in metres, without nodes of another scale."""
    volume = {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume": {"thicknessFactor": 2}}
    file = Builder()
    file.add("materials", {"name": "glass", "extensions": volume})
    for scale in (1.0, 0.5, 0.5):
        file.mesh(material=0)
        file.json["nodes"][-1]["scale"] = [scale] * 3
    scene = load(file.save(tmp_path), unit=0.1)
    assert [scene.materials[mesh.material].thickness for mesh in scene.meshes] == pytest.approx([0.2, 0.1, 0.1])
    assert len({mesh.material for mesh in scene.meshes}) == 2


def test_vertex_colours_multiply_the_texture(tmp_path):
    def seen(colors, texture):
        file = Builder()
        pbr = {"metallicFactor": 0, "baseColorFactor": [0.8, 0.8, 0.8, 1]}
        if texture:
            pbr["baseColorTexture"] = file.texture(np.full((2, 2, 3), 255))
        attributes = {} if colors is None else {"COLOR_0": file.accessor(np.tile(np.float32(colors), (4, 1)))}
        return radiance(loaded(tmp_path, {"pbrMetallicRoughness": pbr}, file, attributes=attributes), 0, 0, [0, 0.3, 1])

    for texture in (False, True):
        black, tinted, white = (seen(c, texture) for c in ([0, 0, 0], [1, 0.5, 0.25], None))
        np.testing.assert_allclose((tinted - black) / (white - black), [1, 0.5, 0.25], rtol=5e-3)


@pytest.mark.parametrize(("kind", "value"), [(np.uint8, 51), (np.uint16, 13107)])
def test_vertex_colours_of_whole_numbers_are_shares(tmp_path, kind, value):
    """Exporters forget ``normalized``, which their type implies."""
    file = Builder()
    colors = file.accessor(np.full((4, 4), value, kind))
    scene = loaded(tmp_path, {}, file, attributes={"COLOR_0": colors})
    np.testing.assert_allclose(scene.meshes[0].colors, 0.2, atol=1e-6)


def test_vertex_colours_reflect_no_more_than_arrives(tmp_path):
    file = Builder()
    colors = file.accessor(np.tile(np.float32([3, 0.5, -1]), (4, 1)))
    scene = loaded(tmp_path, {}, file, attributes={"COLOR_0": colors})
    np.testing.assert_allclose(scene.meshes[0].colors, np.tile([1, 0.5, 0, 1], (4, 1)))
    assert "mesh 0 primitive 0: has COLOR_0 outside of 0 to 1; they are cut" in scene.warnings


def test_grey_pictures_of_16_bits_are_scaled(tmp_path):
    file, out = Builder(), io.BytesIO()
    PillowImage.fromarray(np.uint16([[0, 128, 32896, 65535]])).save(out, "PNG")
    image = file.add("images", {"bufferView": file.view(out.getvalue()), "mimeType": "image/png"})
    texture = {"index": file.add("textures", {"source": image})}
    image = loaded(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": texture}}, file).materials[0]
    image = image.base_color_texture.image
    assert image.pixels[0, :, 0].tolist() == [0, 0, 128, 255]


def test_webp_becomes_png(tmp_path):
    file = Builder()
    texture = file.texture(np.array([[RED, GREEN], [BLUE, WHITE]]), "WEBP")
    file.json["extensionsRequired"] = ["EXT_texture_webp"]
    image = loaded(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": texture}}, file).materials[0]
    image = image.base_color_texture.image
    assert image.mime == "image/png"
    assert image.pixels[0, 1, :3].tolist() == GREEN


def test_extensions_reach_the_record(tmp_path):
    scene = loaded(
        tmp_path,
        {
            "name": "glass",
            "pbrMetallicRoughness": {"roughnessFactor": 0.05, "metallicFactor": 0},
            "extensions": {
                "KHR_materials_transmission": {"transmissionFactor": 0.9},
                "KHR_materials_ior": {"ior": 1.3},
                "KHR_materials_volume": {"thicknessFactor": 0.2},
                "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatTexture": {"index": 0}},
                "KHR_materials_iridescence": {"iridescenceFactor": 1},
            },
        },
    )
    glass = scene.materials[0]
    assert (glass.transmission, glass.ior, glass.thickness, glass.clearcoat, glass.delta) == (0.9, 1.3, 0.2, 0.5, True)
    assert "material 'glass': the clearcoatTexture is ignored" in scene.warnings
    assert "material 'glass': KHR_materials_iridescence is ignored" in scene.warnings


@pytest.mark.parametrize("red, expected", [([0, 0], 0.0), ([6, 0], 0.0), ([255, 0], 0.4), ([255, 255], 0.8)])
def test_a_texture_of_transmission_is_averaged_and_a_black_one_is_opaque(tmp_path, red, expected):
    file = Builder()
    texture = file.texture(np.array([[[value, 255, 255] for value in red]] * 2))
    glass = {"transmissionFactor": 0.8, "transmissionTexture": texture}
    pbr = {"roughnessFactor": 0.05, "metallicFactor": 0}
    extensions = {"KHR_materials_transmission": glass}
    scene = loaded(tmp_path, {"pbrMetallicRoughness": pbr, "extensions": extensions}, file)
    [material] = scene.materials
    assert material.transmission == pytest.approx(expected) and material.delta == (expected > 0)
    flags = scene.mi.shapes()[0].bsdf().flags()
    assert mi.has_flag(flags, mi.BSDFFlags.GlossyTransmission) == (expected > 0)
    assert any("transmissionTexture" in line for line in scene.warnings) == (min(red) < 255)


def test_colours_of_reflections_that_are_lost_are_told(tmp_path):
    specular, sheen = {"specularColorFactor": [2, 2, 2]}, {"sheenColorFactor": [1, 0, 0]}
    extensions = {"KHR_materials_specular": specular, "KHR_materials_sheen": sheen}
    [first, second] = loaded(tmp_path, {"name": "silk", "extensions": extensions}).warnings
    assert first == "material 'silk': the colour of its sheen is ignored"
    assert second == "material 'silk': the colour of its specular reflection is ignored"


def test_a_specular_factor_lowers_the_reflectance_at_normal_incidence(tmp_path):
    material = loaded(tmp_path, {"extensions": {"KHR_materials_specular": {"specularFactor": 0.25}}}).materials[0]
    assert ((material.ior - 1) / (material.ior + 1)) ** 2 == pytest.approx(0.25 * 0.04)


def test_specular_glossiness_is_approximated(tmp_path):
    glossy = {"diffuseFactor": [0.2, 0.3, 0.4, 1], "specularFactor": [0.04] * 3, "glossinessFactor": 0.25}
    scene = loaded(tmp_path, {"name": "old", "extensions": {"KHR_materials_pbrSpecularGlossiness": glossy}})
    material = scene.materials[0]
    assert (material.base_color, material.metallic, material.roughness) == ((0.2, 0.3, 0.4, 1), 0, 0.75)
    assert "material 'old': specular-glossiness is converted to metallic-roughness approximately" in scene.warnings


def test_specular_glossiness_of_a_picture_is_converted_by_texel(tmp_path):
    """Left: a matt, red dielectric; right: a half glossy, yellow metal."""
    file = Builder()
    diffuse = file.texture(np.array([[[188, 0, 0], [0, 0, 0]]]))
    specular = file.texture(np.array([[[56, 56, 56, 0], [255, 188, 0, 128]]]))
    glossy = {"diffuseTexture": diffuse, "specularGlossinessTexture": specular}
    material = loaded(tmp_path, {"extensions": {"KHR_materials_pbrSpecularGlossiness": glossy}}, file).materials[0]
    texels = material.metallic_roughness_texture.image.pixels[0, :, 1:3]
    assert (material.metallic, material.roughness) == (1, 1) and texels.tolist() == [[255, 0], [127, 255]]
    colors = material.base_color_texture.image.pixels[0, :, :3]
    np.testing.assert_allclose(colors, [[188, 0, 0], [255, 188, 0]], atol=1)
    assert not material.delta


def test_a_damaged_picture_is_a_warning(tmp_path):
    file = Builder()
    texture = file.texture(np.array([[RED, GREEN], [BLUE, WHITE]]))
    view = file.json["bufferViews"][0]
    file.data[20 : view["byteLength"]] = b"\0" * (view["byteLength"] - 20)
    scene = loaded(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": texture}}, file)
    assert scene.materials[0].base_color_texture is None
    assert any(w.startswith("image 0 ('image 0'): cannot be decoded") for w in scene.warnings)


def test_a_primitive_without_material_is_a_white_wall(tmp_path):
    file = Builder()
    file.mesh()
    scene = load(file.save(tmp_path))
    assert (scene.materials[0].base_color, scene.materials[0].metallic) == ((0.8, 0.8, 0.8, 1), 0)
    assert "mesh 'node 0': has no material; it is shown as a white wall (albedo 0.8)" in scene.warnings


def test_a_metal_transmits_nothing(tmp_path):
    """metallicFactor is 1 where a file leaves it out."""
    glass = {"name": "glass", "extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.8}}}
    scene = loaded(tmp_path, glass)
    assert scene.materials[0].transmission == 0
    assert not mi.has_flag(scene.mi.shapes()[0].bsdf().flags(), mi.BSDFFlags.GlossyTransmission)
    assert any("'glass': it is a metal" in line for line in scene.warnings)
