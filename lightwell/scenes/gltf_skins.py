"""Skinned meshes of a glTF file at rest. V vertices, J joints.

The joints determine the position of a skinned mesh; the transform of its own node is ignored (glTF 2.0, 3.7.3.3).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.scenes.gltf_accessors import Accessors
from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_geometry import Primitive


def joint_matrices(
    document: Document, accessors: Accessors, skin: int, worlds: dict[int, np.ndarray]
) -> np.ndarray | None:
    """Compute the transforms of the joints of a skin, from the mesh's space to the world.

    Args:
        document: The file.
        accessors: Its accessors.
        skin: Number of the skin.
        worlds: [4, 4] world matrix of each node in the scene, by index.

    Returns:
        [J, 4, 4], or None when a joint is not part of the scene.
    """
    place = document.item("skins", skin)
    joints = place.indices("joints", document.count("nodes"), "node")
    if not joints:
        place.fail("has no joints")
    if any(joint not in worlds for joint in joints):
        return None
    inverse_bind = np.tile(np.eye(4), (len(joints), 1, 1))
    number = place.index("inverseBindMatrices", document.count("accessors"), "accessor")
    if number is not None:
        values = accessors.floats(number)
        if values.shape[1] != 16 or len(values) < len(joints) or not np.isfinite(values).all():
            place.fail(f"has inverseBindMatrices of shape {list(values.shape)}, expected [{len(joints)}, 16], finite")
        inverse_bind = values[: len(joints)].astype(np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
    return np.stack([worlds[joint] for joint in joints]) @ inverse_bind


def skinned(document: Document, primitive: Primitive, matrices: np.ndarray) -> dict[str, Any]:
    """Transform a primitive by the joints of its skin.

    Args:
        document: The file, for messages.
        primitive: Triangles with joints and weights.
        matrices: [J, 4, 4] transforms of the joints.

    Returns:
        World-space positions, normals and indices by name.
    """
    if primitive.joints is None or primitive.weights is None:
        document.fail("a mesh with a skin has no joints or weights")
    joints = primitive.joints.astype(np.int64)
    if joints.min() < 0 or joints.max() >= len(matrices):
        document.fail(f"a vertex names joint {int(joints.max())}, but its skin has {len(matrices)}")
    weights = primitive.weights / np.maximum(primitive.weights.sum(axis=1, keepdims=True), 1e-6)
    # Without a weight the first joint holds the vertex; it would fall into the origin.
    weights[primitive.weights.max(axis=1) <= 0] = np.eye(1, weights.shape[1])
    blended = np.einsum("vk,vkij->vij", weights, matrices[joints])
    linear = blended[:, :3, :3]
    positions = np.einsum("vij,vj->vi", linear, primitive.positions) + blended[:, :3, 3]
    mirrored = np.linalg.det(linear).sum() < 0
    normals = None
    if primitive.normals is not None:
        rows = [np.cross(linear[:, i], linear[:, j]) for i, j in ((1, 2), (2, 0), (0, 1))]
        normals = np.einsum("vij,vj->vi", np.stack(rows, axis=1), primitive.normals) * (-1 if mirrored else 1)
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        normals = (normals / np.where(length > 0, length, 1)).astype(np.float32)
    indices = primitive.indices[:, [0, 2, 1]] if mirrored else primitive.indices
    return {"positions": positions.astype(np.float32), "normals": normals, "indices": indices}
