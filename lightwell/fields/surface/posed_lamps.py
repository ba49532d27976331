"""The field of the scene's own lamps where something moves: every switch in every pose, at the price of one lamp.

See ``lightwell.networks.posed_lamps``. The graph has two frame inputs, ``lamps`` and ``pose``; the layers of the groups
are added up, and set to the pose, by ``per_frame`` nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lightwell.fields.features import open_builder, pose_features
from lightwell.fields.surface.lamp_samples import LampSamples
from lightwell.fields.surface.lamps import LampsFit
from lightwell.fields.surface.pose_basis import pose_basis
from lightwell.fields.tabulate import Tabulated
from lightwell.graph import Buffer, Builder
from lightwell.graph.pose_basis import PoseBasis
from lightwell.networks.lamps import LampSet
from lightwell.networks.light_major import light_runs
from lightwell.networks.posed_lamps import PosedLampNetwork, PosedLampSet
from lightwell.transport.samples import Query

# Rows that follow each other and share a pose, at most.
RUN = 64


@dataclass
class PosedLampsFit(LampsFit):
    """A learner of the lamps of a scene with movers."""

    basis: PoseBasis = field(init=False)
    """Functions of the pose that weight the layers of a lamp."""

    @property
    def facts(self) -> dict[str, Any]:
        """Errors of switch states at held-out points and poses, for the report."""
        return super().facts | {"pose_bases": self.basis.count}

    # ------------------------------------------------------------------ data

    def _network(self, samples: LampSamples) -> PosedLampNetwork:
        self.basis = pose_basis(samples.query.pose)
        b = open_builder(movers=self.setup.movers)
        frame = b.concat(*pose_features(b, self.setup.movers), per_frame=True)
        self._poses = Tabulated(b.build(frame=frame, basis=self.basis.add(b)))
        preset, pixel = self.preset, self._inputs.width("pixel")
        return PosedLampNetwork(
            preset.grid,
            pixel,
            len(self.names),
            preset.hidden,
            bases=self.basis.count,
            frame=self._poses.width("frame"),
        )

    def _order(self, samples: LampSamples) -> np.ndarray:
        return pose_order(samples.query.pose, self.seed)

    def rows(self, query: Query) -> tuple[np.ndarray, ...]:
        """Compute what the network reads at points.

        Args:
            query: N points.

        Returns:
            Grid points [N, 3], other inputs [N, G], pose features [P, F] and weights of the bases [P, M] of the runs.
        """
        table = self._poses(query[:: light_runs(query.pose, RUN)])
        return (*super().rows(query), table["frame"], table["basis"])

    def _set(
        self, query: Query, order: np.ndarray, target: np.ndarray, weight: np.ndarray, states: np.ndarray
    ) -> LampSet:
        points, pixel, frame, basis = self.rows(query[order])
        return PosedLampSet.of_runs(LampSet.from_numpy(points, pixel, target, weight, states), frame, basis)

    # ------------------------------------------------------------------ graph

    def _builder(self) -> Builder:
        return open_builder(self.setup.relief, len(self.names), self.setup.movers)

    def _trunk(self, b: Builder, small: Callable[[np.ndarray], Buffer]) -> str:
        weights, layers = self._trainer.best, len(self.network.hidden)
        pose = b.concat(*pose_features(b, self.setup.movers), per_frame=True)
        pose = b.linear(pose, small(weights["pose_w0"].T), small(weights["pose_b0"][0]), per_frame=True)
        pose = b.activate(pose, self.network.activation, per_frame=True)
        x = self._first(b, small, np.zeros(self.network.hidden[0]))
        for k in range(layers):
            x = b.linear(x, small(weights[f"w{k}"].T), small(np.zeros(self.network.hidden[k]))) if k else x
            shift = b.linear(pose, small(weights[f"shift{k}"].T), small(weights[f"b{k}"][0]), per_frame=True)
            x = b.activate(b.add(x, shift), self.network.activations[k])
        return x

    def _merged(self, b: Builder, small: Callable[[np.ndarray], Buffer]) -> list[str]:
        groups, width, bases = len(self.names), self.network.hidden[-1], self.basis.count
        dimmers, at = self._dimmers(b), self.basis.add(b)
        layers = np.square(self._trainer.best["lamps"]).reshape(bases, width, groups, 3)
        # Row by row a matrix [H, M], which the weights of the bases are multiplied with.
        layers, none = layers.transpose(1, 0, 2, 3).reshape(width * bases, groups, 3), small(np.zeros(width * bases))
        found = []
        for channel in range(3):
            own = b.slice(dimmers, channel * groups, groups, per_frame=True)
            matrix = b.linear(own, small(layers[..., channel]), none, per_frame=True)
            found.append(b.matvec(matrix, at, width, per_frame=True))
        return found


def pose_order(pose: np.ndarray, seed: int) -> np.ndarray:
    """Put rows in random order, in runs that share a pose.

    Args:
        pose: [N, M] pose of each row.
        seed: Seed of the order.

    Returns:
        Rows, run after run; of each pose, fewer than a run of them are left out.
    """
    rng = np.random.default_rng((seed, len(pose)))
    _, of, counts = np.unique(pose, axis=0, return_inverse=True, return_counts=True)
    run = 1 << min(int(counts.min()).bit_length() - 1, RUN.bit_length() - 1)
    runs = []
    for k, count in enumerate(counts):
        rows = rng.permutation(np.flatnonzero(of.reshape(-1) == k))
        runs.append(rows[: count // run * run].reshape(-1, run))
    return rng.permutation(np.concatenate(runs)).reshape(-1)
