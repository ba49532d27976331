"""Small GLB files for the tests of the loader."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage

COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}

# A square in z = 0 that faces +Z; the top row of a texture is at +Y.
SQUARE = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
SQUARE_UV = np.float32([[0, 1], [1, 1], [1, 0], [0, 0]])
SQUARE_INDICES = np.uint16([0, 1, 2, 0, 2, 3])


class Builder:
    """Collects JSON and bytes of one file."""

    def __init__(self):
        self.data = bytearray()
        self.json: dict = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], "meshes": [], "nodes": []}

    def view(self, data: bytes, **more) -> int:
        """Index of a buffer view that holds ``data``."""
        self.data += b"\0" * (-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values, **more) -> int:
        """Index of an accessor for [count] or [count, width] values."""
        values = np.ascontiguousarray(values)
        width = 1 if values.ndim == 1 else values.shape[1]
        entry = {"componentType": COMPONENTS[values.dtype.str[1:]], "count": len(values), "type": TYPES[width]}
        self.json["accessors"].append({"bufferView": self.view(values.tobytes()), **entry, **more})
        return len(self.json["accessors"]) - 1

    def add(self, key: str, entry: dict) -> int:
        """Index of a new entry in a top-level list."""
        self.json.setdefault(key, []).append(entry)
        return len(self.json[key]) - 1

    def mesh(self, positions=SQUARE, indices=SQUARE_INDICES, *, uv=None, normals=None, node=True, **primitive) -> int:
        """A mesh of one primitive and, unless told otherwise, a node that shows it."""
        attributes = {"POSITION": self.accessor(np.float32(positions))}
        if uv is not None:
            attributes["TEXCOORD_0"] = self.accessor(np.float32(uv))
        if normals is not None:
            attributes["NORMAL"] = self.accessor(np.float32(normals))
        attributes.update(primitive.pop("attributes", {}))
        entry = {"attributes": attributes, **primitive}
        if indices is not None:
            entry["indices"] = self.accessor(indices)
        number = self.add("meshes", {"primitives": [entry]})
        if node:
            self.add("nodes", {"mesh": number})
        return number

    def texture(self, pixels: np.ndarray, format_: str = "PNG", **sampler) -> dict:
        """A texture reference to a picture of uint8 pixels."""
        out = io.BytesIO()
        PillowImage.fromarray(np.ascontiguousarray(pixels, np.uint8)).save(
            out, format_, **({"lossless": True} if format_ == "WEBP" else {})
        )
        view = self.view(out.getvalue())
        image = self.add("images", {"bufferView": view, "mimeType": f"image/{format_.lower()}"})
        texture = {"sampler": self.add("samplers", sampler)}
        if format_ == "WEBP":
            texture["extensions"] = {"EXT_texture_webp": {"source": image}}
        else:
            texture["source"] = image
        return {"index": self.add("textures", texture)}

    def bytes(self) -> bytes:
        """The GLB file."""
        self.json["buffers"] = [{"byteLength": len(self.data)}] if self.data else []
        if "scenes" not in self.json:
            children = {c for n in self.json["nodes"] for c in n.get("children", ())}
            roots = [i for i in range(len(self.json["nodes"])) if i not in children]
            self.json["scenes"], self.json["scene"] = [{"nodes": roots}], 0
        return glb(self.json, bytes(self.data))

    def save(self, folder: Path, name: str = "room.glb") -> Path:
        """Write the file and return its path."""
        path = Path(folder) / name
        path.write_bytes(self.bytes())
        return path


def glb(document: dict, binary: bytes) -> bytes:
    """A GLB file of JSON and binary."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks
