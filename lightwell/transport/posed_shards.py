"""Shards of a scene whose movers take several poses: as many rows of each pose, made in the scene that stands so."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.scenes.movers import Pose, sobol_poses
from lightwell.scenes.posing import posed
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.adaptive import Predict, relative_residual
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.moved import poses_of, with_rest
from lightwell.transport.own_light_shards import OwnLightShards
from lightwell.transport.samples import Query, Samples, columns_of
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import LightsFn, Make, ShardSettings

# Added to the seed of the shards, so that no two poses share a random number.
POSE_SEEDS = 1 << 20
NEXT_SEED, TINY = 0xADD, 1e-9


# One pose is added in the adaptive stage for so many that were traced before; places for one that are compared.
ADDED, CANDIDATES = 4, 256


@dataclass(frozen=True)
class _OfPose:
    """What makes the rows of one pose."""

    pose: Pose
    settings: ShardSettings
    maker: GatheredShards | OwnLightShards
    make: Make
    """``maker``, or its adaptive function."""


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
        looked: Variable | None = None,
        pose_seconds: float = 0.0,
    ) -> None:
        """Prepare to make shards; nothing is traced yet.

        Args:
            scene: Scene with M movers.
            variable: The declared light.
            settings: Sizes and seed; ``lights`` is a multiple of the number of poses.
            size: How much is traced before the first shard of a pose, from the settings of the pose.
            kind: Makes the shards of a pose.
            poses: K poses of M sliders, 0 to 1. The random numbers of a pose depend on its place among them.
            looked: People look where this light may be, see ``SeenShards``; None: where the declared light may be.
            pose_seconds: Known time of a pose whose rays are not traced yet.

        Raises:
            ValueError: The scene has no mover, or its lights cannot be divided among the poses.
        """
        if not scene.movers or settings.lights % len(poses):
            raise ValueError(f"samples: {settings.lights} lights of a shard cannot be divided among {len(poses)} poses")
        self._scene, self._variable, self._settings, self._size, self._kind = scene, variable, settings, size, kind
        self._looked, self._pose_seconds = looked, pose_seconds
        self._poses = [tuple(map(float, pose)) for pose in poses]
        self._of_poses = [self._of_pose(pose, k, len(poses)) for k, pose in enumerate(self._poses)]
        self._preparing = 0.0

    def _of_pose(self, pose: Pose, number: int, of: int) -> _OfPose:
        """What makes the rows of a pose, one of so many that a shard has."""
        part = replace(self._settings, lights=self._settings.lights // of, floor=max(self._settings.floor // of, 1))
        own = replace(part, seed=self._settings.seed + number * POSE_SEEDS)
        maker = self._kind(posed(self._scene, pose), self._variable, own, self._size(own), self._looked)
        return _OfPose(pose, own, maker, maker)

    def prepare(self, number: int) -> float:
        """Trace what the shards of one pose share, unless it is known.

        Args:
            number: Index of the pose.

        Returns:
            Seconds that it took.
        """
        return self._of_poses[number].maker.prepare()

    @property
    def most(self) -> int | None:
        """Shards that hold all that there is; None: no limit."""
        limits = [limit for of in self._of_poses if (limit := of.maker.most) is not None]
        return max(limits, default=None)

    @property
    def paths(self) -> int:
        """Paths of a sample, as of the shards of each pose."""
        return self._of_poses[0].maker.paths

    @property
    def before_adaptive(self) -> float:
        """Seconds before the first adaptive shard: those of the poses that are added, by what the first ones took.

        The rays of the first ones may have been traced for another light; those of added poses are not.
        """
        return max(self._preparing / len(self._poses), self._pose_seconds) * self._added

    @property
    def _added(self) -> int:
        """Poses that the adaptive stage adds."""
        return max(len(self._poses) // ADDED, 1)

    def __call__(
        self, scene: Scene, variable: Variable, lights_fn: LightsFn | None, settings: ShardSettings, index: int
    ) -> tuple[dict[str, np.ndarray], dict]:
        """As ``make_shard``."""
        start = perf_counter()
        found = self._joined(self._of_poses, variable, index)
        if index == 0:
            self._preparing = perf_counter() - start
        return found

    def adaptive(self, known: Samples, predict: Predict) -> Make:
        """Make the function for more shards: poses are added where a fit errs most between those that are known.

        Samples of a light that moves are added to known poses too, each by the residual of its own samples.

        Args:
            known: Samples on which the residual is measured.
            predict: The fitted field.

        Returns:
            Makes a shard, as ``make_shard`` does.
        """
        at, residual = np.asarray(known.query.pose), relative_residual(predict(known.query), known)
        rows = [np.flatnonzero((at == np.float32(pose)).all(axis=1)) for pose in self._poses]
        errors = np.array([math.sqrt(max(float(residual[own].mean()), 0.0)) if len(own) else 0.0 for own in rows])
        added, count = next_poses(np.array(self._poses), errors, self._added), len(self._poses)
        if self._kind is OwnLightShards:
            more, kept = [self._of_pose(pose, count + k, len(added)) for k, pose in enumerate(added)], []
        else:
            more = [self._of_pose(pose, count + k, count) for k, pose in enumerate(added)]
            kept = [
                replace(self._of_poses[k], make=self._of_poses[k].maker.adaptive(known[rows[k]], predict))
                for k in sorted(np.argsort(-errors, kind="stable")[: count - len(added)])
            ]
        return lambda scene, variable, lights_fn, settings, index: self._joined([*kept, *more], variable, index)

    def _joined(self, poses: Sequence[_OfPose], variable: Variable, index: int) -> tuple[dict[str, np.ndarray], dict]:
        """The rows of all poses and the sum of their counts."""
        parts, counts = [], dict[str, Any]()
        for of in poses:
            columns, found = of.make(posed(self._scene, of.pose), variable, None, of.settings, index)
            parts.append(columns | self._rest(columns, of.pose))
            counts = {name: _sum(counts.get(name), values) for name, values in found.items()}
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}, counts

    def _rest(self, columns: dict[str, np.ndarray], pose: Sequence[float]) -> dict[str, np.ndarray]:
        """The columns that say in which pose rows are, and where they are at rest."""
        query = Query(**{name: columns[name] for name in Query.__dataclass_fields__ if name in columns})
        at = poses_of(len(query), pose)
        found = columns_of(with_rest(self._scene.movers, query, columns["shape"], at))
        return {name: found[name] for name in ("pose", "rest_position", "rest_normal")}


def next_poses(known: np.ndarray, errors: np.ndarray, count: int) -> list[Pose]:
    """Choose further poses: far from known ones, where these have large errors.

    Args:
        known: [K, M] poses, sliders from 0 to 1.
        errors: [K] errors of a fit in them, ≥ 0.
        count: Poses to add.

    Returns:
        The poses, the most useful one first; none is a known one.
    """
    movers = known.shape[1]
    if movers == 1:
        candidates = np.linspace(0, 1, CANDIDATES + 1)[1:-1, None]
    else:
        candidates = sobol_poses(CANDIDATES, movers, NEXT_SEED)
    errors, found = np.asarray(errors, np.float64) + TINY, list[Pose]()
    for _ in range(count):
        distance = np.linalg.norm(candidates[:, None] - known, axis=2)
        # The error in between is the mean of all known ones, the nearer the heavier.
        weight = 1 / np.maximum(distance, TINY) ** 2
        between = (weight * errors).sum(axis=1) / weight.sum(axis=1)
        best = int(np.argmax(between * distance.min(axis=1)))
        found.append(tuple(candidates[best].tolist()))
        known, errors = np.concatenate([known, candidates[best : best + 1]]), np.append(errors, between[best])
    return found


def _sum(before: Any, more: Any) -> Any:
    """Add counts by name."""
    if isinstance(more, dict):
        return {name: _sum((before or {}).get(name), value) for name, value in more.items()}
    return more if before is None else before + more
