"""Assembling records into a Mitsuba scene: order, lights and their units, cleaning."""

import io
import math

import numpy as np
import pytest
from PIL import Image as PillowImage

from lightwell.backend import dr, mi
from lightwell.scenes import Light, Material, Mesh, SceneError, assemble
from lightwell.scenes.assemble_lights import AreaLights
from lightwell.scenes.edits import dim
from lightwell.scenes.scene import Image, Texture

SQUARE = np.float32([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
UP = np.uint32([[0, 2, 1], [0, 3, 2]])
# An index of refraction of 1 and full roughness leave (almost) only the diffuse lobe.
WHITE = Material("white", (0.6, 0.6, 0.6, 1.0), metallic=0.0, roughness=1.0, ior=1.0)


def floor(y=0.0, material=0, name="floor", **more) -> Mesh:
    return Mesh(name, SQUARE + np.float32([0, y, 0]), UP, material, **more)


def seen(scene, x=0.0, z=0.0) -> np.ndarray:
    """[3] direct radiance that leaves the floor at (x, 0, z), seen from above at 45 degrees."""
    ray = mi.Ray3f(mi.Point3f(x - 0.4, 0.4, z), mi.Vector3f(math.sqrt(0.5), -math.sqrt(0.5), 0))
    integrator = mi.load_dict({"type": "direct", "emitter_samples": 1, "bsdf_samples": 0})
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, 1)
    color, _, _ = integrator.sample(scene.mi, sampler, mi.RayDifferential3f(ray))
    return np.array(color).ravel()


def test_shapes_are_the_meshes_in_order_also_with_lights_among_them():
    materials = [WHITE, Material("lamp", emissive=(3, 2, 1)), Material("glass", transmission=1.0)]
    meshes = [floor(-i, i % 3, f"floor {i}", normals=np.tile(np.float32([0, 1, 0]), (4, 1))) for i in range(13)]
    lights = [Light("point", position=(0, 1, 0)), Light("spot"), Light("directional")]
    scene = assemble("s", meshes, materials, lights, environment={"type": "constant"})
    assert len(scene.mi.shapes()) == len(scene.meshes) == 13
    for shape, mesh in zip(scene.mi.shapes(), scene.meshes):
        np.testing.assert_array_equal(np.array(shape.vertex_positions_buffer()), mesh.positions.ravel())
        np.testing.assert_array_equal(np.array(shape.faces_buffer()), mesh.indices.ravel())
        np.testing.assert_array_equal(np.array(shape.vertex_normals_buffer()), mesh.normals.ravel())
        assert shape.is_emitter() == (mesh.material == 1) == (mesh.emission == (3, 2, 1))
    # Four area lights, three punctual ones, the environment.
    assert len(scene.mi.emitters()) == 8


@pytest.mark.parametrize("x", [0.0, 0.7])
def test_a_point_light_of_one_candela(x):
    height, candela = 1.5, 20.0
    scene = assemble("s", [floor()], [WHITE], [Light("point", position=(0, height, 0), intensity=candela)])
    distance = math.hypot(x, height)
    expected = 0.6 / math.pi * candela * (height / distance) / distance**2
    # The principled diffuse lobe of roughness 1 departs from Lambert by its retro-reflection (up to a few per cent),
    # and half of the error that a confusion of units would make is far more.
    np.testing.assert_allclose(seen(scene, x), expected, rtol=0.12)


def test_a_directional_light_of_one_lux():
    direction = (0.0, -math.cos(0.3), math.sin(0.3))
    scene = assemble(
        "s", [floor()], [WHITE], [Light("directional", direction=direction, color=(1, 0.5, 0), intensity=9)]
    )
    expected = 0.6 / math.pi * 9 * math.cos(0.3) * np.array([1, 0.5, 0])
    np.testing.assert_allclose(seen(scene), expected, rtol=0.12)


def test_a_spot_shines_along_its_direction_inside_its_cone():
    light = Light("spot", position=(0, 2, 0), direction=(0, -1, 0), intensity=5, inner_cone=0.1, outer_cone=0.2)
    scene = assemble("s", [floor()], [WHITE], [light])
    np.testing.assert_allclose(seen(scene), 0.6 / math.pi * 5 / 4, rtol=0.12)
    assert seen(scene, x=2 * math.tan(0.15))[0] > 0.01
    assert seen(scene, x=2 * math.tan(0.21))[0] == 0


@pytest.mark.parametrize(
    "strategy",
    [
        pytest.param((1, 0), id="emitter sampling", marks=pytest.mark.slow),
        pytest.param((0, 1), id="BSDF sampling", marks=pytest.mark.slow),
        pytest.param((1, 1), id="both"),
    ],
)
@pytest.mark.parametrize("below", [False, True])
def test_double_sided_emission_shines_to_both_sides(strategy, below):
    lamp = Material("lamp", (0, 0, 0, 1), metallic=0.0, ior=1.0, emissive=(3, 2, 1), double_sided=True)
    wall = floor(-1.0 if below else 1.0)
    height = -1 if below else 1
    scene = assemble("s", [floor(material=1), wall], [WHITE, lamp])
    emitter_samples, bsdf_samples = strategy
    integrator = mi.load_dict(
        {"type": "direct", "emitter_samples": emitter_samples, "bsdf_samples": bsdf_samples, "hide_emitters": True}
    )
    n = 40000
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(3, n)
    origin = mi.Point3f(np.full(n, 0.2), np.full(n, 0.5 * height), np.full(n, 0.1))
    # As arrays: a number in the code of the kernel would make one for either side.
    direction = mi.Vector3f(np.zeros(n), np.full(n, height), np.zeros(n))
    ray = mi.RayDifferential3f(mi.Ray3f(origin, direction))
    color, _, _ = integrator.sample(scene.mi, sampler, ray)
    # Form factor of a 2 x 2 square seen from a point 1 m off, 0.2 and 0.1 m beside its middle (four corner terms).
    factor = sum(corner(a, b) for a in (0.8, 1.2) for b in (0.9, 1.1))
    expected = 0.6 * factor * np.array([3, 2, 1])
    # Disney's diffuse lobe of roughness 1 departs from Lambert, see above.
    np.testing.assert_allclose(np.array(color).mean(axis=1), expected, rtol=0.12)


def corner(a: float, b: float) -> float:
    """Form factor of an a x b rectangle from a parallel element 1 m below one of its corners."""
    u, v = math.hypot(1, a), math.hypot(1, b)
    return (a / u * math.atan(b / u) + b / v * math.atan(a / v)) / (2 * math.pi)


def test_a_scene_without_light_is_fine():
    assert not assemble("s", [floor()], [WHITE]).has_static_light


def test_triangles_without_area_are_dropped():
    indices = np.uint32([[0, 0, 1], [0, 2, 1], [1, 2, 1], [0, 3, 2]])
    gone = Mesh("gone", SQUARE, np.uint32([[0, 0, 0]]), 0)
    scene = assemble("s", [gone, Mesh("kept", SQUARE, indices, 0)], [WHITE])
    assert [m.name for m in scene.meshes] == ["kept"]
    assert scene.meshes[0].indices.tolist() == [[0, 2, 1], [0, 3, 2]]
    assert scene.warnings == [
        "mesh 'gone': dropped 1 of 1 triangles, which have no area",
        "mesh 'kept': dropped 2 of 4 triangles, which have no area",
    ]


def test_many_meshes_that_lose_triangles_are_one_line():
    indices = np.uint32([[0, 0, 1], [0, 2, 1], [0, 3, 2]])
    scene = assemble("s", [Mesh(f"m{k}", SQUARE, indices, 0) for k in range(5)], [WHITE])
    assert scene.warnings == ["5 meshes ('m0', 'm1', 'm2' …): dropped 5 of 15 triangles, which have no area"]


def test_flat_and_smooth_shading():
    tilted = np.tile(np.float32([3, 4, 0]), (4, 1))
    for normals, expected in ((None, [0, 1, 0]), (tilted, [0.6, 0.8, 0])):
        scene = assemble("s", [floor(normals=normals)], [WHITE])
        si = scene.mi.ray_intersect(mi.Ray3f([0.1, 1, 0.2], [0, -1, 0]))
        np.testing.assert_allclose(np.array(si.sh_frame.n).ravel(), expected, atol=1e-6)


def test_normals_without_length_are_made_anew():
    scene = assemble("s", [floor(normals=np.zeros((4, 3), np.float32))], [WHITE])
    np.testing.assert_allclose(scene.meshes[0].normals, np.tile([0, 1, 0], (4, 1)), atol=1e-6)


@pytest.mark.parametrize(
    "change,expected",
    [
        (
            {"positions": SQUARE * np.nan},
            "has positions that are not finite numbers; repair the mesh and export it again",
        ),
        ({"indices": UP + 2}, "names vertex 5 but has 4 vertices; export it again"),
        ({"uv0": SQUARE}, "has uv0 of shape [4, 3], expected [4, 2]; export it again"),
        ({"material": 3}, "names material 3 but the scene has 1; export it again"),
    ],
)
def test_nonsense_is_refused(change, expected):
    mesh = Mesh(**{"name": "m", "positions": SQUARE, "indices": UP, "material": 0, **change})
    with pytest.raises(SceneError) as caught:
        assemble("s", [mesh], [WHITE])
    assert str(caught.value) == f"scene 's': mesh 'm' {expected}"


def test_what_the_path_tracer_cannot_do_is_said():
    light = Light("point", "lamp", range=3.0)
    scene = assemble("s", [floor()], [Material("sign", unlit=True)], [light])
    assert scene.warnings == [
        "material 'sign': unlit; the path tracer treats it as an ordinary lit surface",
        "light 'lamp': its range of 3 m is ignored; light falls off with distance²",
    ]


@pytest.mark.parametrize("mode, expected", [("OPAQUE", 2.0), ("MASK", 0.0), ("BLEND", 0.5)])
def test_emission_is_that_of_the_part_that_is_there(mode, expected):
    material = Material("glow", base_color=(1, 1, 1, 0.25), emissive=(2.0, 2.0, 2.0), alpha_mode=mode)
    assert AreaLights()(material)[1] == pytest.approx((expected,) * 3)


def picture(alpha, color=255) -> Image:
    """A picture of two rows that are the same; Mitsuba has none of one."""
    out = io.BytesIO()
    pixels = np.full((2, len(alpha), 4), color, np.uint8)
    pixels[..., 3] = alpha
    PillowImage.fromarray(pixels).save(out, "PNG")
    return Image("p", out.getvalue(), "image/png")


def shining(light, u) -> float:
    """Red radiance of an emitter at a place of its picture."""
    si = dr.zeros(mi.SurfaceInteraction3f, 1)
    si.uv, si.wi = mi.Point2f(u, 0.5), mi.Vector3f(0, 0, 1)
    return float(np.array(light.eval(si)).ravel()[0])


@pytest.mark.parametrize("same", [True, False])
def test_holes_of_a_cut_out_do_not_shine(same):
    leaf = Texture(picture([255, 0, 0, 0]))
    glow = Texture(picture([255] * (4 if same else 8)))
    material = Material("sign", base_color_texture=leaf, emissive=(2.0,) * 3, emissive_texture=glow, alpha_mode="MASK")
    light, mean = AreaLights()(material)
    assert mean == pytest.approx((0.5,) * 3)
    # Where the pictures differ in size, the whole shines as much as what is left of it.
    assert [shining(light, u) for u in (0.125, 0.625)] == pytest.approx([2, 0] if same else [0.5, 0.5])


def test_meshes_that_share_an_emissive_picture_hold_it_once_and_are_dimmed_alone():
    glow = Texture(picture([255] * 4, 200))
    materials = [Material(f"m{k}", emissive=(float(k + 1),) * 3, emissive_texture=glow) for k in range(2)]
    scene = assemble("s", [floor(-k, int(k == 2), f"floor {k}", uv0=SQUARE[:, ::2]) for k in range(3)], materials)
    lights = [shape.emitter() for shape in scene.mi.shapes()]
    assert lights[0].radiance is lights[1].radiance is lights[2].radiance
    once = shining(lights[0], 0.5)
    assert scene.meshes[0].emission[0] == pytest.approx(once, rel=1e-3)
    assert shining(lights[2], 0.5) == pytest.approx(2 * once)
    dim(mi.traverse(scene.mi.shapes()[1]), "emitter.", 0.25)
    assert [shining(light, 0.5) for light in lights] == pytest.approx([once, 0.25 * once, 2 * once])


@pytest.mark.parametrize("mode, passed", [("OPAQUE", 0.0), ("BLEND", 0.7)])
@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_alpha_of_vertices_is_blended(mode, passed, factor):
    # From 0.6 on one side to 0 on the other: 0.3 in the middle.
    colors = np.ones((4, 4), np.float32)
    colors[:, 3] = np.where(SQUARE[:, 0] > 0, 0.6, 0.0)
    material = Material("sheet", base_color=(1, 1, 1, factor), alpha_mode=mode)
    scene = assemble("s", [floor(colors=colors)], [material])
    si = scene.mi.ray_intersect(mi.Ray3f([0.0, 1, 0.2], [0, -1, 0]))
    through = np.array(si.bsdf().eval_null_transmission(si)).ravel()
    expected = 1 - (1 - passed) * factor if mode == "BLEND" else 0.0
    np.testing.assert_allclose(through, expected, atol=1e-5)


@pytest.mark.parametrize("textured", [False, True])
def test_alpha_of_vertices_is_part_of_what_a_mask_cuts_off(textured):
    # 0.4 · 1 to 0.4 · 0 over the floor; the cutoff 0.3 lies at a quarter.
    colors = np.ones((4, 4), np.float32)
    colors[:, 3] = np.where(SQUARE[:, 0] > 0, 1.0, 0.0)
    leaf = Texture(picture([102, 102])) if textured else None
    factor = 1.0 if textured else 0.4
    material = Material(
        "sheet", base_color=(1, 1, 1, factor), base_color_texture=leaf, alpha_mode="MASK", alpha_cutoff=0.3
    )
    scene = assemble("s", [floor(colors=colors, uv0=SQUARE[:, ::2])], [material])
    low, high = SQUARE[:, 0].min(), SQUARE[:, 0].max()
    for share, expected in ((0.1, 1.0), (0.7, 1.0), (0.8, 0.0), (0.9, 0.0)):
        si = scene.mi.ray_intersect(mi.Ray3f([float(low + share * (high - low)), 1, 0.2], [0, -1, 0]))
        assert np.array(si.bsdf().eval_null_transmission(si)).ravel() == pytest.approx(expected)
