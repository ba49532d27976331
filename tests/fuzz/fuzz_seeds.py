"""Small sound files of every format, made here; each is what a mutator begins with."""

from __future__ import annotations

import io
import json
import sys
import tempfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage

TESTS = Path(__file__).parents[1]


@dataclass(frozen=True)
class Case:
    """Files of one folder, one of which is opened."""

    files: dict[str, bytes]
    entry: str
    """The file that is opened; '.' for the folder itself."""
    mutated: str
    """The file that mutations change."""

    @property
    def data(self) -> bytes:
        """What mutations change."""
        return self.files[self.mutated]

    def changed(self, data: bytes) -> Case:
        """The case with other bytes in the file that mutations change."""
        return replace(self, files={**self.files, self.mutated: data})


def single(name: str, data: bytes) -> Case:
    """A case of one file."""
    return Case({name: data}, name, name)


def _import(folder: str, name: str):
    """A module of helpers that other tests use."""
    place = str(TESTS / folder)
    if place not in sys.path:
        sys.path.append(place)
    return __import__(name)


def _written(write: Callable[[Path], object], name: str = "file") -> bytes:
    """The bytes that ``write`` puts into a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


# ------------------------------------------------------------------ pictures


def png(mode: str = "RGB", size: int = 6) -> bytes:
    """A small PNG of noise."""
    pixels = np.random.default_rng(0).integers(0, 256, (size, size, 3), dtype=np.uint8)
    out = io.BytesIO()
    PillowImage.fromarray(pixels).convert(mode).save(out, "PNG")
    return out.getvalue()


def jpeg() -> bytes:
    """A small JPEG."""
    out = io.BytesIO()
    PillowImage.open(io.BytesIO(png(size=16))).save(out, "JPEG")
    return out.getvalue()


def hdr(run_length: bool = False) -> bytes:
    """A Radiance picture of 16 by 8 pixels."""
    rows = np.random.default_rng(1).integers(1, 200, (8, 16, 4), dtype=np.uint8)
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n"
    if not run_length:
        return head + rows.tobytes()
    body = b"".join(b"\x02\x02\x00\x10" + b"".join(b"\x10" + row[:, c].tobytes() for c in range(4)) for row in rows)
    return head + body


def exr(kind: str = "plain") -> bytes:
    """An OpenEXR frame with depth: plain, compressed, or of two parts; as a sky without depth."""
    import OpenEXR

    rng = np.random.default_rng(2)
    planes = {name: rng.random((12, 16)).astype(np.float16) for name in "RGBA"}
    if kind != "sky":
        planes["Z"] = (1 + rng.random((12, 16))).astype(np.float32)
    compression = {"plain": OpenEXR.NO_COMPRESSION, "zip": OpenEXR.ZIP_COMPRESSION}.get(kind, OpenEXR.PIZ_COMPRESSION)
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    if kind != "parts":
        return _written(lambda path: OpenEXR.File(header, planes).write(str(path)), "file.exr")
    parts = [
        OpenEXR.Part({**header, "name": "rgba"}, {k: planes[k] for k in "RGBA"}),
        OpenEXR.Part({**header, "name": "depth"}, {"Z": planes["Z"]}),
    ]
    return _written(lambda path: OpenEXR.File(parts).write(str(path)), "file.exr")


# ------------------------------------------------------------------ glTF


def _room():
    """A scene with one of nearly everything, as the builder of the loader's tests makes it."""
    builder = _import("scenes", "gltf_builder")
    file = builder.Builder()
    pixels = np.random.default_rng(3).integers(0, 256, (4, 4, 3), dtype=np.uint8)
    colour = file.texture(pixels, wrapS=33071, magFilter=9728)
    transform = {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [2, 2]}}
    wood = {
        "name": "wood",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.9, 0.8, 0.7, 1],
            "baseColorTexture": {**colour, "extensions": transform},
            "metallicFactor": 0.1,
            "roughnessFactor": 0.5,
        },
        "normalTexture": {**colour, "scale": 0.5},
        "emissiveFactor": [0.1, 0.2, 0.3],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2.0}, "KHR_materials_ior": {"ior": 1.4}},
    }
    file.add("materials", wood)
    normals = np.tile(np.float32([0, 0, 1]), (4, 1))
    file.mesh(uv=builder.SQUARE_UV, normals=normals, material=0, node=False)
    position = file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    file.json["accessors"][position] |= {"min": [-1, -1, 0], "max": [1, 1, 0]}
    file.json["accessors"][position]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": file.view(np.uint16([2]).tobytes()), "componentType": 5123},
        "values": {"bufferView": file.view(np.float32([2, 2, 0]).tobytes())},
    }
    file.mesh(np.float32([[0, 0, 1], [1, 0, 1], [0, 1, 1]]), None, node=False, mode=5)
    file.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}})
    lights = [{"type": "spot", "intensity": 5, "color": [1, 1, 1], "spot": {"outerConeAngle": 0.5}}]
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    file.json["extensionsUsed"] = ["KHR_lights_punctual", "KHR_texture_transform"]
    file.json["nodes"] = [
        {"children": [1, 2, 3], "rotation": [0, 0, 0, 1], "translation": [0, 1, 0], "scale": [1, 2, 1]},
        {"mesh": 0, "name": "floor"},
        {"mesh": 1, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
        {"camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}},
    ]
    return file


def _skinned():
    builder = _import("scenes", "gltf_builder")
    file = builder.Builder()
    joints = {
        "JOINTS_0": file.accessor(np.uint8([[0, 1, 0, 0]] * 4)),
        "WEIGHTS_0": file.accessor(np.float32([[0.5, 0.5, 0, 0]] * 4)),
    }
    number = file.mesh(node=False, attributes=joints)
    inverse = file.accessor(np.tile(np.eye(4, dtype=np.float32).ravel(), (2, 1))[:, :4])
    file.json["accessors"][inverse] |= {"type": "MAT4", "count": 2}
    file.json["accessors"][inverse]["bufferView"] = file.view(np.tile(np.eye(4, dtype=np.float32).ravel(), 2).tobytes())
    skin = file.add("skins", {"joints": [1, 2], "inverseBindMatrices": inverse})
    file.json["nodes"] = [{"mesh": number, "skin": skin}, {"translation": [1, 0, 0]}, {"translation": [0, 1, 0]}]
    return file


def _compressed():
    """A mesh that Draco packed and one that meshopt packed."""
    import DracoPy

    builder = _import("scenes", "gltf_builder")
    file = builder.Builder()
    faces = builder.SQUARE_INDICES.reshape(-1, 3).astype(np.uint32)
    data = DracoPy.encode(builder.SQUARE, faces, quantization_bits=14, preserve_order=True)
    view = file.view(data)
    file.add("accessors", {"componentType": 5126, "count": 4, "type": "VEC3"})
    file.add("accessors", {"componentType": 5125, "count": 6, "type": "SCALAR"})
    packed = {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": {"POSITION": 0}}}
    file.add("meshes", {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "extensions": packed}]})
    file.add("nodes", {"mesh": 0})
    file.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    try:
        import meshopt
    except ImportError:
        return file
    body = meshopt.encode_gltf_buffer(builder.SQUARE, "ATTRIBUTES")
    number = file.view(body)
    file.json["bufferViews"][number]["byteLength"] = 48
    source = {"buffer": 0, "byteOffset": file.json["bufferViews"][number]["byteOffset"], "byteLength": len(body)}
    file.json["bufferViews"][number]["extensions"] = {
        "EXT_meshopt_compression": {**source, "mode": "ATTRIBUTES", "count": 4, "byteStride": 12}
    }
    file.add("accessors", {"bufferView": number, "componentType": 5126, "count": 4, "type": "VEC3"})
    file.add("meshes", {"primitives": [{"attributes": {"POSITION": 2}, "mode": 5}]})
    file.add("nodes", {"mesh": 1})
    return file


def glb_rooms() -> list[Case]:
    """Scenes in GLB files."""
    return [single("room.glb", make().bytes()) for make in (_room, _skinned, _compressed)]


def gltf_rooms() -> list[Case]:
    """Scenes as JSON with a file of bytes beside it, or with a data URI."""
    import base64

    from fuzz_containers import glb_parts

    cases = []
    for number, case in enumerate(glb_rooms()):
        text, binary = glb_parts(case.data)
        document = json.loads(text)
        uri = "room.bin" if number else "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
        document["buffers"][0]["uri"] = uri
        cases.append(Case({"room.gltf": json.dumps(document).encode(), "room.bin": binary}, "room.gltf", "room.gltf"))
    return cases


def textures() -> list[Case]:
    """Scenes whose texture is a file beside them, as glTF and as Mitsuba XML."""
    builder = _import("scenes", "gltf_builder")
    cases = []
    for name, data in {"a.png": png(), "b.png": png("P"), "c.png": png("RGBA"), "d.jpg": jpeg()}.items():
        file = builder.Builder()
        file.json |= {"images": [{"uri": name}], "textures": [{"source": 0}]}
        file.add(
            "materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "normalTexture": {"index": 0}}
        )
        file.mesh(uv=builder.SQUARE_UV, material=0)
        cases.append(Case({"room.glb": file.bytes(), name: data}, "room.glb", name))
        cases.append(Case({"room.xml": _picture_scene(name), name: data}, "room.xml", name))
    return cases


def _picture_scene(name: str) -> bytes:
    texture = f'<texture type="bitmap" name="reflectance"><string name="filename" value="{name}"/></texture>'
    return scene_xml(f'<shape type="rectangle"><bsdf type="diffuse">{texture}</bsdf></shape>')


def environments() -> list[Case]:
    """Mitsuba scenes that an .hdr file surrounds."""
    cases = []
    for data in (hdr(), hdr(True)):
        for body in (
            '<emitter type="envmap"><string name="filename" value="sky.hdr"/></emitter><shape type="sphere"/>',
            _picture_scene("sky.hdr").decode(),
        ):
            text = scene_xml(body) if "<scene" not in body else body.encode()
            cases.append(Case({"room.xml": text, "sky.hdr": data}, "room.xml", "sky.hdr"))
    return cases


def frames() -> list[Case]:
    """OpenEXR frames of the lens, and the sky of a Mitsuba scene."""
    cases = [single("frame.exr", exr(kind)) for kind in ("plain", "zip", "piz", "parts")]
    sky = '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter><shape type="sphere"/>'
    cases.append(Case({"room.xml": scene_xml(sky), "sky.exr": exr("sky")}, "room.xml", "sky.exr"))
    return cases


# ------------------------------------------------------------------ Mitsuba


def scene_xml(body: str) -> bytes:
    """A scene element around ``body``."""
    return f'<scene version="3.0.0">\n{body}\n</scene>\n'.encode()


ROOM = """<default name="spp" value="4"/>
<integrator type="path"><integer name="max_depth" value="5"/></integrator>
<sensor type="perspective" id="camera"><float name="fov" value="45"/>
<transform name="to_world"><lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/><rfilter type="box"/></film>
<sampler type="independent"><integer name="sample_count" value="$spp"/></sampler></sensor>
<bsdf type="twosided" id="id0"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf></bsdf>
<bsdf type="principled" id="id1"><float name="roughness" value="0.3"/><float name="metallic" value="0.5"/></bsdf>
<bsdf type="roughconductor" id="id2"><string name="material" value="Au"/><float name="alpha" value="0.2"/></bsdf>
<texture type="bitmap" id="wood"><string name="filename" value="picture.png"/></texture>
<bsdf type="diffuse" id="id3"><ref id="wood" name="reflectance"/></bsdf>
<shape type="rectangle"><ref id="id0"/>
<transform name="to_world"><scale value="2"/><rotate x="1" angle="-90"/></transform></shape>
<shape type="sphere"><ref id="id1"/><float name="radius" value="0.3"/><point name="center" x="0" y="0.5" z="0"/></shape>
<shape type="cube"><ref id="id2"/></shape>
<shape type="ply"><string name="filename" value="mesh.ply"/><ref id="id3"/></shape>
<shape type="shapegroup" id="group"><shape type="cylinder"/></shape>
<shape type="instance"><ref id="group"/><transform name="to_world"><translate x="1"/></transform></shape>
<shape type="disk"><emitter type="area"><rgb name="radiance" value="5, 5, 5"/></emitter></shape>
<emitter type="point"><point name="position" x="0" y="2" z="0"/><rgb name="intensity" value="1, 2, 3"/></emitter>
<emitter type="constant"><rgb name="radiance" value="0.1"/></emitter>"""

LAYERS = """<bsdf type="mask" id="id0"><texture type="checkerboard" name="opacity"/><bsdf type="dielectric"/></bsdf>
<bsdf type="blendbsdf" id="id1"><float name="weight" value="0.5"/><bsdf type="plastic"/><bsdf type="conductor"/></bsdf>
<bsdf type="bumpmap" id="id2">
<texture type="bitmap" name="arbitrary"><string name="filename" value="picture.png"/></texture>
<bsdf type="diffuse"/></bsdf>
<bsdf type="normalmap" id="id3"><texture type="bitmap" name="normalmap"><string name="filename" value="picture.png"/>
<boolean name="raw" value="true"/></texture><bsdf type="roughplastic"/></bsdf>
<shape type="obj"><string name="filename" value="mesh.obj"/><ref id="id0"/></shape>
<shape type="cube"><ref id="id1"/><boolean name="flip_normals" value="true"/></shape>
<shape type="cube"><ref id="id2"/></shape><shape type="disk"><ref id="id3"/></shape>
<emitter type="spot"><float name="cutoff_angle" value="30"/><rgb name="intensity" value="1"/></emitter>
<emitter type="directional"><vector name="direction" x="0" y="-1" z="0"/></emitter>"""


def xml_rooms() -> list[Case]:
    """Mitsuba scenes and the files that they name."""
    beside = {"mesh.ply": ply(), "mesh.obj": OBJ, "picture.png": png()}
    return [Case({**beside, "room.xml": scene_xml(body)}, "room.xml", "room.xml") for body in (ROOM, LAYERS)]


def ply(form: str = "binary_little_endian") -> bytes:
    """A square with normals and texture coordinates, two triangles, or a quad where ``form`` is ascii."""
    names = "x y z nx ny nz u v".split()
    corners = np.float32(
        [[-1, -1, 0, 0, 0, 1, 0, 0], [1, -1, 0, 0, 0, 1, 1, 0], [1, 1, 0, 0, 0, 1, 1, 1], [-1, 1, 0, 0, 0, 1, 0, 1]]
    )
    faces = [[0, 1, 2], [0, 2, 3]]
    head = ["ply", f"format {form} 1.0", "element vertex 4", *(f"property float {n}" for n in names)]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    text = "\n".join(head).encode()
    if form == "ascii":
        rows = [" ".join(f"{v:g}" for v in row) for row in corners] + [f"3 {a} {b} {c}" for a, b, c in faces]
        return text + "\n".join([*rows, ""]).encode()
    order = "<" if "little" in form else ">"
    body = corners.astype(order + "f4").tobytes()
    return text + body + b"".join(b"\3" + np.array(face, order + "i4").tobytes() for face in faces)


OBJ = b"""# a square
v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
vt 0 0
vt 1 0
vt 1 1
vn 0 0 1
g floor
f 1/1/1 2/2/1 3/3/1
f 1//1 3//1 4//1
f 1/1 2/2 4/3
"""


def mesh_rooms(kind: str) -> list[Case]:
    """Mitsuba scenes whose mesh is a file beside them."""
    forms = [ply("binary_little_endian"), ply("ascii"), ply("binary_big_endian")] if kind == "ply" else [OBJ]
    text = scene_xml(f'<shape type="{kind}"><string name="filename" value="mesh.{kind}"/></shape>')
    return [Case({"room.xml": text, f"mesh.{kind}": data}, "room.xml", f"mesh.{kind}") for data in forms]


def crc(data: bytes) -> str:
    """Eight digits that name a file."""
    return f"{zlib.crc32(data):08x}"
