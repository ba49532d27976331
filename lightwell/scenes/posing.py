"""Movers of a scene: found by the name of their node or clip, checked, and set to a pose."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.core.mover_texts import ROTATION_EXAMPLE, MoverState
from lightwell.core.quaternions import rotation_quaternion
from lightwell.core.suggest import nearest
from lightwell.core.vary import Declaration, parse_vary
from lightwell.scenes.assemble import posed_mesh
from lightwell.scenes.assemble_lights import AREA_LIGHTS, AreaLights, punctual
from lightwell.scenes.clip_mover import ClipMotion, ClipMover, ClipPart
from lightwell.scenes.movers import MOST_MOVERS, Mover, NodeMover, Pose, RigidPart, Vector
from lightwell.scenes.scene import Light, Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.vectors import vector

# Poses of a scene that are kept; a bake goes round all of them.
POSED = Derived[Scene]("scenes.posed", most=128)
# Scales of a node's axes that differ by more than this share are not one scale.
EVEN_SCALE = 1e-3
# Parts of a clip, at most: each is a node of the asset.
MOST_PARTS = 32
# A part of a clip that turns and slides less, relative to the scene's size, stands still.
STILL = 1e-5


def declared_movers(texts: Sequence[str], scene: Scene) -> tuple[Mover, ...]:
    """Find the movers that declarations describe.

    Args:
        texts: Declarations, see ``parse_vary``; those of lights are passed over.
        scene: The scene.

    Returns:
        The movers, in the order of their declarations.

    Raises:
        ValueError: There are more than ``MOST_MOVERS``, two move one part, or one is not there, carries a camera or
            moves nothing.
    """
    found = [d for d in map(parse_vary, texts) if d.moves]
    if len(found) > MOST_MOVERS:
        raise ValueError(f"vary: {len(found)} things move, more than {MOST_MOVERS}; bake fewer of them together")
    movers = tuple(mover_of(d, scene) for d in found)
    for k, mover in enumerate(movers):
        for other in movers[:k]:
            if other.name == mover.name or set(other.moving_meshes) & set(mover.moving_meshes):
                raise ValueError(
                    f"vary: '{other.name}' and '{mover.name}' move the same part; declare one of them, or a clip that "
                    "has both motions"
                )
    return movers


def mover_of(declaration: Declaration, scene: Scene) -> Mover:
    """Find the node or clip that a declaration moves.

    Args:
        declaration: A declaration of a node or a clip.
        scene: The scene.

    Returns:
        The mover.

    Raises:
        ValueError: It is not there, is there twice, carries a camera or moves nothing.
    """
    if declaration.parameter == "animation":
        return _clip_mover(declaration, scene)
    number = _node(declaration, scene)
    node, below = scene.nodes[number], _below(scene, number)
    what = f"vary: node '{node.name}'"
    _refuse_cameras(scene, below, what, "name a node without a camera")
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
        return NodeMover(node.name, "rotation", axis, vector(node.matrix[:3, 3]), low, high, meshes, lights)
    parent = np.eye(4) if node.parent < 0 else scene.nodes[node.parent].matrix
    start, way = values[:3], values[3:] - values[:3]
    length = float(np.linalg.norm(way))
    offset = np.zeros(3) if not start.any() else np.linalg.norm(start) * np.array(_turned(parent, start, what))
    return NodeMover(node.name, "translation", _turned(parent, way, what), vector(offset), 0.0, length, meshes, lights)


def _refuse_cameras(scene: Scene, nodes: Sequence[int], what: str, cure: str) -> None:
    """Refuse to move cameras."""
    cameras = [camera for k in nodes for camera in scene.nodes[k].cameras]
    if cameras:
        raise ValueError(f"{what} carries camera '{cameras[0]}', which cannot move; {cure}")


def _clip_mover(declaration: Declaration, scene: Scene) -> ClipMover:
    """The mover of a clip of the file."""
    name, (low, high) = declaration.name, declaration.values
    found = [k for k, clip in enumerate(scene.clips) if clip == name]
    if not scene.clips or scene.read_clip is None or not scene.nodes:
        raise ValueError(
            f"vary: scene '{scene.name}' has no clips; move a node, for example {ROTATION_EXAMPLE}, or drop '"
            f"{declaration.text}'"
        )
    if not found:
        known = nearest(name, scene.clips)
        raise ValueError(f"vary: scene '{scene.name}' has no clip '{name}'; the nearest names are {known}")
    if len(found) > 1:
        raise ValueError(f"vary: scene '{scene.name}' has {len(found)} clips '{name}'; give each a name of its own")
    motion, what = scene.read_clip(found[0]), f"vary: clip '{name}'"
    _refuse_cameras(scene, motion.nodes, what, "name a clip that moves no camera")
    parts = _clip_parts(scene, motion, what, (low, high))
    if not parts:
        raise ValueError(
            f"{what} moves no mesh and no light as a whole (skins and morphs stand still); name a clip that does"
        )
    if len(parts) > MOST_PARTS:
        raise ValueError(f"{what} moves {len(parts)} parts, more than {MOST_PARTS}; name a clip that moves fewer")
    mover = ClipMover(name, low, high, motion.seconds, parts)
    if len(mover.moving_meshes) == len(scene.meshes):
        raise ValueError(f"{what} moves every mesh of scene '{scene.name}'; name one that moves a part of it")
    return mover


def _clip_parts(scene: Scene, motion: ClipMotion, what: str, span: tuple[float, float]) -> tuple[ClipPart, ...]:
    """The parts of a clip that move in a stretch of it; each must stay rigid."""
    parts, rows = [], {node: row for row, node in enumerate(motion.nodes)}
    first = max(int(np.searchsorted(motion.shares, min(span), side="right")) - 1, 0)
    inside = slice(first, int(np.searchsorted(motion.shares, max(span))) + 1)
    for owner in dict.fromkeys(motion.owner):
        own = [node for node, of in zip(motion.nodes, motion.owner) if of == owner]
        meshes = tuple(sorted(mesh for node in own for mesh in scene.nodes[node].meshes))
        lights = tuple(sorted(light for node in own for light in scene.nodes[node].lights))
        if not meshes and not lights:
            continue
        rest, name = scene.nodes[owner].matrix, scene.nodes[owner].name
        if not abs(np.linalg.det(rest[:3, :3])) > 0:
            raise ValueError(f"{what} moves node '{name}', which has no size at rest; give it one in the file")
        worlds = motion.worlds[:, rows[owner]]
        linear = worlds[:, :3, :3] @ np.linalg.inv(rest[:3, :3])
        if np.abs(linear @ linear.transpose(0, 2, 1) - np.eye(3)).max() > 2 * EVEN_SCALE:
            raise ValueError(f"{what} scales node '{name}', which must stay rigid; name a clip that turns and slides")
        places = worlds[:, :3, 3]
        turned, slid = (np.ptp(keys[inside], axis=0).max() for keys in (linear, places))
        if turned < STILL and slid < STILL * scene.extent:
            continue
        turns = tuple((x, y, z, w) for x, y, z, w in _continuous([rotation_quaternion(m) for m in linear]))
        shares = tuple(motion.shares.tolist())
        ways = tuple(vector(place) for place in places)
        parts.append(ClipPart(name, meshes, lights, shares, turns, ways, vector(rest[:3, 3]), span))
    return tuple(parts)


def _continuous(quaternions: Sequence[Sequence[float]]) -> list[list[float]]:
    """Unit quaternions of one turn, each with the sign that is nearer to the one before."""
    found = [[float(c) for c in quaternions[0]]]
    for q in quaternions[1:]:
        same = sum(a * b for a, b in zip(q, found[-1])) >= 0
        found.append([float(c if same else -c) for c in q])
    return found


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


def with_movers(scene: Scene, movers: tuple[Mover, ...]) -> Scene:
    """Declare the movers of a scene; the records stay at rest.

    Args:
        scene: The scene.
        movers: The movers; none: nothing moves.

    Returns:
        A scene with its own cache; ``scene`` itself without a mover.
    """
    if not movers:
        return scene
    about = hashlib.sha256(repr(movers).encode()).hexdigest()[:32]
    return replace(scene, movers=movers, digest=f"{scene.digest} moved by {about}" if scene.digest else "")


def posed(scene: Scene, pose: Sequence[float]) -> Scene:
    """Set the movers of a scene, with what hangs on them, to a pose; the result is kept with the scene.

    Args:
        scene: Scene with M movers.
        pose: M sliders, 0 to 1.

    Returns:
        The scene in that pose; nothing of it moves any more. ``scene`` itself without a mover.
    """
    if not scene.movers:
        return scene
    at = tuple(round(float(slider), 6) for slider in pose)
    return scene.cache.get(POSED, lambda: _posed(scene, at), at)


def _posed(scene: Scene, pose: Pose) -> Scene:
    meshes, shapes, glowing = list(scene.meshes), scene.mi.shapes(), scene.cache.get(AREA_LIGHTS, AreaLights)
    moving = {mesh: moved for moved in moving_parts(scene, pose) for mesh in moved[0].meshes}
    description: dict[str, Any] = {"type": "scene"}
    for index, mesh in enumerate(scene.meshes):
        shape = shapes[index]
        if index in moving:
            part, slider = moving[index]
            normals = None if mesh.normals is None else part.moved(slider, mesh.normals, directions=True)
            meshes[index] = replace(
                mesh,
                positions=part.moved(slider, mesh.positions).astype(np.float32),
                normals=None if normals is None else normals.astype(np.float32),
            )
            shape = posed_mesh(meshes[index], scene.materials[mesh.material], shape, glowing)
        description[f"mesh_{index:06d}"] = shape
    lit = {light: moved for moved in moving_parts(scene, pose) for light in moved[0].lights}
    lights = [_moved_light(light, *lit[k]) if k in lit else light for k, light in enumerate(scene.lights)]
    description |= _emitters(scene, set(lit), lights)
    return replace(
        scene,
        meshes=meshes,
        lights=lights,
        mi=mi.load_dict(description, optimize=False),
        movers=(),
        digest=f"{scene.digest} at {', '.join(f'{slider:g}' for slider in pose)}" if scene.digest else "",
    )


def moving_parts(scene: Scene, pose: Sequence[float]) -> list[tuple[RigidPart, float]]:
    """List the parts that move, each with the slider of its mover.

    Args:
        scene: Scene with M movers.
        pose: M sliders, 0 to 1.

    Returns:
        Parts and sliders.
    """
    return [(part, float(slider)) for mover, slider in zip(scene.movers, pose) for part in mover.parts]


def _emitters(scene: Scene, moving: set[int], lights: Sequence[Light]) -> dict[str, Any]:
    """Emitters that are not surfaces: lights that move are made anew, the others are shared."""
    # ``assemble`` adds the lights first, in their order.
    others = [emitter for emitter in scene.mi.emitters() if emitter.get_shape() is None]
    found = {}
    for k, emitter in enumerate(others):
        found[f"light_{k:06d}"] = punctual(lights[k]) if k in moving else emitter
    return found


def _moved_light(light: Light, part: RigidPart, slider: float) -> Light:
    position = part.moved(slider, np.array([light.position]))[0]
    direction = part.moved(slider, np.array([light.direction]), directions=True)[0]
    return replace(light, position=vector(position), direction=vector(direction))


def in_state(scene: Scene, states: Sequence[MoverState], vary: Sequence[str] = ()) -> Scene:
    """Set nodes and clips to a pose.

    Args:
        scene: The scene.
        states: Settings of what moves.
        vary: Declarations; that of a node says what turns it, and bounds it.

    Returns:
        The scene in that pose; ``scene`` itself without a setting.

    Raises:
        ValueError: A node or clip is not there or cannot move, or a value lies outside the declared range.
    """
    declared_movers(vary, scene)
    found = [moved for state in states if (moved := _set_mover(scene, state, vary)) is not None]
    if not found:
        return scene
    movers = tuple(mover for mover, _ in found)
    return posed(with_movers(scene, movers), [slider for _, slider in found])


def _set_mover(scene: Scene, state: MoverState, vary: Sequence[str]) -> tuple[Mover, float] | None:
    """The mover of a setting and its slider; None for one that stays at rest."""
    declared = next((d for d in map(parse_vary, vary) if d.moves and d.text == state.what), None)
    if state.offset is not None:
        whole = (0.0, 0.0, 0.0, *state.offset)
        if not any(state.offset):
            return None
        return mover_of(Declaration(state.name, state.path, whole, state.what), scene), 1.0
    value = state.value or 0.0
    if declared is None and state.path == "animation":
        declared = Declaration(state.name, state.path, (0.0, 1.0), state.what)
    if declared is None and state.path == "translation":
        raise ValueError(
            f"set: '{state.what}={value:g}' needs a declared way; give --vary '{state.what}=(0,0,0)..(0,0,1.2)', or an "
            f"offset such as --set '{state.what}=(0,0,0.6)'"
        )
    if declared is None or state.axis is not None:
        axis = state.axis or (0.0, 1.0, 0.0)
        # A range that holds the value; its length says nothing.
        return mover_of(Declaration(state.name, "rotation", (*axis, value - 1.0, value), state.what), scene), 1.0
    mover = mover_of(declared, scene)
    at = mover.slider(value)
    if not -1e-9 <= at <= 1 + 1e-9:
        low, high = sorted((mover.low, mover.high))
        unit = "of the clip" if mover.unit == "share" else mover.unit
        raise ValueError(
            f"set: '{state.what}={value:g}' lies outside of what --vary declares; give {low:g} to {high:g} {unit}"
        )
    return mover, at
