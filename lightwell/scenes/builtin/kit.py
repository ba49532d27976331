"""Parts shared by the builders: materials by name, parts collected into meshes, and the finished, hashed scene."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from ..assemble import assemble
from ..scene import Camera, Material, Mesh, Scene, SceneNode
from .shapes import MeshPart, merge


class Kit:
    """Collects materials and parts; ``scene()`` makes the records of them.

    A mesh is all parts added under one object name with one material.
    """

    def __init__(self, name: str, version: int) -> None:
        """Start a scene.

        Args:
            name: Name of the scene.
            version: Part of the scene's hash; raise it when the scene changes.
        """
        self.name = name
        self.version = version
        self._materials: dict[str, tuple[Material, float]] = {}
        self._parts: dict[tuple[str, str], list[MeshPart]] = {}
        self._pivots: dict[str, tuple[float, float, float]] = {}

    def material(self, material: Material, tile: float = 1.0) -> str:
        """Register a material.

        Args:
            material: Material with a unique name.
            tile: Metres after which its textures repeat.

        Returns:
            Its name.
        """
        self._materials[material.name] = (material, tile)
        return material.name

    def add(self, object_name: str, material: str, *parts: MeshPart) -> None:
        """Add parts to a mesh.

        Args:
            object_name: Name of the object.
            material: Name of its material.
            *parts: Triangles to add.

        Raises:
            ValueError: The material is not registered.
        """
        if material not in self._materials:
            raise ValueError(f"builtin: '{object_name}' wants the unknown material '{material}'; register it first")
        self._parts.setdefault((object_name, material), []).extend(parts)

    def pivot(self, object_name: str, place: tuple[float, float, float]) -> None:
        """Set the origin of an object's node, about which it turns; without one it is the scene's origin.

        Args:
            object_name: Name of the object.
            place: Position in metres.
        """
        self._pivots[object_name] = place

    def scene(self, cameras: Sequence[Camera]) -> Scene:
        """Assemble the finished scene.

        Args:
            cameras: Cameras of the scene.

        Returns:
            The scene with its Mitsuba scene.
        """
        used = [name for name in self._materials if any(m == name for _, m in self._parts)]
        meshes = [self._mesh(obj, mat, used.index(mat)) for obj, mat in self._parts]
        materials = [self._materials[name][0] for name in used]
        digest = content_digest(f"{self.name} {self.version}", meshes, materials)
        source = f"builtin:{self.name}"
        nodes = self._nodes()
        return assemble(self.name, meshes, materials, cameras=list(cameras), source=source, digest=digest, nodes=nodes)

    def _nodes(self) -> list[SceneNode]:
        """One node per object, with the meshes of all its materials."""
        meshes: dict[str, list[int]] = {}
        for index, (name, _) in enumerate(self._parts):
            meshes.setdefault(name, []).append(index)
        nodes = []
        for name, indices in meshes.items():
            matrix = np.eye(4)
            matrix[:3, 3] = self._pivots.get(name, (0.0, 0.0, 0.0))
            nodes.append(SceneNode(name, -1, matrix, tuple(indices)))
        return nodes

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


def content_digest(label: str, meshes: Sequence[Mesh], materials: Sequence[Material]) -> str:
    """Compute the hash of everything that changes the transport.

    Args:
        label: Name and options of the scene.
        meshes: Its meshes.
        materials: Its materials.

    Returns:
        SHA-256 as hexadecimal digits.
    """
    state = hashlib.sha256(label.encode())
    for material in materials:
        # The representation of the records includes the encoded images.
        state.update(repr(material).encode())
    for mesh in meshes:
        state.update(f"{mesh.name} {mesh.material}".encode())
        for array in (mesh.positions, mesh.indices, mesh.normals, mesh.uv0):
            state.update(np.ascontiguousarray(array).tobytes())
    return state.hexdigest()
