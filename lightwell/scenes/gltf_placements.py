"""Placements of the meshes of a glTF file, by nodes and by EXT_mesh_gpu_instancing. K placements, V vertices.

The total size of all placements is computed here from the JSON alone, before any array is decoded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.scenes.gltf_accessors import Accessors
from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_geometry import ATTRIBUTES, FAN, MODES, STRIP, TRIANGLES, Primitive
from lightwell.scenes.gltf_json import Place
from lightwell.scenes.gltf_nodes import PlacedNode, rotations

INSTANCING = "EXT_mesh_gpu_instancing"
# With more placements than this, those of one mesh are joined: many shapes are slower than a few larger ones.
MOST_SEPARATE = 4096


@dataclass(frozen=True)
class Placement:
    """A mesh of the file and its world transforms."""

    node: PlacedNode
    """The first node that places it."""
    mesh: int
    matrices: np.ndarray
    """[K, 4, 4] float64, from the mesh's space to the world."""
    name: str
    joined: bool = False
    """Whether it holds the placements of several nodes."""

    @property
    def scale(self) -> float:
        """Mean scale of the first transform."""
        # Rounded, so that the placements of one size are of one scale.
        return float(f"{np.cbrt(abs(np.linalg.det(self.matrices[0, :3, :3]))):.6g}") if len(self.matrices) else 1.0


def placements(document: Document, accessors: Accessors, nodes: Sequence[PlacedNode]) -> list[Placement]:
    """List every placed mesh of the scene, in the order of the nodes, and charge their sizes to the budget.

    Args:
        document: The file.
        accessors: Its accessors.
        nodes: Nodes with their world transforms.

    Returns:
        The placements.
    """
    found = []
    demands: dict[int, tuple[int, int, int]] = {}
    budget, mesh_count = document.budget, document.count("meshes")
    for node in nodes:
        number = node.place.index("mesh", mesh_count, "mesh")
        if number is None:
            continue
        if number not in demands:
            demands[number] = _demand(document, number)
        primitives, vertices, indices = demands[number]
        extension = node.place.extension(INSTANCING)
        copies = 1 if extension is None else _instance_count(document, accessors, extension)
        budget.charge("instances", copies * primitives, node.place.what)
        budget.charge("vertices", copies * vertices, node.place.what)
        budget.charge("indices", copies * indices, node.place.what)
        found.append((node, number, extension))
    made = [Placement(n, mesh, _matrices(document, accessors, n, ext), n.name) for n, mesh, ext in found]
    return _joined(made) if len(made) > MOST_SEPARATE else made


def placed_copies(primitive: Primitive, matrices: np.ndarray) -> dict[str, Any]:
    """Transform a primitive by each of several matrices; the copies follow one another.

    A mirroring matrix reverses the winding.

    Args:
        primitive: Triangles to copy.
        matrices: [K, 4, 4] transforms.

    Returns:
        Positions, normals and indices of all copies by name.
    """
    linear = matrices[:, :3, :3]
    positions = np.einsum("kij,vj->kvi", linear, primitive.positions.astype(np.float64)) + matrices[:, None, :3, 3]
    mirrored = np.linalg.det(linear) < 0
    normals = None
    if primitive.normals is not None:
        # The cofactor matrix transforms normals, and exists even when the matrix is singular.
        cofactor = np.stack([np.cross(linear[:, i], linear[:, j]) for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)
        turned = np.where(mirrored[:, None, None], -cofactor, cofactor)
        normals = np.einsum("kij,vj->kvi", turned, primitive.normals.astype(np.float64)).reshape(-1, 3)
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        normals = (normals / np.where(length > 0, length, 1)).astype(np.float32)
    first = np.arange(len(matrices), dtype=np.uint32)[:, None, None] * np.uint32(len(primitive.positions))
    corners = np.where(mirrored[:, None, None], primitive.indices[:, [0, 2, 1]], primitive.indices) + first
    return {
        "positions": positions.reshape(-1, 3).astype(np.float32),
        "normals": normals,
        "indices": corners.reshape(-1, 3).astype(np.uint32),
    }


def _demand(document: Document, mesh: int) -> tuple[int, int, int]:
    """Count primitives, vertices and indices of a mesh from its JSON."""
    place = document.item("meshes", mesh)
    count = vertices = indices = 0
    for i, value in enumerate(place.items("primitives")):
        primitive = Place(place.scene, f"mesh {mesh} primitive {i}", value)
        mode = primitive.integer("mode", TRIANGLES)
        if mode in MODES:
            continue
        own, corners = _primitive_demand(document, primitive)
        if mode in (STRIP, FAN):
            corners = 3 * max(corners - 2, 0)
        count, vertices, indices = count + 1, vertices + own, indices + corners
    return count, vertices, indices


def _primitive_demand(document: Document, primitive: Place) -> tuple[int, int]:
    """Count vertices and indices of a primitive from its JSON."""
    attributes = primitive.need("attributes")
    numbers = [attributes.index(name, document.count("accessors"), "accessor") for name in ATTRIBUTES]
    counts = [document.item("accessors", n).integer("count", low=1) for n in numbers if n is not None]
    vertices = max(counts, default=0)
    number = primitive.index("indices", document.count("accessors"), "accessor")
    return vertices, vertices if number is None else document.item("accessors", number).integer("count", low=1)


def _instance_count(document: Document, accessors: Accessors, extension: Place) -> int:
    attributes = extension.need("attributes")
    numbers = [attributes.index(name, document.count("accessors"), "accessor") for name in attributes.value]
    counts = {accessors.count(number) for number in numbers if number is not None}
    if len(counts) != 1:
        extension.fail(f"has attributes of {len(counts)} different lengths, expected one")
    return counts.pop()


def _matrices(document: Document, accessors: Accessors, node: PlacedNode, extension: Place | None) -> np.ndarray:
    """Compute the world matrices [K, 4, 4] of a node's mesh."""
    if extension is None:
        return node.matrix[None]
    count, attributes = _instance_count(document, accessors, extension), extension.need("attributes")
    parts = {}
    for name, width, default in (("TRANSLATION", 3, 0.0), ("ROTATION", 4, 0.0), ("SCALE", 3, 1.0)):
        number = attributes.index(name, document.count("accessors"), "accessor")
        values = np.full((count, width), default) if number is None else accessors.floats(number).astype(np.float64)
        if values.shape[1] != width or not np.isfinite(values).all():
            extension.fail(f"has {name} that are not {width} finite numbers each", "export it again")
        parts[name] = values
    local = np.zeros((count, 4, 4))
    local[:, :3, :3] = rotations(parts["ROTATION"]) * parts["SCALE"][:, None, :]
    local[:, :3, 3], local[:, 3, 3] = parts["TRANSLATION"], 1
    return node.matrix @ local


def _joined(made: Sequence[Placement]) -> list[Placement]:
    """Join the placements of each mesh to one; those of skinned meshes are kept, because joints place them, and those
    with morph weights of their own."""
    groups: dict[tuple[str, int], list[Placement]] = {}
    for i, placement in enumerate(made):
        own = "skin" in placement.node.place or "weights" in placement.node.place
        key = ("node", i) if own else ("mesh", placement.mesh)
        groups.setdefault(key, []).append(placement)
    joined = []
    for group in groups.values():
        first, rest = group[0], len(group) - 1
        matrices = np.concatenate([p.matrices for p in group]) if rest else first.matrices
        name = f"{first.name} and {rest} more" if rest else first.name
        joined.append(Placement(first.node, first.mesh, matrices, name, joined=rest > 0))
    return joined
