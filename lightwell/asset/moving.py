"""What moves in an asset: a parent of all that a mover carries, which turns, slides, or follows a clip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lightwell.scenes.clip_mover import ClipMover, ClipPart
from lightwell.scenes.movers import NodeMover, RigidPart

if TYPE_CHECKING:
    from lightwell.asset.container import Binary
    from lightwell.scenes.scene import Scene

# Keys of a clip that differ less from the first one are constant.
CONSTANT = 1e-7


def moving_nodes(scene: Scene, part: RigidPart) -> set[int]:
    """List the nodes of an asset that belong to a part that moves.

    Args:
        scene: The scene; its meshes are the first nodes of the asset, its lights the next.
        part: The part.

    Returns:
        Indices of nodes.
    """
    shown = [k for k, mesh in enumerate(scene.meshes) if len(mesh.indices)]
    meshes = {number for number, k in enumerate(shown) if k in part.meshes}
    return meshes | {len(shown) + light for light in part.lights}


def add_movers(document: dict[str, Any], scene: Scene, pose: Sequence[float], binary: Binary) -> list[dict[str, Any]]:
    """Add the nodes and clips that move. At rest they change nothing: geometry stays in world space.

    Args:
        document: glTF JSON with the nodes of meshes and lights.
        scene: Scene with M movers.
        pose: M sliders that a page shows first, 0 to 1.
        binary: Receives the keys of clips.

    Returns:
        JSON objects of the variables, a mover each.
    """
    variables = []
    for mover, first in zip(scene.movers, pose):
        if isinstance(mover, ClipMover):
            variables.append(mover.variable_json(_add_clip(document, scene, mover, binary), first))
        elif isinstance(mover, NodeMover):
            variables.append(mover.variable_json(_add_node(document, scene, mover), first))
    return variables


def _add_node(document: dict[str, Any], scene: Scene, mover: NodeMover) -> int:
    """Add the node that moves; returns its index."""
    carried = sorted(moving_nodes(scene, mover))
    if mover.path == "translation":
        document["nodes"].append({"name": f"{mover.name} mover", "children": carried})
        return len(document["nodes"]) - 1
    return _about(document, mover.name, mover.pivot, carried)


def _about(document: dict[str, Any], name: str, origin: Sequence[float], carried: Sequence[int]) -> int:
    """Add a node whose origin is a point, and which carries other nodes without a change of their places."""
    nodes, (x, y, z) = document["nodes"], (float(c) for c in origin)
    nodes.append({"name": f"{name} at rest", "translation": [-x, -y, -z], "children": list(carried)})
    nodes.append({"name": f"{name} mover", "translation": [x, y, z], "children": [len(nodes) - 1]})
    return len(nodes) - 1


def _add_clip(document: dict[str, Any], scene: Scene, mover: ClipMover, binary: Binary) -> int:
    """Add the nodes of a clip and its animation, which any glTF viewer plays; returns the animation's index."""
    animation: dict[str, Any] = {"name": mover.name, "channels": [], "samplers": []}
    for part in mover.parts:
        node = _about(document, part.name, part.rest, sorted(moving_nodes(scene, part)))
        times = (np.array(part.shares) * mover.seconds).astype(np.float32)
        keys = binary.add_accessor(times, bounds=True)
        for path, values in _channels(part):
            animation["samplers"].append({"input": keys, "output": binary.add_accessor(values)})
            target = {"node": node, "path": path}
            animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": target})
    document.setdefault("animations", []).append(animation)
    return len(document["animations"]) - 1


def _channels(part: ClipPart) -> list[tuple[str, np.ndarray]]:
    """What a clip changes of a part, and its keys [K, C]."""
    turns, places = np.array(part.turns, np.float32), np.array(part.places, np.float32)
    still = np.array([0.0, 0.0, 0.0, 1.0]), np.array(part.rest)
    found = [("rotation", turns, still[0]), ("translation", places, still[1])]
    return [(path, values) for path, values, rest in found if np.abs(values - rest).max() > CONSTANT]
