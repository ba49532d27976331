"""Compares a baked volume with the baselines at places that the solve has not seen; for the report.

The places lie in air and are looked up without an offset. All methods use the same probes, traced in the same
way.
"""

from __future__ import annotations

import numpy as np

from lightwell.probes import ddgi, line_of_sight, sh
from lightwell.probes.assemble import plain
from lightwell.probes.bake import Geometry
from lightwell.probes.metrics import score
from lightwell.probes.support import Support
from lightwell.probes.trace import air_light
from lightwell.probes.volume import query
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable

PLACES, PATHS = 600, 128


def held_out(support: Support, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Choose places in air that no fit has samples at: those take the first valid points of a cell.

    Args:
        support: Points in air.
        seed: Seed of places and normals.

    Returns:
        [N, 3] places, metres, and [N, 3] unit normals; none where the scene has no air.
    """
    rng = np.random.default_rng((seed, 99))
    cells, points = np.nonzero(support.valid)
    late = np.flatnonzero(points >= support.valid.shape[1] // 2)
    chosen = rng.choice(late, min(PLACES, len(late)), replace=False)
    x = support.points(support.covered[cells[chosen]])[np.arange(len(chosen)), points[chosen]]
    return x, sh.directions(len(x))[rng.permutation(len(x))]


def compare(
    scene: Scene,
    geometry: Geometry,
    light: np.ndarray,
    start: np.ndarray,
    seed: int,
    variable: Variable | None = None,
    place: np.ndarray | None = None,
) -> dict[str, dict[str, float]]:
    """Measure the errors of the volume and of the baselines.

    Args:
        scene: The scene.
        geometry: The baked weights.
        light: [P + F, 9, 3] solved light, which the volume interpolates.
        start: [P + F, 9, 3] traced light, which the baselines interpolate.
        seed: Seed of the places, normals and reference.
        variable: Declared light under which ``light`` and ``start`` were computed; None for the scene's own
            emitters.
        place: [3] position (or direction) of the declared light.

    Returns:
        By method: ``smape`` in [0, 1], and ``bright_leak`` and ``dark_leak`` as fractions of the light. Empty when
        there are no places in air.
    """
    support, count = geometry.support, len(geometry.volume.lattice)
    start = start[:count] * support.stands[:, None, None]
    x, n = held_out(support, seed)
    if not len(x):
        return {}
    truth = air_light(scene, x, PATHS, seed + 977, variable=variable, light=place).sh
    truth = np.maximum(sh.evaluate(truth, n), 0)
    ask = lambda volume: query(volume.in_air(), x, n)[0]  # noqa: E731
    found = {
        "learned": ask(geometry.volume.lit(light)),
        "trilinear": ask(plain(support, False).lit(start)),
        "trilinear + validity": ask(plain(support, True).lit(start)),
        "DDGI": ddgi.query(ddgi.bake_moments(scene, support, start, 0.0), x, n),
        "line of sight": line_of_sight.query(scene, support, start, x, n, 0.0),
    }
    region = np.zeros(len(x), int)
    scores = {name: score(truth, values, region) for name, values in found.items()}
    return {
        name: {"smape": round(s.smape, 4), "bright_leak": round(s.bright, 4), "dark_leak": round(s.dark, 4)}
        for name, s in scores.items()
    }
