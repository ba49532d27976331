"""A state of a scene's own lamps, for path tracing: emitters dimmed and tinted for a while."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.core.suggest import did_you_mean
from lightwell.scenes.lamps import LampGroup
from lightwell.scenes.scene import Scene

# Ends of the names of the parameters of emitters that say how bright they are.
_BRIGHTNESS = ("radiance.value", "intensity.value", "irradiance.value")
_PICTURES = ("radiance.data", "irradiance.data", "data")
# ... and those of emitters whose colours are computed, ``sunsky``: numbers.
_SCALES = ("sky_scale", "sun_scale")
# May stand before the name of a lamp, as ``node:`` does before that of a node.
LAMP_PREFIX = "lamp:"


@contextmanager
def dimmed(scene: Scene, groups: Sequence[LampGroup], factors: Mapping[str, Sequence[float]]) -> Iterator[Scene]:
    """Multiply the emission of groups of lamps, and give it back at the end. Not for several threads.

    Args:
        scene: The scene; its emitters change meanwhile.
        groups: Groups of its lamps.
        factors: Linear red, green and blue by name of a group, or by ``lamp:NAME``; the other groups shine as they are.

    Yields:
        The scene.

    Raises:
        ValueError: There is no group of a name.
    """
    named = {group.name: group for group in groups}
    factors = {name if name in named else name.removeprefix(LAMP_PREFIX): factor for name, factor in factors.items()}
    for name in factors:
        if name not in named:
            raise ValueError(f"set: scene '{scene.name}' has no lamp '{name}'; {_cure(scene, name, named)}")
    before: list[tuple[Any, dict[str, Any]]] = []
    try:
        emitters = scene.mi.emitters()
        for name, factor in factors.items():
            for index in named[name].emitters:
                before.append(_scaled(emitters[index], np.asarray(factor, np.float32)))
        scene.cache.relit += 1
        yield scene
    finally:
        for parameters, values in before:
            for key, value in values.items():
                parameters[key] = value
            parameters.update()
        scene.cache.relit += 1


def _cure(scene: Scene, name: str, named: Iterable[str]) -> str:
    """What to write in place of a name that is no lamp's."""
    if any(node.name == name for node in scene.nodes):
        return f'it is a node, which moves by --set "node:{name}.rotation=45" or "node:{name}.translation=(0,0,0.6)"'
    return did_you_mean(name, named, f"its lamps are {', '.join(map(repr, named)) or 'none'}")


def _scaled(emitter: Any, factor: np.ndarray) -> tuple[Any, dict[str, Any]]:
    """Scale an emitter; its parameters, and the values that they had."""
    parameters, before = mi.traverse(emitter), {}
    for key in parameters.keys():
        value = parameters[key]
        if key in _BRIGHTNESS:
            before[key] = type(value)(value)
            # A grey spectrum has one number.
            parameters[key] = value * (mi.Color3f(*map(float, factor)) if len(value) == 3 else float(factor.mean()))
        elif key in _SCALES:
            before[key] = type(value)(value)
            parameters[key] = value * float(factor.mean())
        elif key in _PICTURES:
            before[key] = type(value)(value)
            scale = np.ones(value.shape[-1], np.float32)
            scale[:3] = factor[: len(scale[:3])]
            parameters[key] = mi.TensorXf(np.array(value) * scale)
    parameters.update()
    return parameters, before
