"""Clips of a glTF file: where each animated node stands along the clip."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from lightwell.core.quaternions import slerp
from lightwell.limits import Limits
from lightwell.scenes.clip_mover import ClipMotion
from lightwell.scenes.gltf_accessors import Accessors
from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_json import Place
from lightwell.scenes.gltf_nodes import PlacedNode, placed_nodes, rotations
from lightwell.scenes.gltf_rest import PATHS, animated_channels, poses_for_flat_nodes

# Times at which a clip is read: its keys, and as many between them that no interval is longer than this share; most.
LONGEST_INTERVAL, MOST_TIMES = 1 / 32, 512
# Share of a clip within which a step is taken.
SHORTEST = 1e-5
# Most nodes that may move in one clip, and most channels that it may have.
MOST_NODES, MOST_CHANNELS = 512, 4096


@dataclass(frozen=True)
class _Track:
    """One animated property of a node."""

    path: str
    times: np.ndarray
    values: np.ndarray
    """[K, C], or [K, 3, C] with the tangents of a cubic spline."""
    interpolation: str

    def at(self, time: np.ndarray) -> np.ndarray:
        """[T, C] values at times, seconds."""
        first = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, max(len(self.times) - 2, 0))
        second = np.minimum(first + 1, len(self.times) - 1)
        step = (self.times[second] - self.times[first])[:, None]
        f = np.clip((time - self.times[first])[:, None] / np.where(step > 0, step, 1.0), 0.0, 1.0)
        if self.interpolation == "STEP":
            return np.where(f < 1, self.values[first], self.values[second])
        if self.interpolation == "CUBICSPLINE":
            return self._spline(first, second, step, f)
        if self.path == "rotation":
            return slerp(_unit(self.values[first]), _unit(self.values[second]), f)
        return (1 - f) * self.values[first] + f * self.values[second]

    def _spline(self, first: np.ndarray, second: np.ndarray, step: np.ndarray, f: np.ndarray) -> np.ndarray:
        """Cubic Hermite spline (glTF 2.0, appendix C)."""
        start, leaving = self.values[first, 1], step * self.values[first, 2]
        end, arriving = self.values[second, 1], step * self.values[second, 0]
        f2, f3 = f * f, f * f * f
        found = (2 * f3 - 3 * f2 + 1) * start + (f3 - 2 * f2 + f) * leaving
        found += (3 * f2 - 2 * f3) * end + (f3 - f2) * arriving
        return _unit(found) if self.path == "rotation" else found


def read_clip(path: str | Path, limits: Limits, unit: float, digests: Mapping[Path, str], number: int) -> ClipMotion:
    """Read a clip of a file.

    Args:
        path: The ``.glb`` or ``.gltf`` file.
        limits: Limits of what a file may ask for.
        unit: Metres per unit of the file.
        digests: Digest of each file that the scene was loaded from.
        number: Index of the animation.

    Returns:
        The motion; without nodes where the clip moves none.

    Raises:
        SceneError: The file is damaged, or has changed since it was loaded.
    """
    document = Document(Path(path), limits)
    accessors = Accessors(document)
    with np.errstate(all="ignore"):
        nodes = list(placed_nodes(document, unit, poses_for_flat_nodes(document, accessors, lambda text: None)))
        motion = _motion(document, accessors, nodes, unit, document.item("animations", number))
    # Buffers that only animations use were not read with the scene.
    for file, digest in document.digests.items():
        if digests.get(file, digest) != digest:
            document.fail(f"'{file.name}' has changed since it was loaded", "start the bake again")
    return motion


def _motion(
    document: Document, accessors: Accessors, nodes: list[PlacedNode], unit: float, animation: Place
) -> ClipMotion:
    """The motion of a clip."""
    index_of = {node.index: k for k, node in enumerate(nodes)}
    tracks: dict[int, list[_Track]] = {}
    channels = animated_channels(document, animation)
    if len(channels) > MOST_CHANNELS:
        animation.fail(f"has {len(channels):,} channels, more than {MOST_CHANNELS:,}", "name a clip that has fewer")
    for target, path, sampler in channels:
        if target in index_of and path in PATHS:
            tracks.setdefault(index_of[target], []).append(_track(accessors, document, animation, path, sampler))
    owner = _owners(nodes, index_of, set(tracks))
    moving = list(owner)
    if len(moving) > MOST_NODES:
        animation.fail(f"moves {len(moving):,} nodes, more than {MOST_NODES:,}", "name a clip that moves fewer")
    every = [track for of_node in tracks.values() for track in of_node]
    seconds = max((float(track.times[-1]) for track in every), default=0.0)
    if not moving or not seconds > 0:
        return ClipMotion(0.0, np.array([0.0, 1.0]), (), (), np.zeros((2, 0, 4, 4)))
    # A step is as short as the times of a clip can say.
    steps = [track.times / seconds - SHORTEST for track in every if track.interpolation == "STEP"]
    shares = _shares([*(track.times / seconds for track in every), *steps])
    worlds: dict[int, np.ndarray] = {}
    for k in moving:
        parent = index_of.get(nodes[k].parent, -1)
        at_rest = nodes[parent].matrix if parent >= 0 else np.diag([unit, unit, unit, 1.0])
        above = worlds.get(parent, at_rest)
        worlds[k] = above @ _local(nodes[k].place, tracks.get(k, []), shares * seconds)
    found = np.stack([worlds[k] for k in moving], axis=1)
    if not np.isfinite(found).all():
        animation.fail("moves nodes so far that their places are not finite")
    return ClipMotion(seconds, shares, tuple(moving), tuple(owner.values()), found)


def _owners(nodes: list[PlacedNode], index_of: dict[int, int], animated: set[int]) -> dict[int, int]:
    """For each node that is animated, or lies below one that is, the nearest animated node; parents first."""
    owner: dict[int, int] = {}
    for k, node in enumerate(nodes):
        parent = index_of.get(node.parent, -1)
        if k in animated:
            owner[k] = k
        elif parent in owner:
            owner[k] = owner[parent]
    return owner


def _track(accessors: Accessors, document: Document, animation: Place, path: str, sampler: int) -> _Track:
    place = Place(animation.scene, f"{animation.what} sampler {sampler}", animation.items("samplers")[sampler])
    count = document.count("accessors")
    first, second = (place.index(key, count, "accessor") for key in ("input", "output"))
    if first is None or second is None:
        place.fail("has no input or output")
    times = accessors.floats(first).astype(np.float64).reshape(-1)
    values = accessors.floats(second).astype(np.float64)
    interpolation = place.text("interpolation", "LINEAR")
    if interpolation == "CUBICSPLINE" and len(values) == 3 * len(times):
        values = values.reshape(len(times), 3, -1)
    whole = len(values) == len(times) and values.shape[-1] == PATHS[path]
    if not len(times) or not whole or not np.isfinite(values).all() or np.any(np.diff(times) <= 0) or times[0] < 0:
        place.fail("has times that do not increase, or values that do not belong to them")
    return _Track(path, times, values, interpolation)


def _shares(keys: list[np.ndarray]) -> np.ndarray:
    """[K] increasing shares from 0 to 1: all keys, and more where they are far apart."""
    known = np.unique(np.concatenate([[0.0, 1.0], *keys]).clip(0, 1).round(9))
    if len(known) > MOST_TIMES:
        return np.linspace(0.0, 1.0, MOST_TIMES)
    parts = [np.linspace(a, b, int(np.ceil((b - a) / LONGEST_INTERVAL - 1e-9)) + 1)[:-1] for a, b in pairwise(known)]
    return np.append(np.concatenate(parts), 1.0)


def _local(place: Place, tracks: list[_Track], time: np.ndarray) -> np.ndarray:
    """[K, 4, 4] transforms of a node to its parent at times, seconds."""
    of_path: Callable[[str], np.ndarray | None] = lambda path: next(  # noqa: E731
        (track.at(time) for track in tracks if track.path == path), None
    )
    rest = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
    parts = {
        path: np.broadcast_to(place.numbers(path, len(default), default), (len(time), len(default)))
        if (found := of_path(path)) is None
        else found
        for path, default in rest.items()
    }
    matrix = np.zeros((len(time), 4, 4))
    if "matrix" in place and not tracks:
        matrix[:] = np.array(place.numbers("matrix", 16)).reshape(4, 4).T
        return matrix
    matrix[:, :3, :3] = rotations(np.asarray(parts["rotation"])) * parts["scale"][:, None, :]
    matrix[:, :3, 3], matrix[:, 3, 3] = parts["translation"], 1.0
    return matrix


def _unit(quaternions: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return np.where(length > 0, quaternions / np.where(length > 0, length, 1.0), [0.0, 0.0, 0.0, 1.0])
