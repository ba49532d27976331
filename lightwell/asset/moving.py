"""The nodes of an asset that move: a parent of all that a mover carries, which turns about its hinge or slides."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lightwell.scenes.movers import Mover
    from lightwell.scenes.scene import Scene


def moving_nodes(scene: Scene, mover: Mover) -> set[int]:
    """List the nodes of an asset that a mover carries.

    Args:
        scene: The scene; its meshes are the first nodes of the asset, its lights the next.
        mover: Its mover.

    Returns:
        Indices of nodes.
    """
    shown = [k for k, mesh in enumerate(scene.meshes) if len(mesh.indices)]
    meshes = {number for number, k in enumerate(shown) if k in mover.meshes}
    return meshes | {len(shown) + light for light in mover.lights}


def add_mover(document: dict[str, Any], scene: Scene, mover: Mover) -> int:
    """Add the node that moves. At rest it changes nothing: geometry stays in world space.

    Args:
        document: glTF JSON with the nodes of meshes and lights.
        scene: The scene.
        mover: Its mover.

    Returns:
        Index of the node.
    """
    nodes, carried = document["nodes"], sorted(moving_nodes(scene, mover))
    if mover.path == "translation":
        nodes.append({"name": f"{mover.name} mover", "children": carried})
        return len(nodes) - 1
    x, y, z = (float(c) for c in mover.pivot)
    nodes.append({"name": f"{mover.name} at rest", "translation": [-x, -y, -z], "children": carried})
    nodes.append({"name": f"{mover.name} mover", "translation": [x, y, z], "children": [len(nodes) - 1]})
    return len(nodes) - 1
