"""States of light that a volume is traced for: a declared light at several places, or the scene's own light, of one
group of lamps after the other or in several poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable


@dataclass(frozen=True)
class OwnStates:
    """S states of the scene's own light."""

    scenes: tuple[Scene, ...]
    """[S] the scene in each state: other poses of what moves."""
    emitters: tuple[tuple[int, ...], ...]
    """[S] indices of the emitters that shine; empty: all of them."""

    def __len__(self) -> int:
        """Return S."""
        return len(self.scenes)


Lights = np.ndarray | OwnStates | None
"""[S, 3] positions (or directions) of a declared light, states of the scene's own, or None: that as it is."""


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
    if isinstance(lights, OwnStates):
        return [LightState(at, None, None, found) for at, found in zip(lights.scenes, lights.emitters)]
    if lights is None:
        return [LightState(scene, None, None, ())]
    return [LightState(scene, variable, at, ()) for at in lights]
