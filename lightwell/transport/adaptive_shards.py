"""Shards of the adaptive stage: samples where the residual of a fit is large, in the format of all other shards."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.adaptive import Predict, ResidualDensity, mixture, residual_density
from lightwell.transport.point_rejection import Rejection
from lightwell.transport.samples import Samples
from lightwell.transport.shards import (
    POOL_SHARDS,
    LightsFn,
    ShardSettings,
    default_lights,
    shard_columns,
    shard_seeds,
    surface_pool,
)

# Added to the index of an adaptive shard, so that it shares no random number with the area-uniform ones.
ADAPTIVE_STREAM = 1 << 20
# The residual is measured on at most this many of the known samples.
MOST_JUDGED = 1 << 18


class AdaptiveShards:
    """Makes shards in which half of the samples lie where a fit has a large residual at the known samples.

    The residual is measured once, when the first shard is made: on samples that the fit was trained on, which a network
    of a few thousand weights cannot memorise.
    """

    def __init__(self, scene: Scene, known: Samples, predict: Predict, *, own_light: bool = False) -> None:
        """Prepare shards for one scene and one fit.

        Args:
            scene: Scene to sample.
            known: Samples on which the residual is measured.
            predict: The fitted field.
            own_light: Gather the light of the scene's own emitters instead of the declared light's.
        """
        self._scene, self._known, self._predict, self._own_light = scene, known[:MOST_JUDGED], predict, own_light

    @cached_property
    def _density(self) -> ResidualDensity:
        return residual_density(self._scene, self._known, self._predict(self._known.query))

    def __call__(
        self, scene: Scene, variable: Variable, lights_fn: LightsFn | None, settings: ShardSettings, index: int
    ) -> tuple[dict[str, np.ndarray], dict]:
        """Make one shard, as ``make_shard`` does."""
        mix_seed, light_seed, path_seed = shard_seeds(settings, ADAPTIVE_STREAM + index)
        pool = surface_pool(scene, variable, settings, index // POOL_SHARDS)
        lights = (lights_fn or default_lights(scene, variable))(settings.lights, light_seed)
        points, light, weight = mixture(scene, self._density, pool, lights, settings.size, mix_seed)
        return shard_columns(
            scene, variable, points, light, weight, settings, path_seed, Rejection(), own_light=self._own_light
        )
