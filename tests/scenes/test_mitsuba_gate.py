"""What of a Mitsuba file reaches Mitsuba: plug-ins, files, nesting, numbers, meshes, pictures."""

import os
import struct
import subprocess
import sys
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest
from PIL import Image as PillowImage

from lightwell.backend import mi, two_threads
from lightwell.core.image_io import write_picture
from lightwell.limits import Limits
from lightwell.scenes import SceneError, load
from lightwell.scenes.mitsuba_xml import load_mitsuba

HEAD, TAIL = '<scene version="3.0.0">', "</scene>"
FLOOR = '<shape type="rectangle"/>'
TRIANGLE = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])


def saved(folder: Path, body: str, name: str = "room.xml") -> Path:
    path = folder / name
    path.write_text(HEAD + body + TAIL)
    return path


def refused(path: Path, **options) -> str:
    """The one line."""
    with pytest.raises(SceneError) as caught:
        load_mitsuba(path, **options)
    text = str(caught.value)
    assert "\n" not in text and "; " in text and len(text) < 700
    return text


def shape(name: str, kind: str, more: str = "") -> str:
    return f'<shape type="{kind}"><string name="filename" value="{name}"/>{more}</shape>'


def texture(name: str) -> str:
    bitmap = f'<texture type="bitmap" name="reflectance"><string name="filename" value="{name}"/></texture>'
    return f'<shape type="rectangle"><bsdf type="diffuse">{bitmap}</bsdf></shape>'


def ply(path: Path, faces, vertices=TRIANGLE, count: int | None = None) -> Path:
    """A binary PLY file; ``count``: what its header says of the vertices."""
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices) if count is None else count}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)
    path.write_bytes(head.encode() + np.float32(vertices).tobytes() + rows)
    return path


# ---------------------------------------------------------------------- plug-ins


@pytest.mark.parametrize("kind", ["shape", "bsdf", "emitter", "sensor", "integrator", "texture", "medium", "sampler"])
@pytest.mark.parametrize("name", ["../../evil", "/tmp/evil", "evil", "Diffuse", "", "plugins/x", "blender"])
def test_only_listed_plugins_are_named(tmp_path, kind, name):
    text = refused(saved(tmp_path, f'<{kind} type="{name}"/>{FLOOR}'))
    assert text.startswith(f"scene 'room.xml': line 1: <{kind}> has the type '{name}', which a scene may not name")


def test_a_plugin_named_by_a_parameter_is_checked(tmp_path):
    body = f'<default name="kind" value="../evil"/><shape type="$kind"/>{FLOOR}'
    assert "has the type '../evil'" in refused(saved(tmp_path, body))


def test_the_parts_of_a_film_are_checked_too(tmp_path):
    film = '<film type="hdrfilm"><rfilter type="../evil"/></film>'
    assert "has the type '../evil'" in refused(saved(tmp_path, f'<sensor type="perspective">{film}</sensor>{FLOOR}'))


def test_a_library_named_by_a_scene_does_not_run(tmp_path):
    for folder in (tmp_path, tmp_path / "plugins"):
        folder.mkdir(exist_ok=True)
        (folder / "evil.so").write_text("a stranger's code")
    saved(tmp_path, '<shape type="../../proc/self/cwd/evil"/>')
    program = "import sys; sys.path[:] = sys.argv[1:]; from lightwell.scenes import load; load('room.xml')"
    modules = [str(Path(__file__).parents[2]), *filter(None, sys.path)]
    done = subprocess.run(
        [sys.executable, "-c", program, *modules], cwd=tmp_path, capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("lightwell.scenes.errors.SceneError: scene 'room.xml': line 1: ")


def test_a_conductor_does_not_name_files(tmp_path):
    bsdf = '<bsdf type="conductor"><string name="material" value="../../x"/></bsdf>'
    assert "material '../../x'" in refused(saved(tmp_path, f'<shape type="rectangle">{bsdf}</shape>'))


# ---------------------------------------------------------------------- files


@pytest.mark.parametrize("name", ["/dev/zero", "../secret.png", "a/../../secret.png", "link.png", "folder/secret.png"])
@pytest.mark.parametrize(
    "body", [texture, lambda name: shape(name, "obj"), lambda name: f'<include filename="{name}"/>']
)
def test_files_outside_the_folder_are_refused(tmp_path, name, body):
    inside, outside = tmp_path / "scene", tmp_path / "secret.png"
    inside.mkdir()
    outside.write_bytes(b"secret")
    (inside / "link.png").symlink_to(outside)
    (inside / "folder").symlink_to(tmp_path)
    text = refused(saved(inside, body(name) + FLOOR))
    assert f"the file '{name}' is not inside the scene's folder" in text and "--allow-path" in text


def test_allowed_folders_may_be_named(tmp_path):
    inside, outside = tmp_path / "scene", tmp_path / "shared"
    inside.mkdir()
    outside.mkdir()
    PillowImage.fromarray(np.full((2, 2, 3), 9, np.uint8)).save(outside / "a.png")
    for name in ("../shared/a.png", str(outside / "a.png"), "a.png"):
        path = saved(inside, texture(name))
        scene = load(path, allow_paths=[outside])
        assert scene.materials[0].base_color_texture.image.pixels[0, 0, 0] == 9
        assert not scene.warnings
    assert "no folder" in refused(path, allow_paths=[tmp_path / "gone"])


def test_absolute_names_need_permission(tmp_path):
    PillowImage.fromarray(np.full((2, 2, 3), 9, np.uint8)).save(tmp_path / "a.png")
    path = saved(tmp_path, texture(str(tmp_path / "a.png")))
    assert "--allow-path" in refused(path)
    assert not load(path, allow_paths=[tmp_path]).warnings


def test_devices_and_folders_are_no_files(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "folder.png").mkdir()
    for name in ("pipe.png", "folder.png"):
        assert "is no regular file" in refused(saved(tmp_path, texture(name)))


def test_includes_are_read_in_their_place(tmp_path):
    (tmp_path / "parts").mkdir()
    saved(tmp_path / "parts", '<shape type="cube" id="box"><ref id="paint"/></shape>', "box.xml")
    (tmp_path / "paint.xml").write_text('<bsdf version="3.0.0" type="diffuse" id="paint"/>')
    body = '<default name="f" value="parts/box"/><include filename="paint.xml"/><include filename="$f.xml"/>'
    scene = load(saved(tmp_path, body))
    assert [m.name for m in scene.meshes] == ["box"]
    assert scene.materials[0].name == "paint"


def test_includes_end(tmp_path):
    assert "includes itself" in refused(saved(tmp_path, '<include filename="room.xml"/>'))
    saved(tmp_path, '<include filename="room.xml"/>', "other.xml")
    assert "includes itself" in refused(saved(tmp_path, '<include filename="other.xml"/>'))
    for k in range(20):
        saved(tmp_path, f'<include filename="n{k + 1}.xml"/><include filename="n{k + 1}.xml"/>', f"n{k}.xml")
    assert "includes are nested deeper" in refused(tmp_path / "n0.xml")


def test_a_missing_include_is_an_error(tmp_path):
    assert "does not exist" in refused(saved(tmp_path, '<include filename="gone.xml"/>'))


# ---------------------------------------------------------------------- the document


def test_entities_are_refused(tmp_path):
    for doctype in ('<!DOCTYPE x [<!ENTITY a "b">]>', '<!DOCTYPE x SYSTEM "file:///etc/passwd">'):
        path = tmp_path / "room.xml"
        path.write_text(doctype + HEAD + FLOOR + TAIL)
        assert "has a DOCTYPE" in refused(path)


def test_deep_documents_are_refused(tmp_path):
    bsdf = '<bsdf type="twosided">'
    assert "nested deeper" in refused(saved(tmp_path, bsdf * 20_000 + "</bsdf>" * 20_000))


def test_deep_references_are_refused(tmp_path):
    chain = "".join(f'<bsdf type="twosided" id="b{k}"><ref id="b{k + 1}"/></bsdf>' for k in range(20_000))
    body = chain + '<bsdf type="diffuse" id="b20000"/><shape type="rectangle"><ref id="b0"/></shape>'
    assert "nested deeper" in refused(saved(tmp_path, body))


def test_references_that_double_are_refused(tmp_path):
    pairs = "".join(
        f'<bsdf type="blendbsdf" id="b{k}"><ref id="b{k + 1}"/><ref id="b{k + 1}"/></bsdf>' for k in range(40)
    )
    body = pairs + '<bsdf type="diffuse" id="b40"/><shape type="rectangle"><ref id="b0"/></shape>'
    assert "unfolds to more than" in refused(saved(tmp_path, body))


def test_the_longest_parameter_is_meant_and_many_of_them_are_read_at_once(tmp_path):
    many = "".join(f'<default name="p{k}" value="{k}"/>' for k in range(20_000))
    body = many + f'<shape type="rectangle"><transform name="to_world"><scale value="$p12"/></transform></shape>{FLOOR}'
    begin = perf_counter()
    scene = load_mitsuba(saved(tmp_path, body))
    assert scene.meshes[0].positions.max() == 12 and perf_counter() - begin < 10


def test_parameters_that_grow_are_refused(tmp_path):
    grown = "".join(f'<default name="p{k + 1}" value="$p{k}$p{k}"/>' for k in range(60))
    assert "too long" in refused(saved(tmp_path, '<default name="p0" value="lol"/>' + grown + FLOOR))


def test_many_instances_are_refused(tmp_path):
    group = '<shape type="shapegroup" id="g">' + "<shape type='cube'/>" * 300 + "</shape>"
    body = group + '<shape type="instance"><ref id="g"/></shape>' * 2000
    assert "instances" in refused(saved(tmp_path, body))


def test_limits_can_be_changed(tmp_path):
    path = saved(tmp_path, '<shape type="sphere"/>' * 3)
    assert "--limit vertices=" in refused(path, limits=Limits(vertices=10_000))
    assert "--limit nodes=" in refused(path, limits=Limits(nodes=3))
    assert len(load(path).meshes) == 3


@pytest.mark.parametrize(
    "body,expected",
    [
        ('<bsdf type="twosided" id="a"><ref id="a"/></bsdf>', "circular reference"),
        ('<shape type="shapegroup" id="g"><shape type="instance"><ref id="g"/></shape></shape>', "circular reference"),
        ('<shape type="rectangle"><bsdf type="mask"/></shape>', 'type="mask"> holds 0 <bsdf>, expected 1'),
        ('<shape type="rectangle"><bsdf type="twosided"/></shape>', "expected 1 to 2"),
        ('<shape type="rectangle"><bsdf type="normalmap"/></shape>', "expected 1"),
        ('<shape type="rectangle"><bsdf type="blendbsdf"><bsdf type="diffuse"/></bsdf></shape>', "expected 2"),
        ('<shape type="instance"/>', "expected 1"),
        ('<bsdf type="diffuse"><texture type="bitmap" name="reflectance"/></bsdf>', "the bitmap has no file name"),
        ('<shape type="ply"/>', "the ply has no file name"),
        ('<emitter type="envmap"/>', "the envmap has no file name"),
        ('<shape type="sphere"><float name="radius" value="nan"/></shape>', "no finite number"),
        ('<shape type="sphere"><point name="center" x="1e39" y="0" z="0"/></shape>', "no finite number"),
        (
            '<emitter type="directional"><vector name="direction" x="0" y="18446744073709551616" z="0"/></emitter>',
            "has a place, direction or power whose numbers overflow in single precision; make them smaller",
        ),
        ('<shape type="cube"><transform name="to_world"><scale value="inf"/></transform></shape>', "no finite number"),
        (
            '<shape type="cube"><transform name="to_world"><shape type="cube"/></transform></shape>',
            "inside <transform>",
        ),
        ('<shape type="cube" id="a"/><shape type="cube" id="a"/>', "duplicate ID"),
        ('<shape type="$kind"/>', "undefined parameter $kind"),
        ("<teapot/>", "unsupported XML element: <teapot>"),
        (
            '<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="1000000"/></film></sensor>',
            "--limit picture_edge=",
        ),
        (
            '<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="-1"/></film></sensor>',
            "give it a size",
        ),
    ],
)
def test_what_makes_no_sense_is_one_line(tmp_path, body, expected):
    assert expected in refused(saved(tmp_path, FLOOR + body))


def test_lines_are_those_of_the_author(tmp_path):
    path = saved(tmp_path, f"\n<!-- two -- \n dashes -->\n{FLOOR}\n<shape\n type='../x'/>")
    assert refused(path).startswith("scene 'room.xml': line 5: ")
    path = saved(tmp_path, f"{FLOOR}\n\n\n<bsdf type='diffuse'><integer name='a' value='x'/></bsdf>")
    assert "room.xml, line 4: could not parse integer" in refused(path)


# ---------------------------------------------------------------------- meshes and pictures


@pytest.mark.parametrize(
    "make,expected",
    [
        (lambda p: ply(p, [(0, 1, 3)]), "names a vertex that is not among its 3"),
        (lambda p: ply(p, [(0, 1, -1)]), "names a vertex that is not among its 3"),
        (lambda p: ply(p, [(0, 1, 2_000_000_000)]), "names a vertex that is not among its 3"),
        (lambda p: ply(p, [(0, 1, 2)], count=400_000_000), "--limit vertices="),
        (lambda p: ply(p, [(0, 1, 2)], count=10_000_000), "its header says"),
        (lambda p: ply(p, [(0, 1, 2, 0)]), "triangulate it"),
        (lambda p: ply(p, [(0, 1, 2)], vertices=TRIANGLE * np.float32(np.nan)), "not finite numbers"),
        (lambda p: ply(p, []), "expected one with entries"),
        (lambda p: p.write_bytes(b"\0" * 100), "is no PLY file"),
        (lambda p: p.write_bytes(b""), "is no PLY file"),
        (
            lambda p: p.write_text("ply\nformat ascii 1.0\nelement vertex 99999999999999\nend_header\n"),
            "which is no PLY",
        ),
    ],
)
def test_ply_files_are_checked(tmp_path, make, expected):
    make(tmp_path / "a.ply")
    text = refused(saved(tmp_path, shape("a.ply", "ply")))
    assert expected in text and "mesh 'a.ply'" in text


def text_ply(path: Path, face: str = "3 0 1 2", x: str = "0") -> None:
    path.write_text(
        "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_index\nend_header\n"
        f"{x} 0 0\n1 0 0\n0 1 0\n{face}\n"
    )


def test_ply_files_of_text(tmp_path):
    path = saved(tmp_path, shape("a.ply", "ply"))
    text_ply(tmp_path / "a.ply")
    np.testing.assert_array_equal(load(path).meshes[0].positions, TRIANGLE)
    for change in ({"face": "3 0 1 3"}, {"x": "nan"}, {"face": "4 0 1 2 0"}, {"face": "3 0 1"}, {"x": "a"}):
        text_ply(tmp_path / "a.ply", **change)
        assert "mesh 'a.ply'" in refused(path)


def test_whole_ply_files_are_read_as_before(tmp_path):
    box = mi.load_dict({"type": "cube"})
    box.write_ply(str(tmp_path / "box.ply"))
    scene = load(saved(tmp_path, shape("box.ply", "ply")))
    assert len(scene.meshes[0].indices) == 12 and scene.meshes[0].uv0 is not None


@pytest.mark.parametrize(
    "text,expected",
    [
        ("v 0 0 0\nf 1 2 900\n", "invalid vertex"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -1\n", "invalid vertex"),
        ("v 0 0 0\n", "has no line 'f"),
        ("", "is empty"),
        ("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "invalid vertex position"),
        ("v 0 0 0\0", "is no OBJ file"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt nan 0\nf 1/1 2/1 3/1\n", "not finite"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3" + " " * 2000 + "\n", "long line"),
    ],
)
def test_obj_files_are_checked(tmp_path, text, expected):
    (tmp_path / "a.obj").write_text(text)
    assert expected in refused(saved(tmp_path, shape("a.obj", "obj")))


def test_pictures_are_checked(tmp_path):
    path = saved(tmp_path, texture("a.png"))
    (tmp_path / "a.png").write_text("no picture")
    assert "is no picture" in refused(path)
    PillowImage.fromarray(np.zeros((64, 64, 3), np.uint8)).save(tmp_path / "a.png")
    whole = (tmp_path / "a.png").read_bytes()
    (tmp_path / "a.png").write_bytes(whole[:60])
    refused(path)
    (tmp_path / "a.png").write_bytes(whole[:16] + struct.pack(">II", 100_000, 100_000) + whole[24:])
    refused(path)
    (tmp_path / "a.png").write_bytes(whole)
    assert "--limit texels=" in refused(path, limits=Limits(texels=1000))


def test_pillow_opens_no_picture_in_a_format_that_runs_programs(tmp_path):
    # With Ghostscript installed, Pillow would run it.
    (tmp_path / "a.tga").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 8 8\n{} loop\n")
    assert "'a.tga' is no picture" in refused(saved(tmp_path, texture("a.tga")))


def test_what_reads_no_file_names_none(tmp_path):
    """A name there would be read as if it had been checked."""
    (tmp_path / "secret").write_bytes(b"a")
    body = f'<bsdf type="diffuse" id="b"><string name="filename" value="{tmp_path}/secret"/></bsdf>{FLOOR}'
    first = load_mitsuba(saved(tmp_path, body)).digest
    (tmp_path / "secret").write_bytes(b"b")
    assert load_mitsuba(saved(tmp_path, body)).digest == first


@pytest.mark.parametrize(
    "name", ["a.exr", "a.hdr", *(pytest.param(n, marks=pytest.mark.slow) for n in ("a.pfm", "a.bmp", "a.tga"))]
)
def test_pictures_of_other_formats_are_read_by_a_worker(tmp_path, name):
    pixels = np.linspace(0, 1, 4 * 6 * 3, dtype=np.float32).reshape(4, 6, 3)
    if name[2:] in ("bmp", "tga"):
        PillowImage.fromarray((pixels * 255).astype(np.uint8)).save(tmp_path / name)
    else:
        with two_threads():
            mi.Bitmap(pixels).write(str(tmp_path / name))
    path = saved(tmp_path, texture(name))
    ours = load(path).mi.shapes()[0].bsdf()
    with two_threads():
        theirs = mi.load_file(str(path)).shapes()[0].bsdf()
    data = [np.array(mi.traverse(bsdf)["reflectance.data"]) for bsdf in (ours, theirs)]
    np.testing.assert_array_equal(*data)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: len(whole) // 2])
    assert f"'{name}' cannot be read" in refused(path)


def test_a_serialized_mesh_is_read_by_a_worker(tmp_path):
    import zlib

    head = struct.pack("<I", 0x1000) + b"tri\0" + struct.pack("<QQ", 3, 1)
    body = zlib.compress(head + TRIANGLE.tobytes() + struct.pack("<3I", 0, 1, 2))
    data = struct.pack("<HH", 0x041C, 4) + body
    (tmp_path / "a.serialized").write_bytes(data + struct.pack("<QI", 0, 1))
    place = '<transform name="to_world"><translate z="2"/></transform>'
    path = saved(tmp_path, shape("a.serialized", "serialized", place))
    np.testing.assert_array_equal(load(path).meshes[0].positions, TRIANGLE + np.float32([0, 0, 2]))
    (tmp_path / "a.serialized").write_bytes(data[:24])
    assert "'a.serialized' cannot be read" in refused(path)
    head = struct.pack("<I", 0x1000) + b"tri\0" + struct.pack("<QQ", 3, 1)
    body = zlib.compress(head + TRIANGLE.tobytes() + struct.pack("<3I", 0, 1, 77))
    (tmp_path / "a.serialized").write_bytes(struct.pack("<HH", 0x041C, 4) + body + struct.pack("<QI", 0, 1))
    refused(path)


def test_curves_are_left_out_and_never_opened(tmp_path):
    (tmp_path / "hair.txt").write_bytes(b"\xff" * 100)
    scene = load(saved(tmp_path, FLOOR + shape("hair.txt", "bsplinecurve")))
    assert len(scene.meshes) == 1
    assert any("a bsplinecurve cannot become triangles" in warning for warning in scene.warnings)


def test_an_exr_file_is_checked_before_its_worker_decodes_it(tmp_path):
    write_picture(tmp_path / "a.exr", np.ones((8, 8, 3)))
    data = (tmp_path / "a.exr").read_bytes()
    assert load_mitsuba(saved(tmp_path, texture("a.exr")))
    (tmp_path / "cut.exr").write_bytes(data[:-9])
    assert "'cut.exr' cannot be read as EXR (the file ends early" in refused(saved(tmp_path, texture("cut.exr")))
    windows = struct.pack("<4i", 0, 0, 7, 7), struct.pack("<4i", 0, 0, 16000, 16000)
    (tmp_path / "huge.exr").write_bytes(data.replace(*windows))
    assert "--limit picture_texels" in refused(saved(tmp_path, texture("huge.exr")))


@pytest.mark.parametrize("verb", ["bake", "demo", "render", "live", "info", "compare"])
def test_every_verb_that_loads_a_scene_can_allow_folders(verb):
    from lightwell.cli.arguments import given_options
    from lightwell.cli.main import verb_parser
    from lightwell.core.scene_options import SceneOptions

    needed = {"bake": ["a.xml", "-o", "x"], "render": ["a.xml", "-o", "x.png"], "demo": []}.get(verb, ["a.xml"])
    arguments = verb_parser(verb).parse_args([*needed, "--allow-path", "one", "--allow-path", "two"])
    options = SceneOptions(**given_options(arguments, SceneOptions, verb))
    assert options.loading["allow_paths"] == (Path("one"), Path("two"))
