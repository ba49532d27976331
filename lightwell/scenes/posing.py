"""Movers of a scene: found by the name of their node, checked, and set to a pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.core.mover_texts import MoverState
from lightwell.core.suggest import nearest
from lightwell.core.vary import Declaration, parse_vary
from lightwell.scenes.assemble import posed_mesh
from lightwell.scenes.assemble_lights import punctual
from lightwell.scenes.movers import Mover, Vector
from lightwell.scenes.scene import Light, Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.vectors import vector

# Poses of a scene that are kept; a bake goes round all of them.
POSED = Derived[Scene]("scenes.posed", most=40)
# Scales of a node's axes that differ by more than this share are not one scale.
EVEN_SCALE = 1e-3


def declared_mover(texts: Sequence[str], scene: Scene) -> Mover | None:
    """Find the mover that declarations describe.

    Args:
        texts: Declarations, see ``parse_vary``; those of lights are passed over.
        scene: The scene.

    Returns:
        The mover; None where no node is declared.

    Raises:
        ValueError: There are several, the node is not there, carries a camera or moves nothing.
    """
    found = [d for d in map(parse_vary, texts) if d.moves]
    if len(found) > 1:
        names = ", ".join(d.text for d in found)
        raise ValueError(f"vary: one node can move, not {len(found)} ({names}); declare one of them")
    return mover_of(found[0], scene) if found else None


def mover_of(declaration: Declaration, scene: Scene) -> Mover:
    """Find the node that a declaration moves.

    Args:
        declaration: A declaration of a node.
        scene: The scene.

    Returns:
        The mover.

    Raises:
        ValueError: The node is not there, is there twice, carries a camera or moves nothing.
    """
    number = _node(declaration, scene)
    node, below = scene.nodes[number], _below(scene, number)
    what = f"vary: node '{node.name}'"
    cameras = [camera for k in below for camera in scene.nodes[k].cameras]
    if cameras:
        raise ValueError(f"{what} carries camera '{cameras[0]}', which cannot move; name a node without a camera")
    meshes = tuple(sorted(mesh for k in below for mesh in scene.nodes[k].meshes))
    lights = tuple(sorted(light for k in below for light in scene.nodes[k].lights))
    if not meshes and not lights:
        raise ValueError(f"{what} carries no mesh and no light, so that nothing would move; name a node that does")
    if len(meshes) == len(scene.meshes):
        raise ValueError(f"{what} carries every mesh of scene '{scene.name}'; name a node that carries a part of it")
    path, values = declaration.parameter, np.asarray(declaration.values)
    if path == "rotation":
        axis = _turned(node.matrix, values[:3], what)
        low, high = float(values[3]), float(values[4])
        return Mover(node.name, "rotation", axis, vector(node.matrix[:3, 3]), low, high, meshes, lights)
    parent = np.eye(4) if node.parent < 0 else scene.nodes[node.parent].matrix
    start, way = values[:3], values[3:] - values[:3]
    length = float(np.linalg.norm(way))
    offset = np.zeros(3) if not start.any() else np.linalg.norm(start) * np.array(_turned(parent, start, what))
    return Mover(node.name, "translation", _turned(parent, way, what), vector(offset), 0.0, length, meshes, lights)


def _node(declaration: Declaration, scene: Scene) -> int:
    """Index of the node of a declaration."""
    if not scene.nodes:
        raise ValueError(
            f"vary: scene '{scene.name}' has no nodes that could move; use a .glb or .gltf file, or drop '"
            f"{declaration.text}'"
        )
    names = [node.name for node in scene.nodes]
    found = [k for k, name in enumerate(names) if name == declaration.name]
    if not found:
        known = nearest(declaration.name, [n.name for n in scene.nodes if not n.cameras])
        raise ValueError(f"vary: scene '{scene.name}' has no node '{declaration.name}'; the nearest names are {known}")
    if len(found) > 1:
        raise ValueError(
            f"vary: scene '{scene.name}' has {len(found)} nodes '{declaration.name}'; give each a name of its own"
        )
    return found[0]


def _below(scene: Scene, number: int) -> list[int]:
    """A node and all nodes below it; parents come first in ``Scene.nodes``."""
    found = {number}
    for k, node in enumerate(scene.nodes):
        if node.parent in found:
            found.add(k)
    return sorted(found)


def _turned(matrix: np.ndarray, way: np.ndarray, what: str) -> Vector:
    """[3] unit world direction of a direction in a node's space, whose axes must have one scale."""
    linear = matrix[:3, :3]
    scales = np.linalg.norm(linear, axis=0)
    if not scales.min() > 0 or np.ptp(scales) > EVEN_SCALE * scales.max():
        raise ValueError(f"{what} is scaled unevenly, so that it would not stay rigid; apply its scale in the file")
    found = linear @ way
    return vector(found / np.linalg.norm(found))


def with_mover(scene: Scene, mover: Mover | None) -> Scene:
    """Declare the mover of a scene; the records stay at rest.

    Args:
        scene: The scene.
        mover: The mover; None: nothing moves.

    Returns:
        A scene with its own cache; ``scene`` itself without a mover.
    """
    if mover is None:
        return scene
    return replace(scene, mover=mover, digest=f"{scene.digest} {mover!r}" if scene.digest else "")


def posed(scene: Scene, slider: float) -> Scene:
    """Move the mover of a scene, with its children, to a pose; the result is kept with the scene.

    Args:
        scene: Scene with a mover.
        slider: Pose, 0 to 1.

    Returns:
        The scene in that pose; nothing of it moves any more. ``scene`` itself without a mover.
    """
    if scene.mover is None:
        return scene
    at = round(float(slider), 6)
    return scene.cache.get(POSED, lambda: _posed(scene, scene.mover, at), (at,))  # type: ignore[arg-type]


def _posed(scene: Scene, mover: Mover, slider: float) -> Scene:
    meshes, shapes, moving = list(scene.meshes), scene.mi.shapes(), set(mover.meshes)
    description: dict[str, Any] = {"type": "scene"}
    for index, mesh in enumerate(scene.meshes):
        shape = shapes[index]
        if index in moving:
            normals = None if mesh.normals is None else mover.moved(slider, mesh.normals, directions=True)
            meshes[index] = replace(
                mesh,
                positions=mover.moved(slider, mesh.positions).astype(np.float32),
                normals=None if normals is None else normals.astype(np.float32),
            )
            shape = posed_mesh(meshes[index], scene.materials[mesh.material], shape)
        description[f"mesh_{index:06d}"] = shape
    lights = [
        _moved_light(light, mover, slider) if k in mover.lights else light for k, light in enumerate(scene.lights)
    ]
    description |= _emitters(scene, mover, lights)
    return replace(
        scene,
        meshes=meshes,
        lights=lights,
        mi=mi.load_dict(description, optimize=False),
        mover=None,
        digest=f"{scene.digest} at {slider:g}" if scene.digest else "",
    )


def _emitters(scene: Scene, mover: Mover, lights: Sequence[Light]) -> dict[str, Any]:
    """Emitters that are not surfaces: lights of the mover are made anew, the others are shared."""
    # ``assemble`` adds the lights first, in their order.
    others = [emitter for emitter in scene.mi.emitters() if emitter.get_shape() is None]
    found = {}
    for k, emitter in enumerate(others):
        moves = k in mover.lights
        found[f"light_{k:06d}"] = punctual(lights[k]) if moves else emitter
    return found


def _moved_light(light: Light, mover: Mover, slider: float) -> Light:
    position = mover.moved(slider, np.array([light.position]))[0]
    direction = mover.moved(slider, np.array([light.direction]), directions=True)[0]
    return replace(light, position=vector(position), direction=vector(direction))


def in_state(scene: Scene, states: Sequence[MoverState], vary: Sequence[str] = ()) -> Scene:
    """Set a node to a pose.

    Args:
        scene: The scene.
        states: Settings of at most one node.
        vary: Declarations; that of the node says what turns it, and bounds it.

    Returns:
        The scene in that pose; ``scene`` itself without a setting.

    Raises:
        ValueError: The node is not there or cannot move, or the value lies outside the declared range.
    """
    if not states:
        declared_mover(vary, scene)
        return scene
    state = states[0]
    declared = next((d for d in map(parse_vary, vary) if d.moves and d.text == state.what), None)
    if state.offset is not None:
        whole = (0.0, 0.0, 0.0, *state.offset)
        if not any(state.offset):
            return scene
        return posed(with_mover(scene, mover_of(Declaration(state.name, state.path, whole, state.what), scene)), 1.0)
    value = state.value or 0.0
    if declared is None and state.path == "translation":
        raise ValueError(
            f"set: '{state.what}={value:g}' needs a declared way; give --vary '{state.what}=(0,0,0)..(0,0,1.2)', or an "
            f"offset such as --set '{state.what}=(0,0,0.6)'"
        )
    if declared is None or state.axis is not None:
        axis = state.axis or (0.0, 1.0, 0.0)
        # A range that holds the value; its length says nothing.
        mover = mover_of(Declaration(state.name, "rotation", (*axis, value - 1.0, value), state.what), scene)
        return posed(with_mover(scene, mover), 1.0)
    mover = mover_of(declared, scene)
    at = mover.slider(value)
    if not -1e-9 <= at <= 1 + 1e-9:
        low, high = sorted((mover.low, mover.high))
        raise ValueError(
            f"set: '{state.what}={value:g}' lies outside of what --vary declares; give {low:g} to {high:g} {mover.unit}"
        )
    return posed(with_mover(scene, mover), at)
