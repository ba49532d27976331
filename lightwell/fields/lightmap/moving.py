"""Light maps of a variable light: features on the atlas, and a network whose inputs include the light."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lightwell.core.work import WorkPart
from lightwell.fields.base import FieldSetup
from lightwell.fields.lightmap.fit import MOVING, LightmapFit
from lightwell.fields.lightmap.views import ViewSamples, on_texels, towards_eyes
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable, from_json, to_json
from lightwell.transport.lightmap_query import query_of_lightmap
from lightwell.transport.radiance import indirect
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.surface import draw_surface

# Points that share one position of the light.
POINTS_PER_LIGHT = 32


def moving_samples(scene: Scene, atlas: Atlas, variable: Variable, count: int, paths: int, seed: int) -> ViewSamples:
    """Sample surface points, each with a view and a light, and trace the indirect radiance that leaves them.

    Args:
        scene: The scene.
        atlas: Its atlas.
        variable: Ranges of the light.
        count: Number of points.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the sampler.

    Returns:
        The samples, for a unit light; those that are not finite have weight 0.
    """
    points, light, drawn_weight = _drawn(scene, variable, count, seed)
    recipe = Recipe("moving-points", {"variable": to_json(variable), "count": count, "seed": seed})
    a, b = indirect(scene, points, light, variable, paths, seed, recipe=recipe)
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1) & on_texels(scene, atlas, points)
    weight = np.where(good, drawn_weight, 0).astype(np.float32)
    return ViewSamples(query_of_lightmap(scene, atlas, points, light), np.nan_to_num(a), np.nan_to_num(b), weight)


def _drawn(scene: Scene, variable: Variable, count: int, seed: int) -> tuple[SurfacePoints, np.ndarray, np.ndarray]:
    """Points with their views, their lights [N, 3] and weights [N]."""
    draw = draw_surface(scene, count, seed, floor=64, shown=True)
    points = towards_eyes(scene, draw.points, seed)
    lights = sample_lights(scene, variable, -(-count // POINTS_PER_LIGHT), seed)
    return points, lights.repeat(POINTS_PER_LIGHT, axis=0)[: len(points)], draw.weight


def moving_inputs(scene: Scene, settings: Mapping[str, Any], arrays: Arrays) -> Inputs:
    """Draw the points of ``moving_samples``; see ``row_recipes.RecipeFunction``.

    Args:
        scene: The scene.
        settings: ``variable``, ``count`` and ``seed``.
        arrays: Not used.

    Returns:
        Columns of ``SurfacePoints``, and ``light`` [N, 3].
    """
    points, light, _ = _drawn(scene, from_json(settings["variable"]), settings["count"], settings["seed"])
    return Inputs(columns_of(points) | {"light": light})


def moving_fit(
    scene: Scene,
    atlas: Atlas,
    variable: Variable,
    samples: ViewSamples,
    unit: float,
    seed: int,
    steps: int,
    part: WorkPart | None = None,
    codec: str = "webp",
    progress: Callable[[int], None] | None = None,
) -> LightmapFit:
    """Train the light map of a variable light.

    Args:
        scene: The scene.
        atlas: Its atlas.
        variable: Ranges of the light.
        samples: N samples.
        unit: Radiance unit S.
        seed: Seed of the weights.
        steps: Number of training steps.
        part: Part of the bake that stores checkpoints; None: the training cannot be resumed.
        codec: Codec of the features.
        progress: Called with the number of the step, every 50 steps; see ``LightmapFit.train``.

    Returns:
        The trained light map.
    """
    setup = FieldSetup.of(scene, unit, variable.kind)
    preset = replace(MOVING, codec=codec)
    fit = LightmapFit(preset, atlas.size, unit, seed=seed, mips=atlas.mips, setup=setup)
    fit.train(samples.query, samples.radiance, samples.weight, steps, progress, part)
    return fit
