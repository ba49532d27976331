"""The node tree of a glTF file: where each mesh, camera and light stands in the world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_json import Place


@dataclass(frozen=True)
class PlacedNode:
    """A node and its place in the world."""

    index: int
    place: Place
    name: str
    matrix: np.ndarray
    """[4, 4] float64, from the node's space to the world."""


def placed_nodes(document: Document) -> Iterator[PlacedNode]:
    """Every node of the default scene, parents first."""
    waiting = [(index, np.eye(4)) for index in reversed(_roots(document))]
    seen: set[int] = set()
    count = document.count("nodes")
    while waiting:
        index, parent = waiting.pop()
        place = document.item("nodes", index)
        place.what = f"node {index}"
        if index in seen:
            place.fail("is reached twice; nodes must form a tree")
        seen.add(index)
        with np.errstate(all="ignore"):
            matrix = parent @ local_matrix(place)
        if not np.isfinite(matrix).all():
            place.fail("has a transform that is not finite")
        yield PlacedNode(index, place, place.text("name", "") or f"node {index}", matrix)
        waiting += [(child, matrix) for child in reversed(place.indices("children", count, "node"))]


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
    """[4, 4] transform of a node to its parent."""
    if "matrix" in place:
        return np.array(place.numbers("matrix", 16)).reshape(4, 4).T
    result = np.eye(4)
    scale = np.array(place.numbers("scale", 3, (1.0, 1.0, 1.0)))
    result[:3, :3] = rotation(place.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0))) * scale
    result[:3, 3] = place.numbers("translation", 3, (0.0, 0.0, 0.0))
    return result


def rotation(quaternion: tuple[float, ...]) -> np.ndarray:
    """[3, 3] of a quaternion x, y, z, w of any length but 0."""
    length = float(np.linalg.norm(quaternion))
    if not 0 < length < np.inf:
        return np.eye(3)
    x, y, z, w = np.array(quaternion) / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
