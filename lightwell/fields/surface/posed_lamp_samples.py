"""Training samples of the scene's own lamps where something moves: the share of every group, in several poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lightwell.core.lamps import parse_lamps
from lightwell.fields.protocol import State
from lightwell.fields.surface.lamp_samples import (
    BATCH,
    VALIDATION_POINTS,
    LampSamples,
    LampTracer,
    join_lamps,
    points_drawn,
)
from lightwell.fields.surface.plan import MOST_GATHERED
from lightwell.fields.surface.posed_lamps import RUN
from lightwell.fields.surface.poses import (
    ALL_POINTS,
    VALIDATION_POSES,
    gather_in_time,
    held_out_poses,
    traced_poses,
)
from lightwell.fields.surface.roles import looked_from
from lightwell.scenes.lamps import LampGroup, group_lamps
from lightwell.scenes.movers import Pose
from lightwell.scenes.posing import posed
from lightwell.scenes.scene import Scene
from lightwell.transport.moved import poses_of, with_rest

# Points of a pose that are drawn, at least: fewer of them find too few bins, and indirect light is lost.
FEWEST_DRAWN = 1 << 13
# Held-out poses, at least: both end stops and two in between.
FEWEST_HELD_OUT = 4
# Random streams of the poses that are traced, and of those that are held out.
TRACED_STREAM, HELD_OUT_STREAM = 1, 2


class PosedLampTracer:
    """Makes batches with as many rows of each pose, each traced in the scene that stands so."""

    def __init__(self, state: State, seconds: float) -> None:
        """Prepare to trace; nothing is traced yet.

        Args:
            state: The prepared scene, with movers and groups of lamps.
            seconds: Time of the role.

        Raises:
            ValueError: The time is too short for the fewest poses.
        """
        self._state, request, movers = state, state.job.request, len(state.scene.movers)
        gathered, _ = gather_in_time(state, seconds, request.shards or MOST_GATHERED)
        self.poses = traced_poses(request.quality, request.lights_per_shard, gathered, movers)
        """[K, M] poses that are traced."""
        count = len(self.poses)
        self._size = max(BATCH // count // RUN, 1) * RUN
        self._drawn = max(ALL_POINTS["draft"] * points_drawn(state) // count, FEWEST_DRAWN)
        # What traces the lamps in each of them.
        self.tracers = [self._tracer(pose, (TRACED_STREAM, k)) for k, pose in enumerate(self.poses)]

    @property
    def rays(self) -> int:
        """Rays of a point."""
        return self.tracers[0].rays

    def _tracer(self, pose: np.ndarray, stream: tuple[int, ...]) -> LampTracer:
        """What traces one pose."""
        state, at = self._state, posed(self._state.scene, pose)
        groups = lamps_in(at, state.job.request.lamps, state.lamps)
        still = replace(state, scene=at, lamps=groups, variable=looked_from(state))
        return LampTracer(still, self._drawn, self._size, stream)

    def batch(self, index: int) -> LampSamples:
        """Trace one batch.

        Args:
            index: Number of the batch.

        Returns:
            The samples, pose by pose.
        """
        return self._joined([tracer.batch(index) for tracer in self.tracers], self.poses)

    def held_out(self) -> LampSamples:
        """Trace the held-out points, at held-out poses.

        Returns:
            The samples, pose by pose.
        """
        number = int(np.clip(len(self.poses) // 2, FEWEST_HELD_OUT, VALIDATION_POSES))
        poses, points = held_out_poses(self.poses, number), VALIDATION_POINTS // VALIDATION_POSES
        known = {tuple(pose.tolist()): tracer for pose, tracer in zip(self.poses, self.tracers)}
        parts = []
        for k, pose in enumerate(poses):
            # End stops are among the traced poses: their bins are lit.
            tracer = known.get(tuple(pose.tolist())) or self._tracer(pose, (HELD_OUT_STREAM, k))
            parts.append(tracer.held_out(points))
        return self._joined(parts, poses)

    def _joined(self, parts: list[LampSamples], poses: np.ndarray) -> LampSamples:
        """All rows, with their poses and where they are at rest."""
        return join_lamps([self._resting(part, tuple(pose)) for part, pose in zip(parts, poses)])

    def _resting(self, part: LampSamples, pose: Pose) -> LampSamples:
        at = poses_of(len(part.shape), pose)
        return replace(part, query=with_rest(self._state.scene.movers, part.query, part.shape, at))


def lamps_in(scene: Scene, rules: tuple[str, ...], groups: tuple[LampGroup, ...]) -> tuple[LampGroup, ...]:
    """Find groups of lamps in a pose, whose emitters may have other numbers than those of the scene at rest.

    Args:
        scene: The scene in the pose.
        rules: Which lights belong together, as ``--lamps`` has them.
        groups: The groups of the scene at rest.

    Returns:
        The same groups, in the same order.
    """
    found = {group.name: group for group in group_lamps(scene, parse_lamps(rules))}
    return tuple(found[group.name] for group in groups)
