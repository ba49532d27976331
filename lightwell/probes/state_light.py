"""Light in the air in all states of some light: gathered once where the light moves, else path traced for each.

Notation: N points, S states.
"""

from __future__ import annotations

import numpy as np

from lightwell.probes.gathered import gathered_light, gathers
from lightwell.probes.states import Lights, LightState, states_of
from lightwell.probes.trace import air_light
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable

# Fewer states of a light in one pose of a scene are path traced: bins cost more than they save.
FEWEST_GATHERED = 3
# Bytes of light that are traced at a time, about: 256 places of a light have 55 kB at a point. 24,000 points took 6.9
# GB at once, and take 1.7 GB in parts, of which 0.7 GB are the result, in the same time.
AT_ONCE = 1 << 27


def light_of_states(
    scene: Scene,
    points: np.ndarray,
    paths: int,
    seed: int,
    numbers: np.ndarray,
    direct: bool = True,
    variable: Variable | None = None,
    lights: Lights = None,
) -> np.ndarray:
    """Trace the light at points in air in all states.

    Args:
        scene: The scene.
        points: [N, 3] points, metres.
        paths: Paths per point, even and ≥ 2; where a light moves, rays that all its places share.
        seed: Seed of the paths.
        numbers: [N] random streams of the points.
        direct: Include the light that arrives straight from the scene's own emitters.
        variable: Declared light of 1 cd (1 lx); None for the scene's own emitters.
        lights: [S, 3] positions (or directions) of the declared light, or states of the scene's own; None: as it is.

    Returns:
        [2, S, N, 9, 3] float32 irradiance harmonics by each half of the paths.
    """
    states, out = states_of(scene, variable, lights), None
    for rows in _in_one_pose(states):
        first = states[rows[0]]
        gathered = None
        if variable is not None and gathers(first.variable) and len(rows) >= FEWEST_GATHERED:
            places = np.float32([states[k].light for k in rows])
            more = {"variable": variable, "lights": places, "numbers": numbers}
            gathered = gathered_light(first.scene, points, paths, seed + int(rows[0]), **more)
            if len(rows) == len(states):
                # Where nothing moves but the light, all there is.
                return gathered
        if out is None:
            out = np.empty((2, len(states), len(points), 9, 3), np.float32)
        if gathered is not None:
            out[:, rows] = gathered
            continue
        for k in rows:
            s, calls = states[k], len(states) - int(k)
            more = {"numbers": numbers, "direct": direct, "emitters": s.emitters, "calls": calls}
            found = air_light(s.scene, points, paths, seed + int(k), variable=s.variable, light=s.light, **more)
            out[0, k], out[1, k] = found.half_a, found.half_b
    assert out is not None
    return out


def points_at_once(lights: Lights, at_once: int = AT_ONCE) -> int:
    """Compute how many points are traced at a time; what is traced of a point does not depend on the others.

    Args:
        lights: As for ``light_of_states``.
        at_once: Bytes of their light, about.

    Returns:
        Number of points, ≥ 1.
    """
    of_point = 2 * (1 if lights is None else len(lights)) * 27 * np.dtype(np.float32).itemsize
    return max(at_once // of_point, 1)


def _in_one_pose(states: list[LightState]) -> list[np.ndarray]:
    """Indices of the states of each pose of the scene."""
    pose = np.unique([id(s.scene) for s in states], return_inverse=True)[1]
    return [np.flatnonzero(pose == k) for k in sorted(set(pose), key=list(pose).index)]
