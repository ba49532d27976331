"""What the builders share: materials by name, parts gathered into meshes, and the finished, hashed scene."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from ..assemble import assemble
from ..scene import Camera, Material, Mesh, Scene
from .shapes import Part, merge


class Kit:
    """Collects materials and parts; ``scene()`` makes the records out of them.

    A mesh is all parts added under one object name with one material.
    """

    def __init__(self, name: str, version: int) -> None:
        self.name = name
        self.version = version
        self._materials: dict[str, tuple[Material, float]] = {}
        self._parts: dict[tuple[str, str], list[Part]] = {}

    def material(self, material: Material, tile: float = 1.0) -> str:
        """Register a material whose textures repeat every ``tile`` metres; returns its name."""
        self._materials[material.name] = (material, tile)
        return material.name

    def add(self, object_name: str, material: str, *parts: Part) -> None:
        """Add parts to the mesh ``object_name`` of ``material``."""
        if material not in self._materials:
            raise ValueError(f"builtin: '{object_name}' wants the unknown material '{material}'; register it first")
        self._parts.setdefault((object_name, material), []).extend(parts)

    def scene(self, cameras: Sequence[Camera]) -> Scene:
        """The finished scene with its Mitsuba twin."""
        used = [name for name in self._materials if any(m == name for _, m in self._parts)]
        meshes = [self._mesh(obj, mat, used.index(mat)) for obj, mat in self._parts]
        materials = [self._materials[name][0] for name in used]
        digest = _digest(f"{self.name} {self.version}", meshes, materials)
        source = f"builtin:{self.name}"
        return assemble(self.name, meshes, materials, cameras=list(cameras), source=source, digest=digest)

    def _mesh(self, object_name: str, material: str, index: int) -> Mesh:
        part = merge(self._parts[object_name, material])
        count = sum(obj == object_name for obj, _ in self._parts)
        return Mesh(
            name=object_name if count == 1 else f"{object_name}.{material}",
            positions=part.positions.astype(np.float32),
            indices=part.indices.astype(np.uint32),
            material=index,
            normals=part.normals.astype(np.float32),
            uv0=(part.uv / self._materials[material][1]).astype(np.float32),
        )


def _digest(label: str, meshes: Sequence[Mesh], materials: Sequence[Material]) -> str:
    """Hash of everything that changes the transport."""
    state = hashlib.sha256(label.encode())
    for material in materials:
        # The records' text holds the encoded pictures too.
        state.update(repr(material).encode())
    for mesh in meshes:
        state.update(f"{mesh.name} {mesh.material}".encode())
        for array in (mesh.positions, mesh.indices, mesh.normals, mesh.uv0):
            state.update(np.ascontiguousarray(array).tobytes())
    return state.hexdigest()
