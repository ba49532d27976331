"""How a baked volume and the baselines answer at places that took no part in the solve: for the report.

The places are in the air, asked without an offset; all methods have the same probes, traced the same way.
"""

from __future__ import annotations

import numpy as np

from lightwell.probes import ddgi, line_of_sight, sh
from lightwell.probes.assemble import plain
from lightwell.probes.bake import Geometry
from lightwell.probes.metrics import score
from lightwell.probes.trace import air_light
from lightwell.probes.volume import query
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable

PLACES, PATHS = 600, 128


def compare(
    scene: Scene,
    geometry: Geometry,
    light: np.ndarray,
    start: np.ndarray,
    seed: int,
    variable: Variable | None = None,
    place: np.ndarray | None = None,
) -> dict[str, dict[str, float]]:
    """Method to its errors (sMAPE in [0, 1], leaks as shares of the light).

    light   [P + F, 9, 3] solved light; ``start`` [P + F, 9, 3]: as traced, which the baselines interpolate. Both under
            the scene's own light, or under a light of ``variable`` at ``place`` [3].
    """
    support, count = geometry.support, len(geometry.volume.lattice)
    start = start[:count] * support.stands[:, None, None]
    rng = np.random.default_rng((seed, 99))
    cells, points = np.nonzero(support.valid)
    # The solve takes the first valid points of a cell.
    late = np.flatnonzero(points >= support.valid.shape[1] // 2)
    chosen = rng.choice(late, min(PLACES, len(late)), replace=False)
    if not len(chosen):
        return {}
    x = support.points(support.covered[cells[chosen]])[np.arange(len(chosen)), points[chosen]]
    n = sh.directions(len(x))[rng.permutation(len(x))]
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
