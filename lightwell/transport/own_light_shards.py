"""Shards of the light of the scene's own emitters: shadow rays at the points, and a gather over lit bins.

Whole paths to small emitters are noise that a field fits as spots; the light of a bin is a mean over its surface. The
rays of the gather are those of a moving light: they cost nothing where that was sampled before.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lightwell.core.lamps import LampRules
from lightwell.scenes.lamps import group_lamps
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable, has_sky
from lightwell.transport.adaptive import Predict
from lightwell.transport.gather_sums import Gather
from lightwell.transport.lamp_light import LampLight
from lightwell.transport.queries import frames, make_query
from lightwell.transport.samples import Samples, columns_of
from lightwell.transport.seen_shards import ADAPTIVE_STREAM, SeenShards, path_counts, place_columns, without_spikes
from lightwell.transport.shards import LightsFn, Make, ShardSettings, shard_seeds
from lightwell.transport.sky_source import CELLS

# Rays of a gathered point for each one that looks for emitters by the BSDF.
RAYS_SHARE = 4
# Shadow rays of each half of a point.
SHADOW_RAYS = 8
# Random stream of the light of the bins.
LIGHT_STREAM = 0x6B


class OwnLightShards(SeenShards):
    """Makes shards of the scene's own light; points, rays and bins are found when the first one is made."""

    @property
    def most(self) -> int | None:
        """Shards that hold all that there is: more have the same points and rays."""
        return max(self._size.points // self._settings.size, 1)

    @property
    def _rays(self) -> int:
        """Rays of a point that look for emitters."""
        return max(self._size.rays // RAYS_SHARE // 2 * 2, 2)

    @cached_property
    def _light(self) -> LampLight:
        seed = np.random.SeedSequence([self._settings.seed, LIGHT_STREAM]).generate_state(1)
        return LampLight(self.seen.radiosity, group_lamps(self._scene, LampRules("all")), int(seed[0]))

    @cached_property
    def _gather(self) -> Gather:
        lit = self._light.irradiance
        # The sky behind the bins is that of the moving light.
        behind = np.zeros((1, CELLS if has_sky(self._variable) else 0, 3), np.float32)
        return Gather(self.seen.rows, np.concatenate([lit, behind], axis=1))

    def _prepare(self) -> None:
        """Trace what all shards share, and light it."""
        self._gather  # noqa: B018

    def __call__(
        self, scene: Scene, variable: Variable, lights_fn: LightsFn | None, settings: ShardSettings, index: int
    ) -> tuple[dict[str, np.ndarray], dict]:
        """As ``make_shard``: the next points, and when all were used, the same ones with other shadow rays."""
        rows = (np.arange(settings.size) + index * settings.size) % len(self.points)
        chosen = self.points[rows]
        own = self._light.direct(chosen, self._rays, shard_seeds(settings, index)[2], SHADOW_RAYS)
        half_a, half_b = self._gather(rows, np.zeros(len(rows), np.uint32))
        columns = columns_of(make_query(self._scene, chosen, np.zeros(3, np.float32)))
        halves = without_spikes(half_a + own.half_a[:, 0], half_b + own.half_b[:, 0], len(rows))
        columns |= {"half_a": halves[0], "half_b": halves[1]}
        columns |= place_columns(chosen, np.ones(settings.size, np.float32), frames(self._scene, chosen)[2])
        return columns, path_counts(settings.size * self._rays + (len(self.points) * self._size.rays) * (index == 0))

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
