"""Converts the mesh, light and camera records of a scene to glTF meshes and nodes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lightwell.asset.container import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Binary
from lightwell.core.quaternions import rotation_quaternion

if TYPE_CHECKING:
    from lightwell.scenes.scene import Camera, Light, Mesh

# Most vertices that 16-bit indices can address; 65535 itself restarts the primitive (glTF 2.0, section 3.7.2.1).
MAX_SHORT_VERTICES = 65535
# How far behind its front the back of a surface is written, in diagonals of its mesh.
BEHIND = 1e-4
# Near plane of written cameras, metres: closer than any surface that a viewer looks at.
NEAR_PLANE = 0.01
# Largest angle that a KHR_lights_punctual cone may have.
MAX_CONE = math.pi / 2
# The inner cone of a spot must be smaller than the outer one; by this much, radians.
CONE_GAP = 1e-4


def primitive(mesh: Mesh, material: int, uv_sets: set[int], binary: Binary) -> dict[str, Any]:
    """Write the geometry of a mesh as one glTF primitive.

    Args:
        mesh: Triangle mesh in world space.
        material: Index of its glTF material.
        uv_sets: Texture coordinate sets that the material reads; a set that the mesh lacks is written as zeros.
        binary: Receives the vertex attributes and the indices.

    Returns:
        The JSON of the primitive.
    """
    count = len(mesh.positions)
    attributes = {"POSITION": binary.add_accessor(_finite(mesh, "positions", 3), ARRAY_BUFFER, bounds=True)}
    if mesh.normals is not None:
        attributes["NORMAL"] = binary.add_accessor(_unit_rows(_finite(mesh, "normals", 3)), ARRAY_BUFFER)
    last = max([s for s, uv in enumerate((mesh.uv0, mesh.uv1)) if uv is not None] + sorted(uv_sets), default=-1)
    for uv_set in range(last + 1):
        name = f"uv{uv_set}"
        absent = getattr(mesh, name, None) is None
        uv = np.zeros((count, 2), np.float32) if absent else _finite(mesh, name, 2)
        attributes[f"TEXCOORD_{uv_set}"] = binary.add_accessor(uv, ARRAY_BUFFER)
    if mesh.colors is not None:
        attributes["COLOR_0"] = binary.add_accessor(np.clip(_finite(mesh, "colors", 4), 0, 1), ARRAY_BUFFER)
    indices = binary.add_accessor(compact_indices(mesh), ELEMENT_ARRAY_BUFFER)
    return {"attributes": attributes, "indices": indices, "material": material}


def back_of(mesh: Mesh) -> Mesh:
    """Make the other side of a mesh, for a surface whose sides differ.

    Args:
        mesh: Triangle mesh in world space.

    Returns:
        The mesh turned inside out, a little behind it: when the file is traced again, rays must meet one side first.
    """
    indices, places = np.asarray(mesh.indices), _finite(mesh, "positions", 3)
    if mesh.normals is None:
        a, b, c = (places[indices[:, k]] for k in range(3))
        outward = np.zeros_like(places)
        np.add.at(outward, indices.ravel(), np.cross(b - a, c - a).repeat(3, axis=0))
    else:
        outward = _finite(mesh, "normals", 3)
    behind = places - BEHIND * np.linalg.norm(np.ptp(places, axis=0)) * _unit_rows(outward)
    normals = None if mesh.normals is None else -mesh.normals
    return replace(mesh, positions=behind.astype(np.float32), indices=indices[:, ::-1], normals=normals)


def _finite(mesh: Mesh, name: str, width: int) -> np.ndarray:
    array = np.asarray(getattr(mesh, name), np.float32)
    if array.shape != (len(mesh.positions), width):
        raise ValueError(
            f"asset: mesh '{mesh.name}': {name} has shape {array.shape}, not {(len(mesh.positions), width)}"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"asset: mesh '{mesh.name}': {name} contains NaN or infinity; repair the scene's geometry")
    return array


def _unit_rows(normals: np.ndarray) -> np.ndarray:
    """[V, 3] unit vectors; a zero row becomes +Y."""
    length = np.linalg.norm(normals.astype(np.float64), axis=1, keepdims=True)
    up = np.array([0.0, 1.0, 0.0])
    return np.where(length > 0, normals / np.where(length > 0, length, 1), up).astype(np.float32)


def compact_indices(mesh: Mesh) -> np.ndarray:
    """Flatten the triangles of a mesh, in 16 bits where they can address every vertex.

    Args:
        mesh: The mesh.

    Returns:
        Indices [3 T], uint16 or uint32.

    Raises:
        ValueError: An index names no vertex.
    """
    indices = np.asarray(mesh.indices).reshape(-1)
    if len(indices) and indices.max() >= len(mesh.positions):
        raise ValueError(
            f"asset: mesh '{mesh.name}': index {indices.max()} is out of range; it has {len(mesh.positions)} vertices"
        )
    return indices.astype(np.uint16 if len(mesh.positions) <= MAX_SHORT_VERTICES else np.uint32)


def light_entry(light: Light) -> dict[str, Any]:
    """Convert a light to the JSON of KHR_lights_punctual.

    A colour component above 1 is moved into the intensity, because glTF colours end at 1.

    Args:
        light: Point, spot or directional light.

    Returns:
        The JSON of the light; angles in radians, intensity in the units of the extension.
    """
    peak = max(1.0, *light.color)
    entry: dict[str, Any] = {
        "type": light.kind,
        "color": [max(c, 0.0) / peak for c in light.color],
        "intensity": max(light.intensity, 0.0) * peak,
    }
    if light.name:
        entry["name"] = light.name
    if light.range is not None and light.range > 0 and light.kind != "directional":
        entry["range"] = light.range
    if light.kind == "spot":
        outer = min(max(light.outer_cone, CONE_GAP), MAX_CONE)
        inner = min(max(light.inner_cone, 0.0), outer - CONE_GAP)
        entry["spot"] = {"innerConeAngle": max(inner, 0.0), "outerConeAngle": outer}
    return entry


def light_node(light: Light, index: int) -> dict[str, Any]:
    """Convert the position and direction of a light to a glTF node.

    Args:
        light: Point, spot or directional light; glTF lights shine along -Z of their node.
        index: Index of the light in the KHR_lights_punctual table.

    Returns:
        The JSON of the node.
    """
    node: dict[str, Any] = {"extensions": {"KHR_lights_punctual": {"light": index}}}
    if light.name:
        node["name"] = light.name
    if light.kind != "directional":
        node["translation"] = [float(c) for c in light.position]
    if light.kind != "point":
        node["rotation"] = look_rotation(np.asarray(light.direction, float))
    return node


def camera_entry(camera: Camera) -> dict[str, Any]:
    """Convert a camera to the JSON of a perspective glTF camera without a far plane.

    The aspect ratio is left out: it is that of the viewer's window.

    Args:
        camera: Camera with its vertical field of view in degrees.

    Returns:
        The JSON of the camera.
    """
    entry = {"type": "perspective", "perspective": {"yfov": math.radians(camera.fov_y), "znear": NEAR_PLANE}}
    return {**entry, "name": camera.name} if camera.name else entry


def camera_node(camera: Camera, index: int) -> dict[str, Any]:
    """Convert the position and orientation of a camera to a glTF node.

    Args:
        camera: The camera; glTF cameras look along -Z of their node with +Y up.
        index: Index of the camera in the document's table.

    Returns:
        The JSON of the node.
    """
    direction = np.subtract(camera.target, camera.position, dtype=float)
    node: dict[str, Any] = {
        "camera": index,
        "translation": [float(c) for c in camera.position],
        "rotation": look_rotation(direction, np.asarray(camera.up, float)),
    }
    return {**node, "name": camera.name} if camera.name else node


def look_rotation(direction: np.ndarray, up: np.ndarray | None = None) -> list[float]:
    """Return the rotation that turns -Z to a direction and +Y as close to ``up`` as that allows.

    Args:
        direction: [3] vector of any length; zero gives -Z.
        up: [3] vector of any length; None for +Y.

    Returns:
        Unit quaternion (x, y, z, w).
    """
    length = np.linalg.norm(direction)
    z = -direction / length if length > 0 else np.array([0.0, 0.0, 1.0])
    x = np.cross(np.array([0.0, 1.0, 0.0]) if up is None else up, z)
    if np.linalg.norm(x) < 1e-6:  # The direction is parallel to ``up``: take any perpendicular axis.
        x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return rotation_quaternion(np.stack([x, np.cross(z, x), z], axis=1))
