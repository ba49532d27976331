"""The parts of a scene that light can notice, each with a hash of its content: what has changed between two loads.

Names, nodes and cameras are no parts: renaming an object or moving a camera changes nothing.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from lightwell.core.keys import digest
from lightwell.scenes.scene import Image, Light, Material, Mesh, Scene, Texture

# Half edge of the box around a punctual light, metres.
LIGHT_BOX = 0.01


@dataclass(frozen=True)
class ScenePart:
    """An object or a light."""

    digest: str
    """Hash of geometry, material and emission."""
    name: str
    """For messages; not part of the hash."""
    low: tuple[float, ...]
    """[3] smallest corner, metres."""
    high: tuple[float, ...]
    """[3] largest corner, metres."""
    shape: str = ""
    """Hash of the geometry alone; empty for a light."""
    emits: bool = False

    @staticmethod
    def of_json(values: Mapping[str, Any]) -> ScenePart:
        """Read a part from JSON values.

        Args:
            values: What ``dataclasses.asdict`` made of a part.

        Returns:
            The part.
        """
        return ScenePart(**{**values, "low": tuple(values["low"]), "high": tuple(values["high"])})


@dataclass(frozen=True)
class SceneChanges:
    """What differs between two versions of a scene."""

    boxes: np.ndarray
    """[B, 2, 3] boxes around everything that was added, removed or altered, before and after, metres."""
    solid: np.ndarray
    """[S, 2, 3] those of them that are surfaces, not lights without one."""
    lamps: np.ndarray
    """[L, 2, 3] those of them that emit light."""
    names: tuple[str, ...]
    """Names of what has changed."""
    mesh: np.ndarray
    """[M] for each mesh of the earlier version, the number of the same one now; -1 where there is none."""

    def __bool__(self) -> bool:
        return len(self.boxes) > 0


def scene_parts(scene: Scene) -> list[ScenePart]:
    """List the parts of a scene.

    Args:
        scene: The scene.

    Returns:
        Its meshes in their order, then its lights.
    """
    exact = not str(scene.source).lower().endswith(".xml")
    shapes = [] if exact else list(scene.mi.shapes())
    images: dict[int, str] = {}
    parts = []
    for number, mesh in enumerate(scene.meshes):
        # The records of a Mitsuba scene are approximate; its own description is not.
        own = "" if exact else f"{shapes[number].bsdf()}{shapes[number].emitter()}"
        parts.append(_mesh_part(mesh, scene.materials[mesh.material], own, images))
    parts += [_light_part(light) for light in scene.lights]
    environment = scene.mi.environment()
    if environment is not None:
        low, high = (tuple(float(v) for v in corner) for corner in scene.bounds)
        parts.append(ScenePart(digest(str(environment).encode()), "environment", low, high, emits=True))
    return parts


def scene_changes(before: Sequence[ScenePart], after: Sequence[ScenePart]) -> SceneChanges:
    """Find what differs between two versions of a scene.

    Args:
        before: Parts of the earlier version.
        after: Parts of the present one.

    Returns:
        The changes.
    """
    old, new = Counter(p.digest for p in before), Counter(p.digest for p in after)
    changed = [*_only(before, old - new), *_only(after, new - old)]
    boxes = np.array([(p.low, p.high) for p in changed], np.float64).reshape(-1, 2, 3)
    solid = boxes[[k for k, p in enumerate(changed) if p.shape]]
    lamps = boxes[[k for k, p in enumerate(changed) if p.emits]]
    names = tuple(dict.fromkeys(p.name for p in changed))
    return SceneChanges(boxes, solid, lamps, names, _same_meshes(before, after))


def _only(parts: Iterable[ScenePart], left: Counter[str]) -> list[ScenePart]:
    """The parts whose hashes are left over, each as often as it is."""
    left, found = Counter(left), []
    for part in parts:
        if left[part.digest] > 0:
            left[part.digest] -= 1
            found.append(part)
    return found


def _same_meshes(before: Sequence[ScenePart], after: Sequence[ScenePart]) -> np.ndarray:
    places: dict[str, list[int]] = {}
    for number, part in enumerate(p for p in after if p.shape):
        places.setdefault(part.digest, []).append(number)
    found = [places[p.digest].pop(0) if places.get(p.digest) else -1 for p in before if p.shape]
    return np.array(found, np.int64)


def _mesh_part(mesh: Mesh, material: Material, own: str, images: dict[int, str]) -> ScenePart:
    hashed = hashlib.blake2b(digest_size=20)
    for array in (mesh.positions, mesh.indices, mesh.normals, mesh.uv0, mesh.uv1, mesh.colors):
        hashed.update(b"-" if array is None else np.ascontiguousarray(array).tobytes())
    shape = hashed.hexdigest()
    hashed.update(repr((mesh.emission, own, _described(material, images))).encode())
    low, high = (tuple(float(v) for v in corner) for corner in (mesh.positions.min(axis=0), mesh.positions.max(axis=0)))
    emits = max(mesh.emission) > 0 or max(material.emissive) > 0
    return ScenePart(hashed.hexdigest(), mesh.name, low, high, shape, emits)


def _described(material: Material, images: dict[int, str]) -> list[Any]:
    """The values of a material but its name; textures by content."""
    values = {f.name: getattr(material, f.name) for f in fields(material) if f.name != "name"}
    return [(name, _texture(v, images) if isinstance(v, Texture) else v) for name, v in values.items()]


def _texture(texture: Texture, images: dict[int, str]) -> list[Any]:
    return [_image(texture.image, images), texture.wrap, texture.nearest, texture.uv_set, texture.transform]


def _image(image: Image, images: dict[int, str]) -> str:
    if id(image) not in images:
        images[id(image)] = digest(image.data)
    return images[id(image)]


def _light_part(light: Light) -> ScenePart:
    values = {f.name: getattr(light, f.name) for f in fields(light) if f.name != "name"}
    low, high = (tuple(float(v) + s * LIGHT_BOX for v in light.position) for s in (-1, 1))
    return ScenePart(digest(repr(sorted(values.items())).encode()), light.name or light.kind, low, high, emits=True)
