"""Held-out points of an error budget of light maps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lightwell.fields.baked import Baked
from lightwell.fields.protocol import Role
from lightwell.networks.losses import EPSILON
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport import indirect, static
from lightwell.transport.lit_points import LitPoints
from lightwell.transport.samples import SurfacePoints

if TYPE_CHECKING:
    from lightwell.fields.lightmap.state import FittedLightmap

# Their number, seed and paths.
POINTS, SEED, PATHS = 4096, 0xA11D, 256


@dataclass(frozen=True)
class LightmapValidation:
    """Held-out surface points and the radiance that leaves them."""

    points: SurfacePoints
    light: np.ndarray
    """[3] or [N, 3]."""
    radiance: np.ndarray
    """[N, 3]."""

    @staticmethod
    def of(scene: Scene, variable: Variable | None, seed: int, role: Role) -> LightmapValidation:
        """Trace the points.

        Args:
            scene: The scene.
            variable: Ranges of the light; None: no light varies.
            seed: Seed of the bake.
            role: Part of the light.

        Returns:
            The points and their radiance.
        """
        seed += SEED
        moving = role != "static" and variable is not None
        lights = POINTS if moving else 0
        lit = LitPoints(variable, POINTS, seed, floor=8, lights=lights, light_seed=seed, held_out=False)
        points = lit.draw(scene).points
        if not moving:
            a, b = static(scene, points, PATHS, seed, recipe=lit.recipe())
            return LightmapValidation(points, np.zeros(3, np.float32), 0.5 * (a + b))
        light = lit.light_of(scene, len(points))
        a, b = indirect(scene, points, light, variable, PATHS, seed, recipe=lit.recipe())
        return LightmapValidation(points, light, 0.5 * (a + b))

    def error(self, fit: FittedLightmap) -> float:
        """Compute the mean |f − y| / (y + 0.01) in unit S of the graph that would be written.

        Args:
            fit: The light map.

        Returns:
            The error.
        """
        lowered = fit.lower()
        f = Baked(lowered.graph, lowered.frame)(fit.query(self.points, self.light)) / fit.unit
        y = np.nan_to_num(self.radiance) / fit.unit
        return float(np.mean(np.abs(f - y) / (y + EPSILON)))
