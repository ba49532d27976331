"""Functions that make the inputs of traced rows again from a scene: what travels to other machines in their place.

A function takes the scene, its settings (JSON values) and arrays, and returns the columns of all rows of a call and the
arrays that they share. Workers compare digests: a recipe that makes other bytes costs time, never a wrong result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

import numpy as np

from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.scene import Scene

RecipeFunction = Callable[[Scene, Mapping[str, Any], Arrays], Inputs]
"""(scene, settings, arrays) -> the inputs of all rows."""

RECIPES = {
    "pixels": "lightwell.transport.row_recipes:numbered_pixels",
    "lit-points": "lightwell.transport.lit_points:lit_point_inputs",
    "camera-points": "lightwell.transport.camera:camera_inputs",
    "seen-bins": "lightwell.transport.seen_shards:seen_inputs",
    "patches": "lightwell.baking.quality:patch_inputs",
    "air-points": "lightwell.probes.trace:air_inputs",
    "texels": "lightwell.transport.texels:texel_inputs",
    "sides": "lightwell.fields.lightmap.sides:side_inputs",
    "moving-points": "lightwell.fields.lightmap.moving:moving_inputs",
    "eye-points": "lightwell.fields.lightmap.views:eye_inputs",
}
"""Place of each function, ``module:name``."""


def inputs_of(scene: Scene, recipe: Recipe) -> Inputs:
    """Make the inputs of a call.

    Args:
        scene: The scene.
        recipe: Function, settings and arrays.

    Returns:
        The columns [N, ...] of all rows, and what they share.
    """
    module, name = RECIPES[recipe.name].split(":")
    function: RecipeFunction = getattr(import_module(module), name)
    return function(scene, recipe.settings, recipe.arrays)


def numbered_pixels(scene: Scene, settings: Mapping[str, Any], arrays: Arrays) -> Inputs:
    """Number the pixels of a picture.

    Args:
        scene: Not used.
        settings: ``count``, N pixels.
        arrays: Not used.

    Returns:
        ``pixel`` [N].
    """
    return Inputs({"pixel": np.arange(settings["count"], dtype=np.uint32)})
