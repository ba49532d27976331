"""The files that snippets of the docs name and do not make: scenes, rendered frames, a baked folder."""

from __future__ import annotations

import json
import shutil
import struct
from pathlib import Path

import numpy as np

ROOM = """<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="perspective"><float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0, 1, 2.5" target="0, 1, 0" up="0, 1, 0"/></transform></sensor>
  <shape type="cube"><boolean name="flip_normals" value="true"/>
    <transform name="to_world"><scale x="3" y="1.5" z="3"/><translate y="1.5"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.5, 0.4"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate y="2.9"/></transform>
    <emitter type="area"><rgb name="radiance" value="4, 4, 4"/></emitter></shape>
</scene>
"""
FRAME = (400, 700)
# Settings of two scenes: `lightwell batch` bakes them.
SETTINGS = """[scenes.kitchen]
scene = "rooms/kitchen.glb"
[scenes.hall]
scene = "rooms/hall.glb"
seed = 3
"""
# Ordinary scenes that readers bring along.
SCENES = ("room.glb", "edited.glb", "flat.glb", "rooms/kitchen.glb", "rooms/hall.glb")


def provide(folder: Path, baked: Path, settings: bool = False) -> None:
    """Write the files into a folder.

    Args:
        folder: Folder in which snippets run.
        baked: Folder of a bake of the Cornell box.
        settings: Also write ``lightwell.toml``, which holds for every command in the folder.
    """
    shutil.copytree(baked, folder / "out")
    if settings:
        (folder / "lightwell.toml").write_text(SETTINGS)
    (folder / "rooms").mkdir()
    for name in SCENES:
        (folder / name).write_bytes(without_learned_light((baked / "scene.glb").read_bytes()))
    room = without_learned_light((baked / "scene.glb").read_bytes())
    (folder / "house.glb").write_bytes(with_clip(room, "Open gate"))
    for name in ("room.xml", "house.xml"):
        (folder / name).write_text(ROOM)
    # Readers of a checkout have these where they are.
    shutil.copytree(Path(__file__).parents[2] / "examples/lens", folder / "examples/lens")
    _frames(folder)


def without_learned_light(data: bytes) -> bytes:
    """Remove the extension of lightwell from a GLB: what is left is an ordinary scene.

    Args:
        data: The file.

    Returns:
        The file without the extension; the binary chunk stays.
    """
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + length])
    _drop(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    return head + text + rest


def with_clip(data: bytes, name: str) -> bytes:
    """Add a clip that lifts the first mesh of a GLB by 10 cm in two seconds.

    Args:
        data: The file.
        name: Name of the clip.

    Returns:
        The file with the clip.
    """
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), bytearray(data[28 + length :])
    node = next(k for k, entry in enumerate(document["nodes"]) if "mesh" in entry)
    keys = []
    for values, kind in ((np.float32([0, 2]), "SCALAR"), (np.float32([[0, 0, 0], [0, 0.1, 0]]), "VEC3")):
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
        view = len(document["bufferViews"]) - 1
        bounds = {"min": [0.0], "max": [2.0]} if kind == "SCALAR" else {}
        document["accessors"].append({"bufferView": view, "componentType": 5126, "count": 2, "type": kind, **bounds})
        keys.append(len(document["accessors"]) - 1)
        binary += values.tobytes()
    channels = [{"sampler": 0, "target": {"node": node, "path": "translation"}}]
    document["animations"] = [{"name": name, "samplers": [{"input": keys[0], "output": keys[1]}], "channels": channels}]
    document["buffers"] = [{"byteLength": len(binary)}]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = struct.pack("<II", len(binary), 0x004E4942) + bytes(binary)
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    return head + text + rest


def _drop(entry: object) -> None:
    if isinstance(entry, dict):
        entry.get("extensions", {}).pop("LIGHTWELL_neural_radiance", None)
        if "extensionsUsed" in entry:
            entry["extensionsUsed"] = [n for n in entry["extensionsUsed"] if not n.startswith("LIGHTWELL")]
    for value in entry.values() if isinstance(entry, dict) else entry if isinstance(entry, list) else ():
        _drop(value)


def _frames(folder: Path) -> None:
    """Write frames with depth and motion, as EXR and as PNG."""
    import OpenEXR
    from PIL import Image

    height, width = FRAME
    ramp = np.linspace(0, 1, width, dtype=np.float32) * np.ones((height, 1), np.float32)
    stripes = np.float32(np.arange(width) // 16 % 2) * ramp
    channels = {"R": stripes, "G": 0.5 * ramp, "B": 1 - ramp, "A": np.ones_like(ramp), "Z": 2 + ramp}
    for number in range(1, 4):
        shift = {name: np.roll(channels[name], number, 1) for name in "RGB"}
        moving = {"motion.X": np.ones_like(ramp), "motion.Y": np.zeros_like(ramp)}
        names = [folder / f"shot.{number:04}.exr"] + ([folder / "frame.exr"] if number == 1 else [])
        for name in names:
            OpenEXR.File({}, channels | shift | moving).write(str(name))
    Image.fromarray(np.uint8(255 * np.stack([stripes, ramp, 1 - ramp], -1))).save(folder / "frame.png")
    Image.fromarray(np.uint8(255 * ramp)).save(folder / "depth.png")
