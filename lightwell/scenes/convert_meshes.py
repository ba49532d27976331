"""Converts OBJ and PLY files to GLB with trimesh; runs in a process of its own."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.core.isolated import Arrays
from lightwell.scenes.convert_files import Folder, as_png
from lightwell.scenes.convert_mtl import MaterialFiles, decoded, map_statement, prepared
from lightwell.scenes.glb_writer import GlbWriter

# Roughness of a material without a specular exponent.
MATT = 1.0
# Largest index of refraction of an MTL file that is read: that of no dielectric is larger.
MOST_IOR = 4.0
# Statements of an MTL file that are read (some by other names), and those that say nothing about light.
READ = {"kd", "ke", "ns", "pr", "pm", "ni", "d", "tr", "map_kd", "map_ke", "diffuse", "glossiness", "image", "name"}
SILENT = {"ka", "ambient", "illum", "map_ka"}


def convert(request: Arrays) -> Arrays:
    """Convert a file.

    Args:
        request: ``path``, the file; ``most_bytes``, what may be read in all.

    Returns:
        ``glb`` [n] uint8, the file; ``lost`` [m] text, what it does not hold.

    Raises:
        ValueError: The file cannot be read.
        MemoryError: There is not enough memory.
    """
    import trimesh

    path = Path(str(request["path"]))
    folder = MaterialFiles(path.parent, int(request["most_bytes"]))
    data, kind = folder[path.name], path.suffix.lower()[1:]
    if kind == "obj":
        data = prepared(decoded(data), folder).encode()
    try:
        # Objects of an OBJ file stay what they are: points are drawn for each of them.
        words = {"split_objects": True} if kind == "obj" else {}
        scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=folder, process=False, **words)
    except MemoryError:
        raise
    except Exception as error:
        # trimesh trusts its files: what it raises on damaged ones is any error of Python.
        raise ValueError(f"its content is damaged ({' '.join(str(error).split())[:100]})") from error
    writer, lost = GlbWriter(), set[str]()
    for name, mesh in scene.geometry.items():
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            _add(writer, str(name), mesh, folder, lost)
        else:
            lost.add(f"'{name}' has no triangles and is left out")
    # trimesh goes on without them, and says nothing.
    lost |= {f"file '{name[:60]}' is missing or outside of the scene's folder" for name in folder.missing if name}
    return {"glb": np.frombuffer(writer.encoded(), np.uint8), "lost": np.array(sorted(lost), dtype=str)}


def _add(writer: GlbWriter, name: str, mesh: Any, folder: Folder, lost: set[str]) -> None:
    """Add a mesh with its material."""
    attributes = {"POSITION": mesh.vertices}
    # Normals of the file are in trimesh's cache; asked for others, it would compute smooth ones.
    if "vertex_normals" in mesh._cache.cache:
        attributes["NORMAL"] = mesh.vertex_normals
    visual, material = mesh.visual, None
    if visual.kind == "texture" and visual.uv is not None and len(visual.uv) == len(mesh.vertices):
        attributes["TEXCOORD_0"] = np.stack([visual.uv[:, 0], 1 - visual.uv[:, 1]], axis=1)
    if visual.kind == "texture" and visual.material is not None:
        material = writer.material(_material(visual.material, writer, folder, lost))
    elif visual.kind == "vertex":
        attributes["COLOR_0"] = _linear(np.asarray(visual.vertex_colors)[:, :4] / 255)
        material = writer.material(_matt(name))
    elif visual.kind == "face":
        # Each triangle has corners of its own: glTF has no colours of faces.
        attributes = {"POSITION": mesh.triangles.reshape(-1, 3)}
        attributes["COLOR_0"] = _linear(np.repeat(np.asarray(visual.face_colors)[:, :4] / 255, 3, axis=0))
        material = writer.material(_matt(name))
        writer.mesh(name, attributes, np.arange(3 * len(mesh.faces)).reshape(-1, 3), material)
        return
    writer.mesh(name, attributes, mesh.faces, material)


def _matt(name: str) -> dict[str, Any]:
    """A white matt material, for colours of vertices and faces."""
    return {"name": name, "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": MATT}}


def _linear(srgb: np.ndarray) -> np.ndarray:
    """Colours of bytes are sRGB; alpha is not."""
    color = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    color[:, 3] = srgb[:, 3]
    return color


def _material(source: Any, writer: GlbWriter, folder: Folder, lost: set[str]) -> dict[str, Any]:
    """A material of an MTL file as a glTF material; what is not read is added to ``lost``."""
    said: dict[str, Any] = getattr(source, "kwargs", {})
    name = str(getattr(source, "name", "") or "material")
    color = _numbers(said.get("kd"), [0.8] * 3)
    alpha = _numbers(said.get("d"), [1 - _numbers(said.get("tr"), [0.0])[0]])[0]
    pbr: dict[str, Any] = {
        "baseColorFactor": [*np.clip(color, 0, 1).tolist(), float(np.clip(alpha, 0, 1))],
        "metallicFactor": float(np.clip(_numbers(said.get("pm"), [0.0])[0], 0, 1)),
        "roughnessFactor": _roughness(said),
    }
    image = getattr(source, "image", None)
    if image is not None:
        # Other pictures than PNG and JPEG, and those of PLY files, have been opened by trimesh alone.
        statement = map_statement(str(image.info.get("file_path", "")))
        picture = folder.picture(statement.file) or as_png(image)
        if picture is None:
            lost.add(f"material '{name}': its picture cannot be read and is left out")
        else:
            # A map takes the place of the colour in most programs that write OBJ files.
            pbr |= {
                "baseColorTexture": writer.texture(*picture, statement.wrap, statement.transform),
                "baseColorFactor": [1, 1, 1, pbr["baseColorFactor"][3]],
            }
            lost |= {f"material '{name}': '{option}' of its picture is ignored" for option in statement.ignored}
    entry: dict[str, Any] = {"name": name, "pbrMetallicRoughness": pbr, "doubleSided": True}
    if alpha < 1:
        entry["alphaMode"] = "BLEND"
    # Programs write 1, at which nothing is reflected, for surfaces that nobody gave an index.
    if 1 < (ior := float(_numbers(said.get("ni"), [1.0])[0])) <= MOST_IOR:
        entry["extensions"] = {"KHR_materials_ior": {"ior": ior}}
    _emission(said, entry, writer, folder, lost)
    lost |= {f"material '{name}': '{key}' is ignored" for key in said if key.lower() not in READ | SILENT}
    return entry


def _emission(said: dict[str, Any], entry: dict[str, Any], writer: GlbWriter, folder: Folder, lost: set[str]) -> None:
    """Add the emission of a material; a picture without ``Ke``, or with one of 0, has radiance 1 where it is white."""
    emission, what = np.maximum(_numbers(said.get("ke"), [0.0] * 3), 0), f"material '{entry['name']}'"
    if "map_ke" in said:
        statement = map_statement(" ".join(said["map_ke"]))
        picture = folder.picture(statement.file)
        if picture is None:
            lost.add(f"{what}: the picture of its emission is missing or neither PNG nor JPEG, and is left out")
        else:
            entry["emissiveTexture"] = writer.texture(*picture, statement.wrap, statement.transform)
            emission = emission if emission.max() > 0 else np.ones(3)
            lost |= {f"{what}: '{option}' of the picture of its emission is ignored" for option in statement.ignored}
    if emission.max() > 0:
        entry["emissiveFactor"] = (emission / max(1.0, emission.max())).tolist()
        strength = {"emissiveStrength": max(1.0, float(emission.max()))}
        entry.setdefault("extensions", {})["KHR_materials_emissive_strength"] = strength


def _roughness(said: dict[str, Any]) -> float:
    """glTF roughness from Pr, or from the exponent of a Blinn-Phong lobe: α² = 2 / (Ns + 2), roughness = √α."""
    if "pr" in said:
        return float(np.clip(_numbers(said["pr"], [MATT])[0], 0, 1))
    if "ns" in said:
        return float((2 / (max(_numbers(said["ns"], [0.0])[0], 0) + 2)) ** 0.25)
    return MATT


def _numbers(value: Any, default: list[float]) -> np.ndarray:
    """Numbers of a statement; the default where it is missing or holds none."""
    try:
        found = np.atleast_1d(np.asarray(value, float)) if value is not None else np.asarray(default, float)
    except (TypeError, ValueError):
        return np.asarray(default, float)
    return found if len(found) == len(default) and np.isfinite(found).all() else np.asarray(default, float)
