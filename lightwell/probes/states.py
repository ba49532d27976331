"""States of light that a volume is traced for: a declared light at several places, the scene's own light of one group
of lamps after the other, either of them in several poses of what moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable


@dataclass(frozen=True)
class JointStates:
    """S states of several variables together."""

    scenes: tuple[Scene, ...]
    """[S] the scene in each state: other poses of what moves."""
    emitters: tuple[tuple[int, ...], ...] = ()
    """[S] indices of the scene's own emitters that shine; empty: all of them, in every state."""
    lights: np.ndarray | None = None
    """[S, 3] positions (or directions) of the declared light; None: the scene's own light."""

    def __len__(self) -> int:
        """Return S."""
        return len(self.scenes)


Lights = np.ndarray | JointStates | None
"""[S, 3] positions (or directions) of a declared light, states of several variables, or None: the scene's own light as
it is."""


@dataclass(frozen=True)
class LightState:
    """One state."""

    scene: Scene
    variable: Variable | None
    """Declared light; None: the scene's own emitters."""
    light: np.ndarray | None
    """[3] position (or direction) of the declared light."""
    emitters: tuple[int, ...]
    """Emitters that shine; empty: all of the scene's own."""


def states_of(scene: Scene, variable: Variable | None, lights: Lights) -> list[LightState]:
    """List the states of some light.

    Args:
        scene: The scene.
        variable: Declared light; None for the scene's own emitters.
        lights: The states; None: the one of the scene's own emitters.

    Returns:
        S states.
    """
    if isinstance(lights, JointStates):
        emitters = lights.emitters or ((),) * len(lights)
        if lights.lights is None:
            return [LightState(at, None, None, found) for at, found in zip(lights.scenes, emitters)]
        return [LightState(at, variable, light, ()) for at, light in zip(lights.scenes, lights.lights)]
    if lights is None:
        return [LightState(scene, None, None, ())]
    return [LightState(scene, variable, at, ()) for at in lights]
