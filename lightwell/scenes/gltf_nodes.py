"""The node tree of a glTF file: world transforms of meshes, cameras and lights."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_json import Place

# Hides a node and all below it.
VISIBILITY = "KHR_node_visibility"
TRANSFORMS = ("matrix", "translation", "rotation", "scale")
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class PlacedNode:
    """A node and its world transform."""

    index: int
    place: Place
    name: str
    matrix: np.ndarray
    """[4, 4] float64, from the node's space to the world."""
    parent: int = -1
    """Index of the parent in the file; -1 for a root."""


def placed_nodes(
    document: Document, unit: float = 1.0, poses: Mapping[int, dict[str, Any]] | None = None
) -> Iterator[PlacedNode]:
    """Iterate over the nodes of the default scene that are not hidden, parents first.

    Args:
        document: The file.
        unit: Metres per unit of the file, > 0.
        poses: Transforms, by node index, that replace a node's own.

    Yields:
        Nodes with their world transforms.
    """
    count = document.count("nodes")
    document.budget.charge("nodes", count)
    root = np.diag([unit, unit, unit, 1.0])
    waiting = [(index, root, 1, -1) for index in reversed(_roots(document))]
    seen: set[int] = set()
    while waiting:
        index, parent, depth, above = waiting.pop()
        place = document.item("nodes", index)
        if index in seen:
            place.fail("is reached twice; nodes must form a tree")
        seen.add(index)
        document.budget.check("depth", depth, place.what)
        if _is_hidden(place):
            continue
        if poses and index in poses:
            place.value = place.value | poses[index]
        matrix = _world_matrix(place, parent)
        yield PlacedNode(index, place, place.text("name", "") or place.what, matrix, above)
        waiting += [(child, matrix, depth + 1, index) for child in reversed(place.indices("children", count, "node"))]


def _is_hidden(place: Place) -> bool:
    shown = place.extension(VISIBILITY) if "extensions" in place else None
    return shown is not None and "visible" in shown and not shown.flag("visible")


def _world_matrix(place: Place, parent: np.ndarray) -> np.ndarray:
    """Compute the world matrix [4, 4] of a node from that of its parent; without a transform it is the parent's."""
    if place.value.keys().isdisjoint(TRANSFORMS):
        return parent
    matrix = parent @ local_matrix(place)
    # The sum is finite exactly when all numbers are, except on overflow, which is refused too.
    if not math.isfinite(matrix.sum()):
        place.fail("has a transform that is not finite")
    return matrix


def _roots(document: Document) -> list[int]:
    count = document.count("nodes")
    scene = document.root.index("scene", document.count("scenes"), "scene")
    if scene is None and document.count("scenes") == 0:
        children = {c for i in range(count) for c in document.item("nodes", i).indices("children", count, "node")}
        roots = [i for i in range(count) if i not in children]
        if count and not roots:
            document.fail("its nodes form a cycle")
        return roots
    return document.item("scenes", scene or 0).indices("nodes", count, "node")


def local_matrix(place: Place) -> np.ndarray:
    """Compute the transform of a node to its parent.

    Args:
        place: Node object.

    Returns:
        [4, 4] float64.
    """
    if "matrix" in place:
        return np.array(place.numbers("matrix", 16)).reshape(4, 4).T
    sx, sy, sz = place.numbers("scale", 3, (1.0, 1.0, 1.0))
    tx, ty, tz = place.numbers("translation", 3, (0.0, 0.0, 0.0))
    rows = rotation(place.numbers("rotation", 4)) if "rotation" in place else IDENTITY
    (a, b, c), (d, e, f), (g, h, i) = rows
    return np.array(
        [
            [a * sx, b * sy, c * sz, tx],
            [d * sx, e * sy, f * sz, ty],
            [g * sx, h * sy, i * sz, tz],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def rotations(quaternions: np.ndarray) -> np.ndarray:
    """Convert quaternions to rotation matrices.

    Args:
        quaternions: [K, 4] x, y, z, w of any length.

    Returns:
        [K, 3, 3]; the identity for a quaternion of length 0.
    """
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    x, y, z, w = np.where(length > 0, quaternions / np.where(length > 0, length, 1), [0.0, 0.0, 0.0, 1.0]).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def rotation(quaternion: tuple[float, ...]) -> tuple[tuple[float, float, float], ...]:
    """Convert one quaternion to a rotation matrix.

    Args:
        quaternion: x, y, z, w of any length.

    Returns:
        3 rows of 3 numbers; the identity for a quaternion of length 0.
    """
    length = math.hypot(*quaternion)
    if not 0 < length < math.inf:
        return IDENTITY
    x, y, z, w = (v / length for v in quaternion)
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
