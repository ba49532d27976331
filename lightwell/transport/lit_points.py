"""Surface points and lights that follow from a scene and a few settings, here and on every worker.

Notation: P points that are drawn, L lights, N = P * repeats rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.placing import held_out_lights, sample_lights
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable, from_json, to_json
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.seen import draw_seen
from lightwell.transport.surface import FLOOR, SurfaceDraw, draw_surface


@dataclass(frozen=True)
class LitPoints:
    """How points and their lights are drawn."""

    variable: Variable | None
    """What the light is; None: no light varies."""
    count: int
    """P."""
    seed: int
    floor: int = FLOOR
    """Points per visible object at least."""
    seen: bool = False
    """Mostly where people look (``draw_seen``); else area-uniform."""
    repeats: int = 1
    """How often the points follow each other."""
    lights: int = 0
    """L; 0: the rows have no light, as those of the scene's own emitters."""
    light_seed: int = 0
    held_out: bool = True
    """Test lights; False: training lights."""
    chained: bool = False
    """Lights in an order in which each is near the one before."""
    core: bool = False
    """Area-uniform in the core of the scene alone; ``seen`` points are chosen without it."""
    run: int = 1
    """Rows one after the other that share a light; when all were used, the lights begin again."""

    def draw(self, scene: Scene) -> SurfaceDraw:
        """Draw the P points, without the backs of one-sided materials.

        Args:
            scene: The scene.

        Returns:
            The points, once, with their weights.
        """
        if self.seen and self.variable is not None:
            return draw_seen(scene, self.variable, self.count, self.seed, floor=self.floor, shown=True)
        return draw_surface(scene, self.count, self.seed, floor=self.floor, core=self.core, shown=True)

    def repeated(self, points: SurfacePoints) -> SurfacePoints:
        """Repeat the points.

        Args:
            points: P points.

        Returns:
            N points.
        """
        return points if self.repeats == 1 else points[np.tile(np.arange(len(points)), self.repeats)]

    def light_of(self, scene: Scene, rows: int) -> np.ndarray:
        """Draw the light of each row.

        Args:
            scene: The scene.
            rows: N.

        Returns:
            [N, 3] float32 positions, metres (directions to a sun); zeros without lights.
        """
        if not self.lights or self.variable is None:
            return np.zeros((rows, 3), np.float32)
        draw = held_out_lights if self.held_out else sample_lights
        lights = draw(scene, self.variable, self.lights, self.light_seed)
        lights = chain(lights) if self.chained else lights
        return lights[np.arange(rows) // self.run % len(lights)]

    def recipe(self, lit: bool = True) -> Recipe:
        """Describe the rows to workers.

        Args:
            lit: False: only the points are traced, under the scene's own emitters.

        Returns:
            The recipe.
        """
        variable = None if self.variable is None else to_json(self.variable)
        return Recipe("lit-points", asdict(self) | {"variable": variable, "lights": self.lights if lit else 0})


def lit_point_inputs(scene: Scene, settings: Mapping[str, Any], arrays: Arrays) -> Inputs:
    """Draw points and their lights; see ``row_recipes.RecipeFunction``.

    Args:
        scene: The scene.
        settings: Fields of ``LitPoints``, as ``LitPoints.recipe`` writes them.
        arrays: Not used.

    Returns:
        Columns of ``SurfacePoints`` and, with lights, ``light`` [N, 3].
    """
    variable = None if settings["variable"] is None else from_json(settings["variable"])
    lit = LitPoints(**{**settings, "variable": variable})
    points = lit.repeated(lit.draw(scene).points)
    light = {"light": lit.light_of(scene, len(points))} if lit.lights else {}
    return Inputs(columns_of(points) | light)


def chain(lights: np.ndarray) -> np.ndarray:
    """Order lights so that each is the nearest of the remaining ones to the one before.

    Args:
        lights: [L, 3] positions or directions.

    Returns:
        [L, 3] the same in order; the first stays first.
    """
    left, order = list(range(1, len(lights))), [0]
    while left:
        nearest = min(left, key=lambda k: float(np.linalg.norm(lights[k] - lights[order[-1]])))
        left.remove(nearest)
        order.append(nearest)
    return lights[order]
