"""Nodes of a glTF file whose scale at rest is 0: they get the transform of their first animation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from lightwell.scenes.gltf_accessors import Accessors
from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_json import Place

# Components of a channel's values by the property that it animates.
PATHS = {"translation": 3, "rotation": 4, "scale": 3}
# Nodes with a smaller scale are invisible ...
SMALLEST_SCALE = 1e-4
# ... but for positions stored as whole numbers (KHR_mesh_quantization), whose scale is that of one step.
SMALLEST_STEP = 1e-9
FLOAT = 5126
# Largest number of nodes that a warning names.
MOST_NAMED = 5


def poses_for_flat_nodes(
    document: Document, accessors: Accessors, warn: Callable[[str], None]
) -> dict[int, dict[str, list[float]]]:
    """Find transforms for nodes whose scale at rest is 0.

    A pose is that of the first animation of the node's scale, at its first key with a scale above 0; a node that no
    animation scales stays flat.

    Args:
        document: The file.
        accessors: Its accessors.
        warn: Called with the nodes that were found.

    Returns:
        Transforms by node index, to be used instead of the nodes' own.
    """
    flat = [i for i in range(document.count("nodes")) if _is_flat(document, document.item("nodes", i))]
    if not flat:
        return {}
    wanted: set[int] = set(flat)
    poses: dict[int, dict[str, Any]] = {}
    for i in range(document.count("animations")):
        animation, of_node = document.item("animations", i), dict[int, dict[str, int]]()
        for node, path, sampler in animated_channels(document, animation):
            if path in PATHS and node in wanted and node not in poses:
                of_node.setdefault(node, {})[path] = sampler
        for node, samplers in of_node.items():
            pose = _pose(document, accessors, animation, samplers) if "scale" in samplers else None
            if pose is not None:
                poses[node] = pose
    for group, what in (
        (sorted(poses), "stand as their first animation shows them"),
        (sorted(wanted - poses.keys()), ""),
    ):
        if group:
            names = [document.item("nodes", n).text("name", "") or f"node {n}" for n in group[:MOST_NAMED]]
            more = f" and {len(group) - MOST_NAMED} more" if len(group) > MOST_NAMED else ""
            warn(f"nodes {', '.join(names)}{more}: have scale 0 at rest; they {what or 'are not shown'}")
    return poses


def _is_flat(document: Document, node: Place) -> bool:
    scale = min(map(abs, node.numbers("scale", 3))) if "scale" in node else 1.0
    return scale < SMALLEST_SCALE and (scale < SMALLEST_STEP or not _whole_positions(document, node))


def _whole_positions(document: Document, node: Place) -> bool:
    """Test whether a node's mesh stores whole numbers as positions."""
    number = node.index("mesh", document.count("meshes"), "mesh")
    primitives = [] if number is None else document.item("meshes", number).items("primitives")
    for i, value in enumerate(primitives[:1]):
        attributes = Place(node.scene, f"mesh {number} primitive {i}", value).need("attributes")
        position = attributes.index("POSITION", document.count("accessors"), "accessor")
        return position is not None and document.item("accessors", position).integer("componentType") != FLOAT
    return False


def animated_channels(document: Document, animation: Place) -> list[tuple[int, str, int]]:
    """List the channels that animate a node.

    Args:
        document: The file.
        animation: One of its animations.

    Returns:
        (node, path, sampler) of each.
    """
    found = []
    samplers = len(animation.items("samplers"))
    for i, value in enumerate(animation.items("channels")):
        channel = Place(animation.scene, f"{animation.what} channel {i}", value)
        target, sampler = channel.need("target"), channel.index("sampler", samplers, "sampler")
        node = target.index("node", document.count("nodes"), "node")
        if node is not None and sampler is not None:
            found.append((node, target.text("path"), sampler))
    return found


def _pose(
    document: Document, accessors: Accessors, animation: Place, samplers: dict[str, int]
) -> dict[str, list[float]] | None:
    """Read a node's animated properties (path → sampler) at the first key with a scale above 0, or None."""
    tracks = {path: _track(document, accessors, animation, sampler, PATHS[path]) for path, sampler in samplers.items()}
    times, scales = tracks["scale"]
    shown = np.flatnonzero(np.abs(scales).min(axis=1) >= SMALLEST_SCALE)
    if not len(shown):
        return None
    time = times[shown[0]]
    return {
        path: values[min(int(np.searchsorted(moments, time)), len(values) - 1)].tolist()
        for path, (moments, values) in tracks.items()
    }


def _track(
    document: Document, accessors: Accessors, animation: Place, sampler: int, width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Read times [K] and values [K, width] of a sampler; of cubic splines the values without their tangents."""
    place = Place(animation.scene, f"{animation.what} sampler {sampler}", animation.items("samplers")[sampler])
    count = document.count("accessors")
    first, second = (place.index(key, count, "accessor") for key in ("input", "output"))
    if first is None or second is None:
        place.fail("has no input or output")
    times, values = accessors.floats(first), accessors.floats(second)
    if place.text("interpolation", "LINEAR") == "CUBICSPLINE":
        values = values[1::3]
    if times.shape[1] != 1 or values.shape != (len(times), width) or not np.isfinite(values).all():
        place.fail(f"has values of shape {list(values.shape)} for {len(times)} times, expected finite numbers")
    return times[:, 0], values
