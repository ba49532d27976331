"""Mitsuba XML files: shapes, kept BSDFs and emitters, display materials, cameras, messages."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from lightwell.backend import mi
from lightwell.scenes import SceneError, load

HEAD, TAIL = '<scene version="3.0.0">', "</scene>"


def saved(folder: Path, body: str, name: str = "room.xml") -> Path:
    path = folder / name
    path.write_text(HEAD + body + TAIL)
    return path


def loaded(folder: Path, body: str):
    return load(saved(folder, body))


def material(folder: Path, bsdf: str):
    """The record of one BSDF, and the scene's warnings."""
    scene = loaded(folder, f'<shape type="rectangle">{bsdf}</shape>')
    return scene.materials[0], scene.warnings


PLACE = (
    '<transform name="to_world"><scale value="0.7"/><rotate x="0.6" y="0.8" angle="40"/>'
    '<translate x="0.2"/></transform>'
)
MIRROR = '<transform name="to_world"><scale x="-1"/><rotate y="0.6" z="0.8" angle="70"/></transform>'
FLIP = '<boolean name="flip_normals" value="true"/>'


@pytest.mark.parametrize("extra", ["", PLACE, MIRROR, FLIP + PLACE], ids=["plain", "placed", "mirrored", "flipped"])
@pytest.mark.parametrize("shape", ["rectangle", "disk", "sphere", "cylinder", "cube"])
def test_tessellated_shapes_are_where_the_shapes_were(tmp_path, shape, extra):
    path = saved(tmp_path, f'<shape type="{shape}">{extra}</shape>')
    ours, theirs = load(path), mi.load_file(str(path), optimize=False)
    rng = np.random.default_rng(1)
    n = 400
    origin = rng.normal(size=(3, n))
    origin *= 4 / np.linalg.norm(origin, axis=0)
    target = rng.uniform(-0.5, 0.5, (3, n))
    ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f((target - origin) / np.linalg.norm(target - origin, axis=0)))
    a, b = ours.mi.ray_intersect(ray), theirs.ray_intersect(ray)
    both = np.array(a.is_valid() & b.is_valid())
    # Rays that pass a silhouette within the error of the tessellation may differ.
    assert (np.array(a.is_valid()) == np.array(b.is_valid())).mean() > 0.98
    assert both.sum() > 20
    differences = {
        "p": (0.01, np.array(a.p) - np.array(b.p)),
        # Mitsuba leaves the geometric normal of a mirrored shape on the wrong side of the shading normal.
        "geometric normal": (0.05, np.abs(np.array(a.n)) - np.abs(np.array(b.n))),
        "its side": (0.05, np.array(a.n) - np.array(a.sh_frame.n)),
        "shading normal": (0.02, np.array(a.sh_frame.n) - np.array(b.sh_frame.n)),
        "uv": (0.03, np.array(a.uv) - np.array(b.uv)),
    }
    for name, (tolerance, difference) in differences.items():
        off = np.abs(difference[:, both]).max(axis=0) > tolerance
        # Seen at a grazing angle a point moves far; at the seam and the poles u jumps.
        assert off.mean() < 0.05, (name, off.mean())


def test_flipped_mesh_files_stay_flipped(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.1 0.2\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    for extra in ("", FLIP, '<boolean name="face_normals" value="true"/>', MIRROR):
        body = f'<shape type="obj"><string name="filename" value="a.obj"/>{extra}</shape>'
        path = saved(tmp_path, body)
        ours, theirs = load(path), mi.load_file(str(path), optimize=False)
        middle = ours.meshes[0].positions.mean(axis=0)
        normal = np.cross(*np.diff(ours.meshes[0].positions, axis=0))
        ray = mi.Ray3f(mi.Point3f(middle + normal), mi.Vector3f(-normal / np.linalg.norm(normal)))
        a, b = ours.mi.ray_intersect(ray), theirs.ray_intersect(ray)
        for name in ("p", "uv"):
            np.testing.assert_allclose(np.array(getattr(a, name)), np.array(getattr(b, name)), atol=1e-5, err_msg=extra)
        np.testing.assert_allclose(np.array(a.sh_frame.n), np.array(b.sh_frame.n), atol=1e-5, err_msg=extra)


def test_own_bsdfs_and_emitters_are_kept(tmp_path):
    scene = loaded(
        tmp_path,
        """<bsdf type="roughplastic" id="paint"/>
        <shape type="rectangle"><ref id="paint"/></shape>
        <shape type="rectangle"><ref id="paint"/>
          <emitter type="area"><rgb name="radiance" value="7 2 1"/></emitter></shape>
        <shape type="sphere"><bsdf type="conductor"><string name="material" value="Au"/></bsdf></shape>
        <emitter type="constant"><float name="radiance" value="0.5"/></emitter>
        <emitter type="point"><point name="position" value="1 2 3"/><rgb name="intensity" value="2 4 1"/></emitter>""",
    )
    assert [s.bsdf().class_name() for s in scene.mi.shapes()] == ["RoughPlastic", "RoughPlastic", "SmoothConductor"]
    assert [s.is_emitter() for s in scene.mi.shapes()] == [False, True, False]
    assert [m.emission for m in scene.meshes] == [(0, 0, 0), (7, 2, 1), (0, 0, 0)]
    assert [m.name for m in scene.materials[:2]] == ["paint", "paint (light)"]
    assert scene.materials[1].emissive == (7, 2, 1)
    assert scene.mi.environment() is not None
    (light,) = scene.lights
    assert (light.position, light.intensity, light.color) == ((1, 2, 3), 4, (0.5, 1, 0.25))
    assert len(scene.mi.emitters()) == 3


def test_instances_become_meshes(tmp_path):
    scene = loaded(
        tmp_path,
        """<shape type="shapegroup" id="g"><shape type="cube"/><shape type="sphere"/></shape>
        <shape type="instance"><ref id="g"/><transform name="to_world"><translate x="5"/></transform></shape>
        <shape type="instance"><ref id="g"/><transform name="to_world"><scale value="2"/></transform></shape>""",
    )
    assert len(scene.meshes) == len(scene.mi.shapes()) == 4
    boxes = [[round(float(v), 3) for v in (m.positions[:, 0].min(), m.positions[:, 0].max())] for m in scene.meshes]
    assert boxes == [[4, 6], [4, 6], [-2, 2], [-2, 2]]


def test_mirrored_instances_stay_the_right_way_out_and_flat_ones_are_left_out(tmp_path):
    scene = loaded(
        tmp_path,
        """<shape type="shapegroup" id="g"><shape type="cube"/></shape>
        <shape type="instance"><ref id="g"/><transform name="to_world"><scale x="-1"/></transform></shape>
        <shape type="instance"><ref id="g"/><transform name="to_world"><scale x="0"/></transform></shape>""",
    )
    (box,) = scene.meshes
    a, b, c = (box.positions[box.indices[:, k]] for k in range(3))
    # The cube is around the origin.
    assert (np.einsum("ti,ti->t", np.cross(b - a, c - a), a + b + c) > 0).all()
    assert any("an instance without size is left out" in warning for warning in scene.warnings)


@pytest.mark.parametrize(
    "bsdf,expected",
    [
        (
            '<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.1 0.2 0.3"/></bsdf></bsdf>',
            {"base_color": (0.1, 0.2, 0.3, 1), "metallic": 0, "roughness": 1, "ior": 1, "double_sided": True},
        ),
        (
            '<bsdf type="roughplastic"><float name="alpha" value="0.25"/>'
            '<rgb name="diffuse_reflectance" value="0.1 0.2 0.3"/></bsdf>',
            {"base_color": (0.1, 0.2, 0.3, 1), "metallic": 0, "roughness": 0.5, "delta": False},
        ),
        ('<bsdf type="plastic"/>', {"roughness": 0, "delta": True, "metallic": 0}),
        (
            '<bsdf type="roughconductor"><float name="alpha" value="0.04"/>'
            '<string name="material" value="none"/></bsdf>',
            {"base_color": (1, 1, 1, 1), "metallic": 1, "roughness": 0.2, "delta": False},
        ),
        (
            '<bsdf type="dielectric"><float name="int_ior" value="1.3"/><float name="ext_ior" value="1"/></bsdf>',
            {"transmission": 1, "ior": 1.3, "delta": True, "roughness": 0},
        ),
        ('<bsdf type="thindielectric"/>', {"transmission": 1, "thickness": 0, "delta": True}),
        (
            '<bsdf type="principled"><rgb name="base_color" value="0.3 0.2 0.1"/><float name="roughness" value="0.4"/>'
            '<float name="metallic" value="0.75"/></bsdf>',
            {"base_color": (0.3, 0.2, 0.1, 1), "roughness": 0.4, "metallic": 0.75},
        ),
        (
            '<bsdf type="mask"><float name="opacity" value="0.25"/><bsdf type="diffuse"/></bsdf>',
            {"alpha_mode": "BLEND", "base_color": (0.5, 0.5, 0.5, 0.25)},
        ),
        ("", {"name": "default", "base_color": (0.5, 0.5, 0.5, 1)}),
    ],
)
def test_display_materials(tmp_path, bsdf, expected):
    found, _ = material(tmp_path, bsdf)
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(value), name


def test_gold_looks_like_gold(tmp_path):
    gold, _ = material(tmp_path, '<bsdf type="conductor"><string name="material" value="Au"/></bsdf>')
    r, g, b, _ = gold.base_color
    assert gold.delta and gold.metallic == 1
    assert r > 0.9 and 0.7 < g < 0.9 and 0.2 < b < 0.5


def test_approximations_are_said(tmp_path):
    _, warnings = material(
        tmp_path,
        '<bsdf type="blendbsdf" id="rust"><float name="weight" value="0.25"/>'
        '<bsdf type="diffuse"/><bsdf type="conductor"/></bsdf>',
    )
    assert "material 'rust': shown approximately: two blended BSDFs are shown as one" in warnings


def test_bitmaps_travel_as_their_files(tmp_path):
    pixels = np.zeros((4, 4, 3), np.uint8)
    pixels[0, 0] = 255
    PillowImage.fromarray(pixels).save(tmp_path / "a.png")
    found, _ = material(
        tmp_path,
        '<bsdf type="diffuse"><texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/>'
        '<string name="filter_type" value="nearest"/><transform name="to_uv"><scale x="2"/>'
        '<translate y="0.5"/></transform></texture></bsdf>',
    )
    texture = found.base_color_texture
    assert texture.image.data == (tmp_path / "a.png").read_bytes()
    assert texture.nearest
    np.testing.assert_allclose(texture.transform, [[2, 0, 0], [0, 1, 0.5], [0, 0, 1]])


def test_a_checkerboard_is_a_tiny_picture(tmp_path):
    found, _ = material(
        tmp_path,
        '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"><rgb name="color0" value="1 0 0"/>'
        '<rgb name="color1" value="0 0 1"/></texture></bsdf>',
    )
    scene = load(tmp_path / "room.xml")
    for u, v in ((0.2, 0.2), (0.7, 0.2), (0.2, 0.7), (0.7, 0.7)):
        si = scene.mi.ray_intersect(mi.Ray3f([2 * u - 1, 2 * v - 1, 1], [0, 0, -1]))
        seen = np.array(si.bsdf().eval(mi.BSDFContext(), si, [0, 0, 1])).ravel() * np.pi
        pixel = found.base_color_texture.image.pixels[int(v > 0.5), int(u > 0.5), :3] / 255
        np.testing.assert_allclose(pixel, seen, atol=1e-5)


def test_missing_files_are_warnings(tmp_path):
    scene = loaded(
        tmp_path,
        """<shape type="rectangle"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
        <string name="filename" value="gone.png"/></texture></bsdf></shape>
        <shape type="obj"><string name="filename" value="gone.obj"/></shape>""",
    )
    assert len(scene.meshes) == 1
    assert "texture 'gone.png' is missing; a grey one takes its place" in scene.warnings
    assert "mesh file 'gone.obj' is missing; the shape is left out" in scene.warnings


@pytest.mark.parametrize("axis,expected", [("x", None), ("y", 60)])
def test_cameras(tmp_path, axis, expected):
    scene = loaded(
        tmp_path,
        f"""<shape type="cube"/><sensor type="perspective"><float name="fov" value="60"/>
        <string name="fov_axis" value="{axis}"/>
        <transform name="to_world"><lookat origin="1, 2, 3" target="1, 2, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="200"/><integer name="height" value="100"/></film></sensor>""",
    )
    (camera,) = scene.cameras
    np.testing.assert_allclose(
        [camera.position, camera.target, camera.up], [[1, 2, 3], [1, 2, 2], [0, 1, 0]], atol=1e-6
    )
    wanted = expected or 2 * np.degrees(np.arctan(np.tan(np.radians(30)) / 2))
    assert camera.fov_y == pytest.approx(wanted, abs=1e-3)


def test_the_digest_follows_the_files_it_names(tmp_path):
    digests = []
    for green in (0, 0, 9):
        PillowImage.fromarray(np.full((2, 2, 3), green, np.uint8)).save(tmp_path / "a.png")
        texture = '<texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/></texture>'
        bsdf = f'<bsdf type="diffuse">{texture}</bsdf>'
        digests.append(loaded(tmp_path, f'<shape type="rectangle">{bsdf}</shape>').digest)
    assert digests[0] == digests[1] != digests[2]


@pytest.mark.parametrize(
    "text,expected",
    [
        ("<scene", "cannot be read as a Mitsuba scene ("),
        (HEAD + '<ref id="nobody"/>' + TAIL, 'unresolved reference to "nobody"'),
        (HEAD + '<shape type="teapot"/>' + TAIL, "<shape> has the type 'teapot', which a scene may not name"),
        (HEAD + TAIL, "has no surfaces; a scene needs at least one <shape>, add one"),
    ],
)
def test_bad_files(tmp_path, text, expected):
    path = tmp_path / "room.xml"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        load(path)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("scene 'room.xml': ")
