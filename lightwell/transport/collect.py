"""Training and test samples: surface points, one light each, and the path-traced indirect radiance."""

from __future__ import annotations

import numpy as np

from lightwell.scenes.executor import Recipe
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.paths import MAX_DEPTH, RR_DEPTH
from lightwell.transport.queries import make_query
from lightwell.transport.radiance import PathReport, indirect, static
from lightwell.transport.samples import Samples, SurfacePoints, columns_of


def collect(
    scene: Scene,
    variable: Variable,
    points: SurfacePoints,
    light: np.ndarray,
    paths: int,
    seed: int,
    *,
    weight: np.ndarray | None = None,
    own_light: bool = False,
    max_depth: int = MAX_DEPTH,
    rr_depth: int = RR_DEPTH,
    report: PathReport | None = None,
    recipe: Recipe | None = None,
) -> Samples:
    """Trace samples at points, each lit by its own light: ``indirect`` and ``make_query`` together.

    A sample none of whose paths is finite is kept, so that rows keep their order, with radiance 0 and weight 0.

    Args:
        scene: Scene to trace.
        variable: The declared light.
        points: N points.
        light: [N, 3] or [3] positions of the light, metres (directions of a sun).
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the paths.
        weight: [N] weights of the points (``SurfaceDraw.weight``); None: 1.
        own_light: Gather the light of the scene's own emitters (``static``) instead; the declared light is off.
        max_depth: Longest path, 2 = direct light only.
        rr_depth: Depth from which Russian roulette may end a path.
        report: Receives the path counts.
        recipe: How workers make points and lights again; None: they are sent.

    Returns:
        N samples.
    """
    options = {"max_depth": max_depth, "rr_depth": rr_depth, "report": report, "recipe": recipe}
    if own_light:
        a, b = static(scene, points, paths, seed, **options)
    else:
        a, b = indirect(scene, points, light, variable, paths, seed, **options)
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    weight = np.ones(len(points), np.float32) if weight is None else np.asarray(weight, np.float32)
    return Samples(
        query=make_query(scene, points, light),
        half_a=np.where(good[:, None], a, 0),
        half_b=np.where(good[:, None], b, 0),
        weight=np.where(good, weight, 0).astype(np.float32),
        shape=np.asarray(points.shape, np.uint32),
    )


def join(parts: list[Samples]) -> Samples:
    """Join samples, in order.

    Args:
        parts: At least one set of samples.

    Returns:
        All rows in one ``Samples``.
    """
    rows = {name: np.concatenate([getattr(p, name) for p in parts]) for name in ("half_a", "half_b", "weight", "shape")}
    names = columns_of(parts[0].query)
    columns = {name: np.concatenate([getattr(p.query, name) for p in parts]) for name in names}
    return Samples(query=type(parts[0].query)(**columns), **rows)
