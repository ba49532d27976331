"""Writes the GLB that a scene of another format is converted to, for the checked glTF reader."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

FLOAT, UINT = 5126, 5125
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
# Wrap modes of glTF samplers.
REPEAT, CLAMP, MIRROR = 10497, 33071, 33648


class GlbWriter:
    """Collects meshes, materials, lights and cameras; ``encoded`` returns the file."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._document: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0}
        self._images: dict[tuple[bytes, tuple[int, int]], int] = {}

    def _append(self, table: str, entry: Mapping[str, Any]) -> int:
        entries = self._document.setdefault(table, [])
        entries.append(dict(entry))
        return len(entries) - 1

    def _view(self, data: bytes) -> int:
        self._data += b"\0" * (-len(self._data) % 4)
        start = len(self._data)
        self._data += data
        return self._append("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data)})

    def _accessor(self, values: np.ndarray, component: int) -> int:
        array = np.ascontiguousarray(values, "<f4" if component == FLOAT else "<u4")
        width = 1 if array.ndim == 1 else array.shape[1]
        entry: dict[str, Any] = {
            "bufferView": self._view(array.tobytes()),
            "componentType": component,
            "count": len(array),
            "type": TYPES[width],
        }
        if width == 3 and len(array):
            entry |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        return self._append("accessors", entry)

    def texture(
        self,
        data: bytes,
        mime: str,
        wrap: tuple[int, int] = (REPEAT, REPEAT),
        transform: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Add a picture.

        Args:
            data: Bytes of a PNG, JPEG or WebP file.
            mime: Its media type.
            wrap: Wrap modes in u and v.
            transform: A KHR_texture_transform of its coordinates.

        Returns:
            A glTF texture reference; the same bytes are stored once for each way to repeat them.
        """
        if (data, wrap) not in self._images:
            image = self._append("images", {"bufferView": self._view(data), "mimeType": mime})
            sampler = self._append("samplers", {"wrapS": wrap[0], "wrapT": wrap[1]})
            self._images[data, wrap] = self._append("textures", {"source": image, "sampler": sampler})
        reference: dict[str, Any] = {"index": self._images[data, wrap]}
        if transform is not None:
            self._use("KHR_texture_transform")
            reference["extensions"] = {"KHR_texture_transform": dict(transform)}
        return reference

    def material(self, entry: Mapping[str, Any]) -> int:
        """Add a material.

        Args:
            entry: A glTF material.

        Returns:
            Its index.
        """
        for name in entry.get("extensions", {}):
            self._use(name)
        return self._append("materials", entry)

    def mesh(
        self,
        name: str,
        attributes: Mapping[str, np.ndarray],
        indices: np.ndarray,
        material: int | None,
        places: Sequence[np.ndarray] | None = None,
    ) -> None:
        """Add a mesh.

        Args:
            name: Its name.
            attributes: glTF attribute to [V, 2 … 4] numbers.
            indices: [T, 3] vertices of the triangles.
            material: Index of its material, or None.
            places: [4, 4] world matrix of each of its instances; None: it is in world space.
        """
        primitive: dict[str, Any] = {
            "attributes": {key: self._accessor(values, FLOAT) for key, values in attributes.items()},
            "indices": self._accessor(np.asarray(indices).reshape(-1), UINT),
        }
        if material is not None:
            primitive["material"] = material
        number = self._append("meshes", {"name": name, "primitives": [primitive]})
        if places is None:
            self.node({"name": name, "mesh": number})
        for matrix in places or ():
            self.node({"name": name, "mesh": number, "matrix": _columns(matrix)})

    def light(self, entry: Mapping[str, Any], matrix: np.ndarray) -> None:
        """Add a punctual light.

        Args:
            entry: A light of KHR_lights_punctual.
            matrix: [4, 4] world matrix; the light shines along its −z.
        """
        self._use("KHR_lights_punctual")
        lights = self._document.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append(dict(entry))
        reference = {"KHR_lights_punctual": {"light": len(lights) - 1}}
        self.node({"name": entry.get("name", ""), "matrix": _columns(matrix), "extensions": reference})

    def camera(self, name: str, fov_y: float, matrix: np.ndarray) -> None:
        """Add a perspective camera.

        Args:
            name: Its name.
            fov_y: Vertical field of view, radians.
            matrix: [4, 4] world matrix; the camera looks along its −z.
        """
        camera = self._append("cameras", {"type": "perspective", "perspective": {"yfov": fov_y, "znear": 0.01}})
        self.node({"name": name, "camera": camera, "matrix": _columns(matrix)})

    def node(self, entry: Mapping[str, Any]) -> None:
        """Add a node at the root.

        Args:
            entry: A glTF node.
        """
        self._append("nodes", entry)

    def _use(self, extension: str) -> None:
        used = self._document.setdefault("extensionsUsed", [])
        if extension not in used:
            used.append(extension)

    def encoded(self) -> bytes:
        """Return the file.

        Returns:
            Bytes of a GLB.
        """
        self._document["scenes"] = [{"nodes": list(range(len(self._document.get("nodes", []))))}]
        self._document["buffers"] = [{"byteLength": len(self._data)}]
        text = json.dumps(self._document).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self._data) + b"\0" * (-len(self._data) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _columns(matrix: np.ndarray) -> list[float]:
    """A [4, 4] matrix of column vectors as glTF stores it."""
    return np.asarray(matrix, float).T.reshape(-1).tolist()
