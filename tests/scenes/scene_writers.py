"""Writes a loaded scene as OBJ and as USD, in centimetres with z up, to read it back."""

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

from lightwell.scenes.scene import Material, Scene

# From metres with y up to centimetres with z up.
TO_Z_UP = 100 * np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
RADIUS = 0.5


def picture(material: Material, folder: Path) -> str:
    """Write the picture of a material; returns its name, or "" where it has none."""
    if material.base_color_texture is None:
        return ""
    image = material.base_color_texture.image
    name = f"{material.name}.{image.mime.split('/')[1]}"
    (folder / name).write_bytes(image.data)
    return name


def write_obj(scene: Scene, path: Path) -> None:
    """Meshes and materials; OBJ has no lights of its own."""
    library = []
    for material in scene.materials:
        name = picture(material, path.parent)
        library += [f"newmtl {material.name}", "Kd {} {} {}".format(*material.base_color[:3])]
        library += [f"Pr {material.roughness}", f"Pm {material.metallic}", "Ke {} {} {}".format(*material.emissive)]
        library += [f"map_Kd {name}"] if name else []
    path.with_suffix(".mtl").write_text("\n".join(library) + "\n")
    lines, first = [f"mtllib {path.stem}.mtl"], 1
    for mesh in scene.meshes:
        uv = np.zeros((len(mesh.positions), 2)) if mesh.uv0 is None else mesh.uv0
        lines += [f"o {mesh.name}"]
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.positions]
        lines += [f"vn {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.normals]
        lines += [f"vt {u:.9g} {1 - v:.9g}" for u, v in uv]
        lines.append(f"usemtl {scene.materials[mesh.material].name}")
        lines += ["f " + " ".join(f"{i}/{i}/{i}" for i in row) for row in mesh.indices.astype(int) + first]
        first += len(mesh.positions)
    path.write_text("\n".join(lines) + "\n")


def write_usd(scene: Scene, path: Path) -> None:
    """Meshes, materials, point lights and suns."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    materials = [_usd_material(stage, material, i, path.parent) for i, material in enumerate(scene.materials)]
    for i, mesh in enumerate(scene.meshes):
        made = UsdGeom.Mesh.Define(stage, f"/mesh{i}")
        made.CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in mesh.positions @ TO_Z_UP.T])
        made.CreateFaceVertexCountsAttr([3] * len(mesh.indices))
        made.CreateFaceVertexIndicesAttr(mesh.indices.astype(int).ravel().tolist())
        made.CreateSubdivisionSchemeAttr("none")
        made.CreateNormalsAttr([Gf.Vec3f(*map(float, n)) for n in mesh.normals @ TO_Z_UP.T / 100])
        made.SetNormalsInterpolation("vertex")
        if mesh.uv0 is not None:
            uv = UsdGeom.PrimvarsAPI(made).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
            uv.Set([Gf.Vec2f(float(u), float(1 - v)) for u, v in mesh.uv0])
        UsdShade.MaterialBindingAPI.Apply(made.GetPrim()).Bind(materials[mesh.material])
    for i, light in enumerate(scene.lights):
        if light.kind == "point":
            lamp = UsdLux.SphereLight.Define(stage, f"/light{i}")
            lamp.CreateRadiusAttr(RADIUS)
            lamp.CreateIntensityAttr(light.intensity / (np.pi * (0.01 * RADIUS) ** 2))
            lamp.CreateColorAttr(Gf.Vec3f(*light.color))
            UsdGeom.Xformable(lamp).AddTranslateOp().Set(Gf.Vec3d(*(TO_Z_UP @ light.position).tolist()))
    stage.GetRootLayer().Save()


def _usd_material(stage, material: Material, number: int, folder: Path):
    made = UsdShade.Material.Define(stage, f"/material{number}")
    shader = UsdShade.Shader.Define(stage, f"/material{number}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    color = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    color.Set(Gf.Vec3f(*map(float, material.base_color[:3])))
    for name in ("roughness", "metallic"):
        shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(float(getattr(material, name)))
    shader.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*map(float, material.emissive)))
    if name := picture(material, folder):
        texture = UsdShade.Shader.Define(stage, f"/material{number}/picture")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{name}")
        output = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        color.ConnectToSource(output)
    made.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return made
