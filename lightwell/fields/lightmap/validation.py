"""Held-out points of an error budget of light maps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lightwell.fields.baked import Baked
from lightwell.fields.protocol import Role
from lightwell.networks.losses import EPSILON
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport import draw_surface, indirect, static
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
        points = draw_surface(scene, POINTS, seed, floor=8).points
        if role == "static" or variable is None:
            a, b = static(scene, points, PATHS, seed)
            return LightmapValidation(points, np.zeros(3, np.float32), 0.5 * (a + b))
        light = sample_lights(scene, variable, len(points), seed)
        a, b = indirect(scene, points, light, variable, PATHS, seed)
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
