"""Groups of a scene's own lights, each with one switch: light adds up, so that every group has a share of its own."""

from __future__ import annotations

import re
from collections.abc import Container, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import count
from typing import Any

from lightwell.core.lamps import MOST_LAMPS, LampRules
from lightwell.scenes.scene import Scene

# Name of the lights that no rule names, and of all of them together.
OTHERS, ALL, ENVIRONMENT = "others", "lights", "environment"
# Names of lights that an error lists, and characters of a name in an asset.
LISTED, LONGEST = 8, 256
# Numbers behind a name, and names that modelling programs give: the material says more.
_NUMBERS = re.compile(r"([\s._-]*\d+)+\Z")
_UNNAMED = re.compile(r"(cube|plane|circle|cylinder|sphere|icosphere|cone|torus|mesh|object|node|default)?\Z", re.I)


@dataclass(frozen=True)
class OwnLight:
    """One emitter of a scene."""

    emitter: int
    """Index into the emitters of the Mitsuba scene."""
    name: str
    """Name of its mesh or light."""
    material: str = ""
    """Name of the material of its mesh."""
    node: str = ""
    """Name of its node in an asset; empty where it has none."""


@dataclass(frozen=True)
class LampGroup:
    """Lights of a scene with one switch, one dimmer and one colour."""

    name: str
    emitters: tuple[int, ...]
    """Indices into the emitters of the Mitsuba scene."""
    nodes: tuple[str, ...]
    """Names of their meshes and lights, as they are written to an asset."""


def own_lights(scene: Scene) -> list[OwnLight]:
    """List the emitters of a scene by name.

    Args:
        scene: The scene.

    Returns:
        One record per emitter, in the order of the Mitsuba scene.
    """
    return [_light(scene, index, emitter) for index, emitter in enumerate(scene.mi.emitters())]


def emitter_sources(scene: Scene) -> list[tuple[str, int]]:
    """Tell what makes each emitter shine.

    Args:
        scene: The scene.

    Returns:
        For each emitter, in the order of the Mitsuba scene: "material" and its index in ``Scene.materials``, "light"
        and its index in ``Scene.lights``, or "other" and its own index.
    """
    found = []
    for index, emitter in enumerate(scene.mi.emitters()):
        mesh, light = _mesh_of(scene, emitter), _number(emitter.id(), "light_", len(scene.lights))
        if mesh is not None:
            found.append(("material", scene.meshes[mesh].material))
        else:
            found.append(("other", index) if light is None else ("light", light))
    return found


def _mesh_of(scene: Scene, emitter: Any) -> int | None:
    """Index of the mesh that an emitter is the light of."""
    shape = emitter.get_shape()
    return None if shape is None else _number(shape.id(), "mesh_", len(scene.meshes))


def _light(scene: Scene, index: int, emitter: Any) -> OwnLight:
    if (number := _mesh_of(scene, emitter)) is not None:
        mesh = scene.meshes[number]
        return OwnLight(index, mesh.name or f"mesh {number}", scene.materials[mesh.material].name, mesh.name)
    if emitter.is_environment():
        return OwnLight(index, ENVIRONMENT)
    number = _number(emitter.id(), "light_", len(scene.lights))
    name = "" if number is None else scene.lights[number].name
    return OwnLight(index, name or f"light {index if number is None else number}", node=name)


def _number(text: str, prefix: str, count: int) -> int | None:
    """The number behind a prefix of an id that ``assemble`` gave, where it is below ``count``."""
    digits = text.removeprefix(prefix)
    return int(digits) if text.startswith(prefix) and digits.isdigit() and int(digits) < count else None


def group_lamps(scene: Scene, rules: LampRules) -> tuple[LampGroup, ...]:
    """Group the scene's own lights.

    Args:
        scene: The scene.
        rules: Which lights belong together.

    Returns:
        The groups, in the order of the rules and then of the scene; none without a light or a switch.

    Raises:
        ValueError: A rule names no light, the scene has none, or there are too many groups.
    """
    lights = own_lights(scene)
    if rules.mode == "none" and not rules.rules:
        return ()
    if not lights and rules.asked:
        raise ValueError(f"lamps: scene '{scene.name}' has no light of its own; leave out --lamps, or add lights to it")
    names: dict[str, list[OwnLight]] = {}
    left = list(lights)
    for rule in rules.rules:
        found = [light for light in left if any(_matches(light, pattern) for pattern in rule.patterns)]
        if not found:
            raise ValueError(_matches_nothing(scene, rule.name, rule.patterns, lights, left))
        names.setdefault(rule.name, []).extend(found)
        left = [light for light in left if light not in found]
    for light in left if rules.mode != "none" else ():
        key = _key(light, rules)[: LONGEST - 8]
        key = _free(key, names) if rules.mode == "each" else key
        names.setdefault(key, []).append(light)
    if len(names) > MOST_LAMPS:
        if rules.asked:
            raise ValueError(
                f"lamps: {len(names)} groups of lights, at most {MOST_LAMPS} can have a switch; "
                "join some with --lamps NAME=PATTERN, or use --lamps all"
            )
        names = {ALL: lights}
    return tuple(_group(name, members) for name, members in names.items())


def _key(light: OwnLight, rules: LampRules) -> str:
    """Name of the group of a light that no rule names."""
    if rules.mode == "all":
        return OTHERS if rules.rules else ALL
    if rules.mode == "each":
        return light.name
    bare = _NUMBERS.sub("", light.name)
    if light.material and (rules.mode == "material" or _UNNAMED.match(bare)):
        return light.material
    return bare or light.name


def _free(name: str, taken: Container[str]) -> str:
    """The name, with a number behind it where it is taken."""
    if name not in taken:
        return name
    return next(free for k in count(2) if (free := f"{name} {k}") not in taken)


def _group(name: str, lights: Sequence[OwnLight]) -> LampGroup:
    nodes = tuple(dict.fromkeys(light.node for light in lights if light.node))
    return LampGroup(name, tuple(light.emitter for light in lights), nodes)


def _matches(light: OwnLight, pattern: str) -> bool:
    return any(fnmatchcase(name.lower(), pattern.lower()) for name in (light.name, light.material) if name)


def _matches_nothing(
    scene: Scene, name: str, patterns: Sequence[str], lights: Sequence[OwnLight], left: Sequence[OwnLight]
) -> str:
    asked = f"lamps: '{name}={','.join(patterns)}'"
    if any(_matches(light, pattern) for light in lights for pattern in patterns):
        return f"{asked} names only lights that a group before it has; give the narrower pattern first"
    known = list(dict.fromkeys(light.name for light in left or lights))
    more = f" and {len(known) - LISTED} more" if len(known) > LISTED else ""
    listed = ", ".join(f"'{name}'" for name in known[:LISTED])
    return f"{asked} matches no light of scene '{scene.name}'; its lights are {listed}{more}"
