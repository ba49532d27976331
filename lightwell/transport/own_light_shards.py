"""Shards of the light of the scene's own emitters: shadow rays at the points, and a gather over lit bins.

Whole paths to small emitters are noise that a field fits as spots; the light of a bin is a mean over its surface.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lightwell.core.lamps import LampRules
from lightwell.scenes.lamps import group_lamps
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.adaptive import Predict
from lightwell.transport.gathered_shards import GatherSize
from lightwell.transport.lamp_light import LampLight
from lightwell.transport.queries import frames, make_query
from lightwell.transport.radiosity import Radiosity
from lightwell.transport.samples import Samples, columns_of
from lightwell.transport.seen_shards import ADAPTIVE_STREAM, SeenShards, path_counts, place_columns
from lightwell.transport.shards import LightsFn, Make, ShardSettings, shard_seeds

# Rays of a point relative to one of a moving light: each point is used once, and many are worth more than exact ones.
RAYS_SHARE = 4
# Shadow rays of each half of a point.
SHADOW_RAYS = 8


class OwnLightShards(SeenShards):
    """Makes shards of the scene's own light; bins and points are found when the first one is made."""

    _stream = 0x6B

    def __init__(self, scene: Scene, variable: Variable, settings: ShardSettings, size: GatherSize) -> None:
        """Prepare to make shards; nothing is traced yet.

        Args:
            scene: A scene with emitters.
            variable: The declared light; people look where it may be.
            settings: Sizes and seed.
            size: Points that shards choose from, bins, and rays of a point of a moving light.
        """
        super().__init__(scene, variable, settings, size.points)
        self._size = size
        self._rays = max(size.rays // RAYS_SHARE // 2 * 2, 2)

    @cached_property
    def _light(self) -> LampLight:
        radiosity = Radiosity(self._scene, self.points, int(self._seeds[1]), self._size.bins)
        return LampLight(radiosity, group_lamps(self._scene, LampRules("all")), int(self._seeds[2]))

    def __call__(
        self, scene: Scene, variable: Variable, lights_fn: LightsFn | None, settings: ShardSettings, index: int
    ) -> tuple[dict[str, np.ndarray], dict]:
        """As ``make_shard``: the next points, and when all were used, the same ones with other rays."""
        chosen = self.points[(np.arange(settings.size) + index * settings.size) % len(self.points)]
        shares = self._light.shares(chosen, self._rays, shard_seeds(settings, index)[2], SHADOW_RAYS)
        query = make_query(self._scene, chosen, np.zeros(3, np.float32))
        columns = columns_of(query)
        columns |= {"half_a": shares.half_a[:, 0], "half_b": shares.half_b[:, 0]}
        columns |= place_columns(chosen, np.ones(settings.size, np.float32), frames(self._scene, chosen)[2])
        return columns, path_counts(settings.size * self._rays)

    def adaptive(self, known: Samples, predict: Predict) -> Make:
        """Make the function for more shards; they are as the others, with numbers of their own.

        Args:
            known: Not used.
            predict: Not used.

        Returns:
            Makes a shard, as ``make_shard`` does.
        """
        return lambda scene, variable, lights_fn, settings, index: self(
            scene, variable, lights_fn, settings, ADAPTIVE_STREAM + index
        )
