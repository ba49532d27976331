"""Animations of lamps in an asset: channels that name what they change by KHR_animation_pointer."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lightwell.asset.records import EXTENSION

if TYPE_CHECKING:
    from lightwell.asset.container import Binary
    from lightwell.scenes.lamp_clips import LampClip
    from lightwell.scenes.light_clips import Keys, LightTrack

POINTER = "KHR_animation_pointer"
LIGHTS, STRENGTH = "KHR_lights_punctual", "KHR_materials_emissive_strength"
_LAMPS = f"/extensions/{EXTENSION}/"
_LAMP = re.compile(r"lamps/(0|[1-9]\d{0,3})/(intensity|color)\Z")
# Animations of lamps in one file at most: the extension's limit (format/LIGHTWELL_neural_radiance.md).
MOST_CLIPS = 64
# Nodes that an animation whose time is a variable moves, at most: another limit of the extension.
MOST_PARTS = 32
# glTF component type of 32-bit floats.
FLOAT = 5126
_TYPES = {"intensity": "SCALAR", "color": "VEC3"}


def add_lamp_clips(
    document: dict[str, Any], clips: Sequence[LampClip], materials: Mapping[int, Sequence[int]], binary: Binary
) -> None:
    """Add animations of lamps. Their lights and materials are animated too, for viewers that know no lamps.

    Args:
        document: glTF JSON with materials and lights.
        clips: The animations.
        materials: Indices of the written materials by index into ``Scene.materials``.
        binary: Receives the keys.
    """
    for clip in clips:
        animation = _Animation(clip.name, binary)
        for lamp in clip.lamps:
            animation.add(f"{_LAMPS}lamps/{lamp.lamp}/{lamp.path}", lamp.keys, np.ones(1))
        for track in clip.lights:
            for pointer, rest in _rest(document, track, materials):
                animation.add(pointer, track.keys, np.atleast_1d(np.asarray(rest, np.float64)))
        if animation.json["channels"]:
            document.setdefault("animations", []).append(animation.json)
            document["extensionsUsed"] = sorted({*document.get("extensionsUsed", ()), POINTER})


def _rest(document: dict[str, Any], track: LightTrack, materials: Mapping[int, Sequence[int]]) -> list[tuple[str, Any]]:
    """Pointers to what a track changes in the document, with the values at rest."""
    entries = document.get("extensions", {}).get(LIGHTS, {}).get("lights", [])
    found = [
        (f"/extensions/{LIGHTS}/lights/{k}/{track.path}", entries[k][track.path])
        for k in track.lights
        if k < len(entries)
    ]
    for k in () if track.material is None else materials.get(track.material, ()):
        material = document["materials"][k]
        if "emissiveFactor" not in material:
            continue
        if track.path == "color":
            found.append((f"/materials/{k}/emissiveFactor", material["emissiveFactor"]))
            continue
        # A pointer must name what is there.
        strength = material.setdefault("extensions", {}).setdefault(STRENGTH, {"emissiveStrength": 1.0})
        document["extensionsUsed"] = sorted({*document.get("extensionsUsed", ()), STRENGTH})
        found.append((f"/materials/{k}/extensions/{STRENGTH}/emissiveStrength", strength["emissiveStrength"]))
    return found


class _Animation:
    """One animation; equal keys are written once."""

    def __init__(self, name: str, binary: Binary) -> None:
        self.json: dict[str, Any] = {"name": name, "channels": [], "samplers": []}
        self._binary = binary
        self._inputs: dict[bytes, int] = {}
        self._samplers: dict[tuple[int, bytes], int] = {}

    def add(self, pointer: str, keys: Keys, rest: np.ndarray) -> None:
        """Add a channel whose values are the factors times the value at rest."""
        known = (id(keys), rest.tobytes())
        if known not in self._samplers:
            times = keys.times.astype(np.float32)
            if times.tobytes() not in self._inputs:
                self._inputs[times.tobytes()] = self._binary.add_accessor(times, bounds=True)
            values = (keys.values * rest).astype(np.float32).reshape(-1, keys.values.shape[-1])
            output = self._binary.add_accessor(values[:, 0] if values.shape[1] == 1 else values)
            sampler = {"input": self._inputs[times.tobytes()], "output": output, "interpolation": keys.interpolation}
            self.json["samplers"].append(sampler)
            self._samplers[known] = len(self.json["samplers"]) - 1
        target = {"path": "pointer", "extensions": {POINTER: {"pointer": pointer}}}
        self.json["channels"].append({"sampler": self._samplers[known], "target": target})


def moving_problems(document: dict[str, Any]) -> list[str]:
    """List the variables that name a node or an animation wrongly: nothing would follow their sliders.

    Args:
        document: glTF JSON whose extension follows the schema; unexpected types elsewhere raise what ``refusing``
            expects.

    Returns:
        One line per problem.
    """
    problems: list[str] = []
    for i, variable in enumerate(document["extensions"][EXTENSION]["variables"]):
        where, kind = f"variables[{i}]", variable["kind"]
        table = {"node": "nodes", "clip": "animations"}.get(kind)
        if table is None:
            continue
        name = table.removesuffix("s")
        if variable[name] >= len(document.get(table, ())):
            problems.append(f"{where}.{name}: there is no {name} {variable[name]}; name one of the file")
        elif kind == "clip":
            problems += _clip_problems(document, where, variable["animation"])
    return problems


def _clip_problems(document: dict[str, Any], where: str, index: int) -> list[str]:
    """What keeps an animation from being a variable."""
    targets = [channel["target"] for channel in document["animations"][index]["channels"]]
    nodes = {target.get("node", -1) for target in targets}
    if any(target["path"] not in ("rotation", "translation") for target in targets):
        return [f"{where}.animation: animation {index} changes more than rotations and translations; name another one"]
    if not all(0 <= node < len(document.get("nodes", ())) for node in nodes):
        return [f"{where}.animation: animation {index} moves a node that is not there; name one of the file"]
    if len(nodes) > MOST_PARTS:
        return [f"{where}.animation: animation {index} moves {len(nodes)} nodes, more than {MOST_PARTS}; move fewer"]
    return []


def pointer_problems(document: dict[str, Any], binary: bytes) -> list[str]:
    """List the channels that name a lamp wrongly, or give it no value for each time.

    Args:
        document: glTF JSON with lamps, untrusted; unexpected types raise what ``refusing`` expects.
        binary: Content of the binary chunk.

    Returns:
        One line per problem.
    """
    problems: list[str] = []
    used: set[int] = set()
    for i, animation in enumerate(document.get("animations", ())):
        for k, channel in enumerate(animation["channels"]):
            target = channel["target"].get("extensions", {}).get(POINTER, {})
            pointer = target.get("pointer")
            if not isinstance(pointer, str) or not pointer.startswith(_LAMPS):
                continue
            used.add(i)
            where = f"animations[{i}].channels[{k}]"
            problems += _problems(document, binary, where, pointer, animation["samplers"][channel["sampler"]])
    if used and POINTER not in document.get("extensionsUsed", ()):
        problems.append(f"extensionsUsed: {POINTER} is missing; list it")
    if len(used) > MOST_CLIPS:
        problems.append(f"animations: {len(used)} change lamps, more than {MOST_CLIPS}; keep fewer of them")
    return problems


def _problems(document: dict[str, Any], binary: bytes, where: str, pointer: str, sampler: dict[str, Any]) -> list[str]:
    lamps = document["extensions"][EXTENSION].get("lamps", ())
    match = _LAMP.match(pointer.removeprefix(_LAMPS))
    if match is None:
        return [f"{where}: '{pointer[:100]}' can not be animated; name the intensity or color of a lamp"]
    if int(match[1]) >= len(lamps):
        return [f"{where}: there is no lamp {match[1]}, only {len(lamps)}; name one of the file"]
    found = document["accessors"][sampler["output"]]["type"]
    if found != _TYPES[match[2]]:
        return [f"{where}: its values have type {str(found)[:20]}, expected {_TYPES[match[2]]}"]
    times, values = (document["accessors"][sampler[name]] for name in ("input", "output"))
    each = 3 if sampler.get("interpolation") == "CUBICSPLINE" else 1
    if values["count"] != each * times["count"]:
        return [f"{where}: {values['count']} values for {times['count']} times, expected {each} for each"]
    found = _floats(document, binary, times)
    if found is not None and not (found.size and found[0] >= 0 and (np.diff(found) > 0).all()):
        return [f"{where}: expected times that increase and are not negative; write its keys in order"]
    found = _floats(document, binary, values)
    if found is not None and not np.isfinite(found).all():
        return [f"{where}: expected finite values, found NaN or infinity; write its keys again"]
    return []


def _floats(document: dict[str, Any], binary: bytes, accessor: dict[str, Any]) -> np.ndarray | None:
    """The numbers of an accessor of floats that lie one after the other in the file; None for others."""
    view = document["bufferViews"][accessor["bufferView"]] if "bufferView" in accessor else {}
    packed = view.get("buffer") == 0 and not view.keys() & {"byteStride", "extensions"}
    if not packed or accessor["componentType"] != FLOAT or "sparse" in accessor:
        return None
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    count = accessor["count"] * {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
    data = binary[start : start + 4 * count]
    return np.frombuffer(data, "<f4") if len(data) == 4 * count else None
