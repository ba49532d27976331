"""USD, OBJ and PLY scenes: units, axes, materials, lights, what is lost, and files that must be refused."""

import shutil

import numpy as np
import pytest
import trimesh
from gltf_builder import Builder
from PIL import Image as PillowImage
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

from lightwell.limits import Limits
from lightwell.scenes import SceneError, converted, load
from lightwell.scenes.posing import declared_movers
from tests.same_process import SameProcess

OBJ = """
mtllib room.mtl
v 0 0 0
v 2 0 0
v 2 0 -3
v 0 0 -3
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl lamp
f 1/1 2/2 3/3
usemtl floor
f 1/1 3/3 4/4
"""
MTL = """
newmtl lamp
Kd 0.1 0.2 0.3
Ke 4 2 1
Ns 98
newmtl floor
Kd 0.5 0.5 0.5
map_Kd wood.png
map_Bump bumps.png
"""
# A face of a vertex that is not there.
BEYOND = b"v 0 0 0\nf 1 2 900000\n"


@pytest.fixture
def here(monkeypatch):
    """Meshes are converted in this process, which has imported trimesh: in another one that takes two seconds for each.

    Round trips, stages and damaged stages go through the other process.
    """
    monkeypatch.setattr(converted, "Worker", SameProcess)


@pytest.fixture
def obj(tmp_path, here):
    (tmp_path / "room.obj").write_text(OBJ)
    (tmp_path / "room.mtl").write_text(MTL)
    PillowImage.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "wood.png")
    return tmp_path / "room.obj"


def bounds(scene):
    points = np.concatenate([mesh.positions for mesh in scene.meshes])
    return points.min(axis=0).tolist(), points.max(axis=0).tolist()


def test_an_obj_has_its_materials_lamps_and_pictures(obj):
    scene = load(obj)
    materials = {material.name: material for material in scene.materials}
    lamp, floor = materials["lamp"], materials["floor"]
    assert lamp.base_color[:3] == pytest.approx((0.1, 0.2, 0.3)) and lamp.emissive == pytest.approx((4, 2, 1))
    assert lamp.roughness == pytest.approx((2 / 100) ** 0.25) and lamp.metallic == 0
    assert floor.base_color_texture is not None and floor.base_color[:3] == (1, 1, 1)
    assert bounds(scene) == ([0, 0, -3], [2, 0, 0])
    assert any("'map_bump' is ignored" in line for line in scene.warnings)
    assert scene.name == "room.obj" and scene.source == str(obj)
    uv = next(mesh.uv0 for mesh in scene.meshes if scene.materials[mesh.material].name == "floor")
    # OBJ counts v from below, glTF from above.
    assert sorted(map(tuple, uv.tolist())) == [(0, 0), (0, 1), (1, 0)]


def test_an_obj_has_the_unit_that_is_said_and_reads_no_file_outside_of_its_folder(obj, tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    shutil.move(obj, inner / "room.obj")
    (inner / "room.obj").write_text(OBJ.replace("room.mtl", "../room.mtl"))
    scene = load(inner / "room.obj", unit=0.01)
    assert bounds(scene)[1] == pytest.approx([0.02, 0, 0])
    assert all(max(material.emissive) == 0 for material in scene.materials)


@pytest.mark.usefixtures("here")
def test_a_ply_has_the_colours_of_its_vertices(tmp_path):
    mesh = trimesh.creation.box((1, 2, 3))
    mesh.visual.vertex_colors = np.tile(np.uint8([255, 188, 0, 255]), (len(mesh.vertices), 1))
    mesh.export(tmp_path / "box.ply")
    scene = load(tmp_path / "box.ply")
    [box] = scene.meshes
    assert bounds(scene) == ([-0.5, -1, -1.5], [0.5, 1, 1.5])
    assert box.colors[0, :3] == pytest.approx([1, ((188 / 255 + 0.055) / 1.055) ** 2.4, 0], abs=1e-3)


@pytest.mark.usefixtures("here")
def test_pictures_of_any_kind_are_kept_and_missing_ones_are_told(obj, tmp_path):
    (tmp_path / "room.mtl").write_text(MTL.replace("wood.png", "wood.tga") + "newmtl gone\nmap_Kd gone.png\n")
    PillowImage.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "wood.tga")
    scene = load(obj)
    [texture] = [m.base_color_texture for m in scene.materials if m.base_color_texture is not None]
    assert texture.image.pixels[0, 0].tolist() == [200, 100, 50, 255]
    assert any("file 'gone.png' is missing" in line for line in scene.warnings)


OPTIONS = "-blendu on -S 2 4 1 -o 0.5 0.25 0 -clamp on -mm 0 1 -bm 0.3 -imfchan l wood floor.png"


def test_options_of_a_map_are_no_part_of_its_name_and_move_the_picture(obj, tmp_path):
    shutil.move(tmp_path / "wood.png", tmp_path / "wood floor.png")
    (tmp_path / "room.mtl").write_text(MTL.replace("wood.png", OPTIONS))
    scene = load(obj)
    [texture] = [m.base_color_texture for m in scene.materials if m.base_color_texture is not None]
    assert texture.wrap == ("clamp", "clamp")
    # At u, v of OBJ the picture is read at 2 u + 0.5, 4 v + 0.25; v of glTF is 1 - v.
    u, v = 0.3, 0.9
    at = np.array(texture.transform) @ [u, 1 - v, 1]
    np.testing.assert_allclose(at, [2 * u + 0.5, 1 - (4 * v + 0.25), 1])
    assert any("'-imfchan' of its picture is ignored" in line for line in scene.warnings)
    assert not any("'-mm'" in line or "missing" in line for line in scene.warnings)


def test_a_lamp_shines_where_its_picture_is_bright(obj, tmp_path):
    (tmp_path / "room.mtl").write_text(MTL.replace("Ns 98", "Pr 0.5 # half\nmap_Ke -s 2 2 screen.png"))
    PillowImage.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "screen.png")
    [lamp] = [material for material in load(obj).materials if material.name == "lamp"]
    assert lamp.emissive == pytest.approx((4, 2, 1)) and lamp.roughness == 0.5
    texture = lamp.emissive_texture
    assert texture is not None and texture.image.pixels[0, 0].tolist() == [255, 0, 0, 255]
    assert texture.transform is not None and texture.transform[0][0] == 2


@pytest.mark.parametrize("said, expected", [("1.33", 1.33), ("1", 1.5), ("0", 1.5), ("1e9", 1.5), ("glass", 1.5)])
def test_an_index_of_refraction_is_read_where_one_is_given(obj, tmp_path, said, expected):
    (tmp_path / "room.mtl").write_text(MTL.replace("Ns 98", f"Ns 98\nNi {said}"))
    materials = {material.name: material for material in load(obj).materials}
    assert materials["lamp"].ior == pytest.approx(expected) and materials["floor"].ior == 1.5
    assert materials["lamp"].emissive == pytest.approx((4, 2, 1))


def test_one_number_is_a_grey_and_a_remark_is_none(obj, tmp_path):
    lamp, floor = "newmtl lamp\nKd 0.5 # grey\nKe 3\nKs 0.5\nNs 98 # shiny\n", "newmtl floor\nKd 0 0 1\n"
    (tmp_path / "room.mtl").write_text(lamp + floor)
    materials = {material.name: material for material in load(obj).materials}
    lamp, floor = materials["lamp"], materials["floor"]
    assert lamp.base_color[:3] == (0.5, 0.5, 0.5) and lamp.emissive == (3, 3, 3) and floor.base_color[:3] == (0, 0, 1)
    assert lamp.roughness == pytest.approx((2 / 100) ** 0.25)


def test_all_material_libraries_are_read(obj, tmp_path):
    lamp, floor = MTL.split("newmtl floor")
    (tmp_path / "my lamp.mtl").write_text(lamp)
    (tmp_path / "floor.mtl").write_text("newmtl floor" + floor)
    (tmp_path / "white.mtl").write_text("newmtl white\nKd 1 1 1\n")
    lines = "# mtllib none\nmtllib my lamp.mtl\nmtllib white.mtl floor.mtl"
    obj.write_text(OBJ.replace("mtllib room.mtl", lines))
    assert {material.name for material in load(obj).materials} == {"lamp", "floor"}


def test_relative_indices_count_from_the_face(tmp_path, here):
    square = "v {0} 0 0\nv {0} 1 0\nv {0} 1 1\nf -3 -2 -1\n"
    (tmp_path / "a.obj").write_text("".join(square.format(x) for x in range(3)))
    scene = load(tmp_path / "a.obj")
    assert bounds(scene) == ([0, 0, 0], [2, 1, 1]) and sum(len(mesh.indices) for mesh in scene.meshes) == 3
    refused(tmp_path / "b.obj", square.format(0).replace("-3", "-9").encode())


PLY = """ply
format ascii 1.0
comment TextureFile scan.png
element vertex 3
property float x
property float y
property float z
property float s
property float t
element face 1
property list uchar int vertex_indices
end_header
0 0 0 0 0
1 0 0 1 0
0 1 0 0 1
3 0 1 2
"""


@pytest.mark.usefixtures("here")
def test_a_ply_has_its_picture_or_the_colours_of_its_faces(tmp_path):
    PillowImage.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "scan.png")
    (tmp_path / "scan.ply").write_text(PLY)
    [material] = load(tmp_path / "scan.ply").materials
    assert material.base_color_texture.image.pixels[0, 0].tolist() == [200, 100, 50, 255]
    mesh = trimesh.creation.box((1, 2, 3))
    mesh.visual.face_colors = np.tile(np.uint8([255, 0, 0, 255]), (12, 1))
    mesh.visual.face_colors[0] = [0, 255, 0, 255]
    mesh.export(tmp_path / "box.ply")
    [box] = load(tmp_path / "box.ply").meshes
    assert box.colors[:4, :3].tolist() == [[0, 1, 0]] * 3 + [[1, 0, 0]]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.usda", b"#usda 1.0\ndef Mesh 'm' {"),
        # Each is read by a process of its own.
        pytest.param(
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n",
            marks=pytest.mark.slow,
        ),
        pytest.param("a.obj", BEYOND, marks=pytest.mark.slow),
        pytest.param("a.obj", b"\0\1\2", marks=pytest.mark.slow),
        pytest.param("a.ply", b"", marks=pytest.mark.slow),
        pytest.param("a.usdc", b"PXR-USDC" + bytes(200), marks=pytest.mark.slow),
        pytest.param("a.usdz", b"PK\3\4", marks=pytest.mark.slow),
    ],
)
def test_damaged_files_are_one_line(tmp_path, name, content):
    refused(tmp_path / name, content)


def test_a_damaged_mesh_is_one_line(tmp_path, here):
    refused(tmp_path / "a.obj", BEYOND)


def refused(path, content):
    path.write_bytes(content)
    with pytest.raises(SceneError) as error:
        load(path)
    assert str(error.value).startswith(f"scene '{path.name}': ") and "\n" not in str(error.value)


def stage(path, up=UsdGeom.Tokens.z, unit=0.01):
    """A square of one metre on the floor with a lamp, a sun and a camera, in centimetres with z up."""
    made = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(made, up)
    UsdGeom.SetStageMetersPerUnit(made, unit)
    mesh = UsdGeom.Mesh.Define(made, "/floor")
    mesh.CreatePointsAttr([(0, 0, 0), (100, 0, 0), (100, 200, 0), (0, 200, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    UsdGeom.Xformable(mesh).AddTranslateOp().Set(Gf.Vec3d(0, 0, 50))
    return made, mesh


def painted(made, mesh):
    material = UsdShade.Material.Define(made, "/paint")
    shader = UsdShade.Shader.Define(made, "/paint/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0.2, 0.4, 0.6))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.25)
    shader.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(1.0)
    shader.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).Set((0, 3, 0))
    shader.CreateInput("clearcoat", Sdf.ValueTypeNames.Float).Set(1.0)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


@pytest.mark.parametrize("suffix", ["usda", pytest.param("usdc", marks=pytest.mark.slow)])
def test_a_stage_of_centimetres_with_z_up_becomes_metres_with_y_up(tmp_path, suffix):
    made, mesh = stage(tmp_path / f"room.{suffix}")
    painted(made, mesh)
    made.GetRootLayer().Save()
    scene = load(tmp_path / f"room.{suffix}")
    assert np.allclose(bounds(scene), ([0, 0.5, -2], [1, 0.5, 0]), atol=1e-6)
    [floor] = scene.meshes
    a, b, c = (floor.positions[floor.indices[0, k]] for k in range(3))
    assert np.cross(b - a, c - a)[1] > 0
    paint = scene.materials[floor.material]
    assert paint.base_color[:3] == pytest.approx((0.2, 0.4, 0.6)) and (paint.roughness, paint.metallic) == (0.25, 1)
    assert paint.emissive == pytest.approx((0, 3, 0))
    assert any("'clearcoat' is ignored" in line for line in scene.warnings)


def test_lights_and_cameras_of_a_stage(tmp_path):
    made, _ = stage(tmp_path / "room.usda", UsdGeom.Tokens.y, 1.0)
    lamp = UsdLux.SphereLight.Define(made, "/lamp")
    lamp.CreateRadiusAttr(0.5)
    lamp.CreateIntensityAttr(8.0)
    lamp.CreateExposureAttr(1.0)
    lamp.CreateColorAttr((1, 0.5, 0.25))
    UsdGeom.Xformable(lamp).AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    sun = UsdLux.DistantLight.Define(made, "/sun")
    sun.CreateIntensityAttr(1000.0)
    sun.CreateAngleAttr(0.5)
    UsdLux.RectLight.Define(made, "/panel")
    camera = UsdGeom.Camera.Define(made, "/camera")
    camera.CreateFocalLengthAttr(24.0)
    camera.CreateVerticalApertureAttr(24.0)
    made.GetRootLayer().Save()
    scene = load(tmp_path / "room.usda")
    point, directional = scene.lights
    assert point.position == pytest.approx((1, 2, 3)) and point.color == pytest.approx((1, 0.5, 0.25))
    assert point.intensity == pytest.approx(np.pi * 0.25 * 16)
    assert directional.direction == pytest.approx((0, 0, -1))
    assert directional.intensity == pytest.approx(np.pi * np.sin(np.radians(0.25)) ** 2 * 1000)
    assert scene.cameras[0].fov_y == pytest.approx(np.degrees(2 * np.arctan(0.5)))
    assert any("RectLight '/panel' is left out" in line for line in scene.warnings)


def test_a_shaped_light_of_a_stage_is_a_spot_and_has_its_temperature(tmp_path):
    made, _ = stage(tmp_path / "room.usda", UsdGeom.Tokens.y, 1.0)
    big = UsdGeom.Xform.Define(made, "/big")
    big.AddScaleOp().Set((3, 3, 3))
    for name in ("spot", "wide", "equal"):
        lamp = UsdLux.SphereLight.Define(made, f"/big/{name}")
        lamp.CreateRadiusAttr(0.5)
        lamp.CreateIntensityAttr().Set(8.0, 1.0)
        shaping = UsdLux.ShapingAPI.Apply(lamp.GetPrim())
        if name == "spot":
            shaping.CreateShapingConeAngleAttr(40.0)
            shaping.CreateShapingConeSoftnessAttr(0.25)
            lamp.CreateEnableColorTemperatureAttr(True)
            lamp.CreateColorTemperatureAttr(2700.0)
    lamp.CreateNormalizeAttr(True)
    made.GetRootLayer().Save()
    spot, wide, equal = load(tmp_path / "room.usda").lights
    assert (spot.kind, wide.kind, equal.kind) == ("spot", "point", "point")
    assert (spot.inner_cone, spot.outer_cone) == pytest.approx((np.radians(30), np.radians(40)))
    assert spot.color[0] > 2 * spot.color[2] and wide.color == (1, 1, 1)
    # The light as a whole grows with the sphere, unless it is normalised by its area.
    assert wide.intensity == pytest.approx(np.pi * 1.5**2 * 8) and equal.intensity == pytest.approx(2)


def test_texture_coordinates_have_the_name_that_the_material_says(tmp_path):
    PillowImage.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "wood.png")
    made, mesh = stage(tmp_path / "room.usda")
    painted(made, mesh)
    names = Sdf.ValueTypeNames
    for name, size in (("UVMap", 1.0), ("other", 9.0)):
        uv = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name, names.TexCoord2fArray, UsdGeom.Tokens.vertex)
        uv.Set([(0, 0), (size, 0), (size, size), (0, size)])
    reader = UsdShade.Shader.Define(made, "/paint/reader")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", names.String).Set("UVMap")
    wood = UsdShade.Shader.Define(made, "/paint/wood")
    wood.CreateIdAttr("UsdUVTexture")
    wood.CreateInput("file", names.Asset).Set("./wood.png")
    wood.CreateInput("st", names.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    surface = UsdShade.Shader.Get(made, "/paint/surface")
    surface.GetInput("diffuseColor").ConnectToSource(wood.ConnectableAPI(), "rgb")
    made.GetRootLayer().Save()
    [floor] = load(tmp_path / "room.usda").meshes
    assert floor.uv0 is not None and floor.uv0.max() == 1 and floor.uv0.min() == 0


def test_a_picture_has_the_place_the_factor_and_the_file_that_its_shaders_say(tmp_path):
    """Each value may stand in the interface of the material; a file is relative to the layer that names it."""
    (tmp_path / "props").mkdir()
    PillowImage.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "props" / "wood.png")
    made, mesh = stage(tmp_path / "props" / "chair.usda")
    painted(made, mesh)
    names = Sdf.ValueTypeNames
    material, surface = UsdShade.Material.Get(made, "/paint"), UsdShade.Shader.Get(made, "/paint/surface")
    rough, file = material.CreateInput("rough", names.Float), material.CreateInput("file", names.Asset)
    rough.Set(0.75)
    surface.CreateInput("ior", names.Float).Set(1.25)
    file.Set("./wood.png")
    surface.GetInput("roughness").ConnectToSource(rough)
    turn = UsdShade.Shader.Define(made, "/paint/turn")
    turn.CreateIdAttr("UsdTransform2d")
    turn.CreateInput("rotation", names.Float).Set(90)
    turn.CreateInput("scale", names.Float2).Set((2, 3))
    turn.CreateInput("translation", names.Float2).Set((0.25, 0.5))
    wood = UsdShade.Shader.Define(made, "/paint/wood")
    wood.CreateIdAttr("UsdUVTexture")
    wood.CreateInput("file", names.Asset).ConnectToSource(file)
    wood.CreateInput("scale", names.Float4).Set((8, 4, 2, 1))
    wood.CreateInput("wrapS", names.Token).Set("clamp")
    wood.CreateInput("wrapT", names.Token).Set("mirror")
    wood.CreateInput("st", names.Float2).ConnectToSource(turn.ConnectableAPI(), "result")
    surface.GetInput("emissiveColor").ConnectToSource(wood.ConnectableAPI(), "rgb")
    made.GetRootLayer().Save()
    # A stage that contains the other as a layer.
    room = Usd.Stage.CreateNew(str(tmp_path / "room.usda"))
    room.GetRootLayer().subLayerPaths.append("props/chair.usda")
    room.GetRootLayer().Save()
    scene = load(tmp_path / "room.usda")
    paint = scene.materials[scene.meshes[0].material]
    assert (paint.roughness, paint.ior) == (0.75, 1.25) and paint.emissive == pytest.approx((8, 4, 2))
    texture = paint.emissive_texture
    assert texture is not None and texture.wrap == ("clamp", "mirror")
    # Scaled, turned to the left, then moved; v of USD counts upwards.
    u, v = 0.3, 0.9
    np.testing.assert_allclose(np.array(texture.transform) @ [u, 1 - v, 1], [-3 * v + 0.25, 1 - (2 * u + 0.5), 1])


def test_a_point_instancer_places_its_prototypes_alone(tmp_path):
    made, _ = stage(tmp_path / "room.usda")
    instancer = UsdGeom.PointInstancer.Define(made, "/trees")
    UsdGeom.Xformable(instancer).AddTranslateOp().Set(Gf.Vec3d(0, 0, 100))
    UsdGeom.Xform.Define(made, "/trees/tree")
    leaf = UsdGeom.Mesh.Define(made, "/trees/tree/leaf")
    leaf.CreatePointsAttr([(0, 0, 0), (10, 0, 0), (0, 10, 0)])
    leaf.CreateFaceVertexCountsAttr([3])
    leaf.CreateFaceVertexIndicesAttr([0, 1, 2])
    UsdGeom.Xformable(leaf).AddTranslateOp().Set(Gf.Vec3d(1, 0, 0))
    instancer.CreatePrototypesRel().AddTarget("/trees/tree")
    instancer.CreateProtoIndicesAttr([0, 0, 0])
    instancer.CreatePositionsAttr([(0, 0, 0), (300, 0, 0), (900, 0, 0)])
    instancer.CreateInvisibleIdsAttr([2])
    instancer.CreateScalesAttr([(1, 1, 1), (2, 2, 2), (1, 1, 1)])
    made.GetRootLayer().Save()
    scene = load(tmp_path / "room.usda")
    first, second = scene.meshes[1:] if len(scene.meshes[0].positions) == 4 else scene.meshes[:-1]
    # Centimetres with z up.
    np.testing.assert_allclose(first.positions, [[0.01, 1, 0], [0.11, 1, 0], [0.01, 1, -0.1]], atol=1e-6)
    np.testing.assert_allclose(second.positions, [[3.02, 1, 0], [3.22, 1, 0], [3.02, 1, -0.2]], atol=1e-6)


def test_display_colours_of_vertices_are_kept(tmp_path):
    made, mesh = stage(tmp_path / "room.usda")
    colors = mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
    colors.Set([(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.25, 0.5, 0.75)])
    made.GetRootLayer().Save()
    [floor] = load(tmp_path / "room.usda").meshes
    np.testing.assert_allclose(floor.colors[:, :3], [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.25, 0.5, 0.75]])


def test_a_stage_states_its_unit_and_limits_hold_for_converted_files(tmp_path):
    made, _ = stage(tmp_path / "room.usda")
    made.GetRootLayer().Save()
    with pytest.raises(SceneError, match="vertices"):
        load(tmp_path / "room.usda", limits=Limits(vertices=3))
    with pytest.raises(SceneError, match="bytes"):
        load(tmp_path / "room.usda", limits=Limits(file_bytes=10))
    with pytest.raises(SceneError, match="states its own unit"):
        load(tmp_path / "room.usda", unit=0.01)


def test_clips_of_a_blend_file_can_be_read_when_it_is_loaded(tmp_path, monkeypatch):
    file = Builder()
    file.mesh()
    file.mesh()
    times, ways = file.accessor(np.float32([0, 1])), file.accessor(np.float32([[0, 0, 0], [0, 0, 1]]))
    channel = {"sampler": 0, "target": {"node": 1, "path": "translation"}}
    file.add("animations", {"name": "Open", "channels": [channel], "samplers": [{"input": times, "output": ways}]})
    exported = file.save(tmp_path)
    blender = tmp_path / "blender"
    blender.write_text(f'#!/bin/sh\nfor last; do :; done\ncp "{exported}" "$last"\n')
    blender.chmod(0o755)
    monkeypatch.setenv("BLENDER", str(blender))
    monkeypatch.delenv("LIGHTWELL_BPY", raising=False)
    (tmp_path / "room.blend").write_bytes(b"BLENDER-v405")
    [mover] = declared_movers(["animation:Open=0..1"], load(tmp_path / "room.blend"))
    assert mover.seconds == 1


def test_a_blend_file_without_blender_says_what_it_needs(tmp_path, monkeypatch):
    monkeypatch.delenv("BLENDER", raising=False)
    monkeypatch.delenv("LIGHTWELL_BPY", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    (tmp_path / "room.blend").write_bytes(b"BLENDER-v405")
    with pytest.raises(SceneError, match="need Blender; install it"):
        load(tmp_path / "room.blend")
