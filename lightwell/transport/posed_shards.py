"""Shards of a scene whose movers take several poses: as many rows of each pose, made in the scene that stands so."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lightwell.scenes.posing import posed
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.adaptive import Predict
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.moved import poses_of, with_rest
from lightwell.transport.own_light_shards import OwnLightShards
from lightwell.transport.samples import Query, Samples, columns_of
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import LightsFn, Make, ShardSettings

# Added to the seed of the shards, so that no two poses share a random number.
POSE_SEEDS = 1 << 20


class PosedShards:
    """Makes shards whose rows are divided evenly among poses, one pose after the other."""

    def __init__(
        self,
        scene: Scene,
        variable: Variable,
        settings: ShardSettings,
        size: Callable[[ShardSettings], GatherSize],
        kind: type[GatheredShards] | type[OwnLightShards],
        poses: Sequence[Sequence[float]],
    ) -> None:
        """Prepare to make shards; nothing is traced yet.

        Args:
            scene: Scene with M movers.
            variable: The declared light; people look where it may be.
            settings: Sizes and seed; ``lights`` is a multiple of the number of poses.
            size: How much is traced before the first shard of a pose, from the settings of the pose.
            kind: Makes the shards of a pose.
            poses: K poses of M sliders, 0 to 1.

        Raises:
            ValueError: The scene has no mover, or its lights cannot be divided among the poses.
        """
        if not scene.movers or settings.lights % len(poses):
            raise ValueError(f"samples: {settings.lights} lights of a shard cannot be divided among {len(poses)} poses")
        self._poses, self._scene = [tuple(map(float, pose)) for pose in poses], scene
        part = replace(settings, lights=settings.lights // len(poses), floor=max(settings.floor // len(poses), 1))
        self._settings = [replace(part, seed=settings.seed + k * POSE_SEEDS) for k in range(len(poses))]
        self._makers = [
            kind(posed(scene, pose), variable, own, size(own)) for pose, own in zip(self._poses, self._settings)
        ]

    @property
    def most(self) -> int | None:
        """Shards that hold all that there is; None: no limit."""
        limits = [maker.most for maker in self._makers if maker.most is not None]
        return max(limits, default=None)

    def __call__(
        self, scene: Scene, variable: Variable, lights_fn: LightsFn | None, settings: ShardSettings, index: int
    ) -> tuple[dict[str, np.ndarray], dict]:
        """As ``make_shard``."""
        return self._joined(self._makers, variable, index)

    def adaptive(self, known: Samples, predict: Predict) -> Make:
        """Make the function for more shards, each pose by the residual of its own samples.

        Args:
            known: Samples on which the residual is measured.
            predict: The fitted field.

        Returns:
            Makes a shard, as ``make_shard`` does.
        """
        at = np.asarray(known.query.pose)
        makes = []
        for k, maker in enumerate(self._makers):
            own = known[np.flatnonzero((at == np.float32(self._poses[k])).all(axis=1))]
            makes.append(maker.adaptive(own, predict))
        return lambda scene, variable, lights_fn, settings, index: self._joined(makes, variable, index)

    def _joined(self, makes: Sequence[Make], variable: Variable, index: int) -> tuple[dict[str, np.ndarray], dict]:
        """The rows of all poses and the sum of their counts."""
        parts, counts = [], dict[str, Any]()
        for make, pose, settings in zip(makes, self._poses, self._settings):
            columns, found = make(posed(self._scene, pose), variable, None, settings, index)
            parts.append(columns | self._rest(columns, pose))
            counts = {name: _sum(counts.get(name), values) for name, values in found.items()}
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}, counts

    def _rest(self, columns: dict[str, np.ndarray], pose: Sequence[float]) -> dict[str, np.ndarray]:
        """The columns that say in which pose rows are, and where they are at rest."""
        query = Query(**{name: columns[name] for name in Query.__dataclass_fields__ if name in columns})
        at = poses_of(len(query), pose)
        found = columns_of(with_rest(self._scene.movers, query, columns["shape"], at))
        return {name: found[name] for name in ("pose", "rest_position", "rest_normal")}


def _sum(before: Any, more: Any) -> Any:
    """Add counts by name."""
    if isinstance(more, dict):
        return {name: _sum((before or {}).get(name), value) for name, value in more.items()}
    return more if before is None else before + more
