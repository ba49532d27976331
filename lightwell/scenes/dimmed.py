"""A state of a scene's own lamps, for path tracing: emitters dimmed and tinted for a while."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.core.suggest import did_you_mean
from lightwell.scenes.lamps import LampGroup
from lightwell.scenes.scene import Scene

# Ends of the names of the parameters of emitters that say how bright they are.
_BRIGHTNESS = ("radiance.value", "intensity.value", "irradiance.value")
_PICTURES = ("radiance.data", "data")


@contextmanager
def dimmed(scene: Scene, groups: Sequence[LampGroup], factors: Mapping[str, Sequence[float]]) -> Iterator[Scene]:
    """Multiply the emission of groups of lamps, and give it back at the end. Not for several threads.

    Args:
        scene: The scene; its emitters change meanwhile.
        groups: Groups of its lamps.
        factors: Linear red, green and blue by name of a group; the other groups shine as they are.

    Yields:
        The scene.

    Raises:
        ValueError: There is no group of a name.
    """
    named = {group.name: group for group in groups}
    for name in factors:
        if name not in named:
            known = did_you_mean(name, named, f"its lamps are {', '.join(map(repr, named)) or 'none'}")
            raise ValueError(f"set: scene '{scene.name}' has no lamp '{name}'; {known}")
    before: list[tuple[Any, dict[str, Any]]] = []
    try:
        emitters = scene.mi.emitters()
        for name, factor in factors.items():
            for index in named[name].emitters:
                before.append(_scaled(emitters[index], np.asarray(factor, np.float32)))
        yield scene
    finally:
        for parameters, values in before:
            for key, value in values.items():
                parameters[key] = value
            parameters.update()


def _scaled(emitter: Any, factor: np.ndarray) -> tuple[Any, dict[str, Any]]:
    """Scale an emitter; its parameters, and the values that they had."""
    parameters, before = mi.traverse(emitter), {}
    for key in parameters.keys():
        value = parameters[key]
        if key in _BRIGHTNESS:
            before[key] = type(value)(value)
            # A grey spectrum has one number.
            parameters[key] = value * (mi.Color3f(*map(float, factor)) if len(value) == 3 else float(factor.mean()))
        elif key in _PICTURES:
            before[key] = type(value)(value)
            scale = np.ones(value.shape[-1], np.float32)
            scale[:3] = factor[: len(scale[:3])]
            parameters[key] = mi.TensorXf(np.array(value) * scale)
    parameters.update()
    return parameters, before
