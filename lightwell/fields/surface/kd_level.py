"""One level of a kd-tree field: the networks of all its candidates, trained and evaluated together.

A candidate is a half of a leaf that may be split, or a whole leaf. E candidates, N samples, M memberships (a sample is
in one candidate per cut that is tried).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from lightwell.fields.surface.examples import Examples
from lightwell.fields.surface.partition import Partition
from lightwell.files import Arrays, prefixed, under
from lightwell.networks import Mlp
from lightwell.networks.batched import BatchedSet, BatchedTrainer
from lightwell.networks.checkpoint import check_rows
from lightwell.networks.grouped import GroupedRows, Runs, sort_into_runs
from lightwell.networks.levenberg import LevenbergMarquardt

# The axis of a candidate that is a whole leaf.
WHOLE = -1
# One of this many samples is held out of the training of the leaves, to measure their error.
HELD_OUT = 5
# Odd factor that spreads sample numbers over 32 bits (Knuth, multiplicative hashing).
SPREAD, BITS = 2654435761, 32

# Samples of a level are thinned to about so many in all, but not below so many of a candidate: the first networks of a
# tree see every part of the scene, and a level of few candidates costs no more than one of many.
LEVEL_ROWS, CANDIDATE_ROWS = 1 << 19, 1 << 13
# Another odd factor, for numbers that are independent of which samples are held out.
THINNING = 2246822519

# Number of standard errors by which a corrected error must exceed the goal: in small leaves the mean of
# the products of two noisy residuals is uncertain.
CONFIDENCE = 2.0

Rule = Literal["raw", "corrected"]


def error_of(rule: Rule, examples: Examples, output: np.ndarray, groups: np.ndarray, count: int) -> np.ndarray:
    """Compute the error of each group of samples, and a lower confidence bound of it.

    For ``raw`` both are the same. For ``corrected`` the bound of the squared error is lower by ``CONFIDENCE`` standard
    errors.

    Args:
        rule: Kind of error, ``raw`` or ``corrected``.
        examples: N samples.
        output: [N, 3] outputs of the network.
        groups: [N] int group of each sample, −1 for those that are left out.
        count: Number of groups.

    Returns:
        [count, 2] error and lower bound; NaN for groups without samples.
    """
    rows = np.flatnonzero(groups >= 0)
    terms = examples.relative_error(output) if rule == "raw" else examples.corrected_square(output)
    terms, weight, groups = terms[rows].astype(np.float64), examples.weight[rows].astype(np.float64), groups[rows]
    with np.errstate(invalid="ignore", divide="ignore"):
        total = np.bincount(groups, weight, count)
        mean = np.bincount(groups, weight * terms, count) / total
        if rule == "raw":
            return np.stack([mean, mean], axis=1)
        deviation = np.sqrt(np.bincount(groups, (weight * (terms - mean[groups])) ** 2, count)) / total
    return np.sqrt(np.maximum(np.stack([mean, mean - CONFIDENCE * deviation], axis=1), 0))


def is_trained(examples: Examples) -> np.ndarray:
    """Separate training samples from held-out ones, by a hash of a sample's number: more samples do not change the
    others.

    Args:
        examples: N samples.

    Returns:
        [N] bool, True for training samples.
    """
    spread = examples.row.astype(np.uint64) * np.uint64(SPREAD) % np.uint64(1 << BITS)
    return spread * np.uint64(HELD_OUT) >> np.uint64(BITS) != 0


def thinned(row: np.ndarray, candidate: np.ndarray, candidates: int) -> np.ndarray:
    """Limit the memberships of candidates that have very many, by a hash of a sample's number.

    Args:
        row: [M] sample of each membership.
        candidate: [M] candidate of each membership.
        candidates: E.

    Returns:
        [K] int indices of the memberships that are used.
    """
    most = max(LEVEL_ROWS // max(candidates, 1), CANDIDATE_ROWS)
    share = most / np.maximum(np.bincount(candidate, minlength=candidates), 1)
    if (share >= 1).all():
        return np.arange(len(row))
    chance = (row.astype(np.uint64) * np.uint64(THINNING) % np.uint64(1 << BITS)) / float(1 << BITS)
    return np.flatnonzero(chance < share[candidate])


class KdLevel:
    """Candidates of a level, their trainer, and their errors so far."""

    def __init__(
        self,
        parent: np.ndarray,
        axis: np.ndarray,
        side: np.ndarray,
        trainer: BatchedTrainer | LevenbergMarquardt,
    ) -> None:
        """Start a level.

        Args:
            parent: [E] leaf of each candidate.
            axis: [E] axis of its cut, or WHOLE.
            side: [E] 0 below the cut, 1 above it.
            trainer: Trainer of E networks.
        """
        self.parent, self.axis, self.side, self.trainer = parent, axis, side, trainer
        # Steps done; [E, 2] training and held-out error of the best weights, and the least that they may be; NaN
        # without samples.
        self.steps = 0
        self.errors = np.full((len(parent), 2), np.nan)
        self.least = np.full((len(parent), 2), np.nan)
        # [E] held-out samples.
        self.held_count = np.zeros(len(parent))
        # Computed from the samples by ``arrange``.
        self._data: Any = None

    def __len__(self) -> int:
        return len(self.parent)

    @property
    def finished(self) -> bool:
        """Whether no network can be improved any more."""
        return isinstance(self.trainer, LevenbergMarquardt) and bool(self.trainer.done.all())

    def forget(self) -> None:
        """Discard what was computed from the samples; call it after they have changed."""
        self._data = None

    # ------------------------------------------------------------------ samples

    def _members(self, partition: Partition, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the candidates that samples belong to.

        Args:
            partition: The partition before the level.
            position: [N, 3] positions, metres.

        Returns:
            [M] samples and [M] candidates.
        """
        leaf = partition.locate(position)
        rows, candidates = [], []
        for axis in np.unique(self.axis):
            side = np.zeros(len(leaf), np.int64)
            if axis != WHOLE:
                side = (position[:, axis] >= partition.middle(leaf)[:, axis]).astype(np.int64)
            number = np.full((len(partition), 2), -1)
            here = self.axis == axis
            number[self.parent[here], self.side[here]] = np.flatnonzero(here)
            candidate = number[leaf, side]
            rows.append(np.flatnonzero(candidate >= 0))
            candidates.append(candidate[rows[-1]])
        return np.concatenate(rows), np.concatenate(candidates)

    def arrange(self, partition: Partition, examples: Examples, seed: int, most_rows: int | None) -> None:
        """Sort the samples by candidate; a second call changes nothing.

        Args:
            partition: The partition before the level.
            examples: N samples.
            seed: Seed of the order within a candidate.
            most_rows: Most samples per candidate for Levenberg-Marquardt; None: no limit.
        """
        if self._data is not None:
            return
        row, candidate = self._members(partition, np.asarray(examples.query.position, np.float32))
        used = thinned(row, candidate, len(self))
        row, candidate = row[used], candidate[used]
        trained = is_trained(examples)[row]
        order, runs = sort_into_runs(np.where(trained, candidate, -1), len(self), (seed, len(row)))
        picked = row[order]
        columns = (examples.features[picked], examples.target[picked], examples.weight[picked])
        if isinstance(self.trainer, BatchedTrainer):
            data: Any = BatchedSet.from_numpy(*columns, runs)
        else:
            data = (*columns, Runs(runs.first, np.minimum(runs.count, most_rows or len(row))))
        self.held_count = np.bincount(candidate[~trained], minlength=len(self)).astype(float)
        device = GroupedRows(examples.features[row], candidate, len(self))
        self._data = data, row, candidate, trained, device

    # ------------------------------------------------------------------ steps

    def step(self, total: int) -> None:
        """Train every candidate by one step; ``arrange`` comes first.

        Args:
            total: Steps of the schedule.
        """
        data = self._data[0]
        if isinstance(self.trainer, BatchedTrainer):
            self.trainer.step(data, total)
        else:
            self.trainer.step(*data)
        self.steps += 1

    def judge(self, mlp: Mlp, examples: Examples, rule: Rule) -> None:
        """Measure training and held-out error of every candidate, and keep its weights where the held-out error has
        fallen.

        Args:
            mlp: Shape of the networks.
            examples: N samples.
            rule: Kind of error.
        """
        _, row, candidate, trained, device = self._data
        part, output = examples.take(row), device.evaluate(mlp, self.trainer.parameters)
        groups = (np.where(trained, candidate, -1), np.where(trained, -1, candidate))
        found = np.stack([error_of(rule, part, output, group, len(self)) for group in groups], axis=1)
        errors, least = found[:, :, 0], found[:, :, 1]
        # Without held-out samples the latest weights are kept.
        better = self.trainer.look(np.where(np.isnan(errors[:, 1]), -float(self.steps), errors[:, 1]))
        self.errors[better], self.least[better] = errors[better], least[better]

    # ------------------------------------------------------------------ checkpoints

    def arrays(self) -> Arrays:
        """Return everything that is needed to resume the level.

        Returns:
            Arrays by name.
        """
        own = {"parent": self.parent, "axis": self.axis, "side": self.side, "steps": np.array(self.steps)}
        return own | {"errors": self.errors, "least": self.least} | prefixed("trainer", self.trainer.arrays())

    @staticmethod
    def of_arrays(arrays: Arrays, trainer: Callable[[int], BatchedTrainer | LevenbergMarquardt]) -> KdLevel:
        """Restore a level.

        Args:
            arrays: The result of ``arrays`` by name, shapes [E, …].
            trainer: Makes a trainer for a number of candidates.

        Returns:
            The level.

        Raises:
            ValueError: The arrays do not describe a level.
        """
        parent, axis, side = (arrays[name] for name in ("parent", "axis", "side"))
        kinds = {
            "parent": parent,
            "axis": parent,
            "side": parent,
            "errors": np.empty((1, 2)),
            "least": np.empty((1, 2)),
        }
        check_rows(arrays, kinds, len(parent))
        if not ((parent >= 0).all() and np.isin(axis, (WHOLE, 0, 1, 2)).all() and np.isin(side, (0, 1)).all()):
            raise ValueError("'parent', 'axis' or 'side' is not one of a cut")
        level = KdLevel(parent, axis, side, trainer(len(parent)))
        level.steps = int(arrays["steps"])
        level.errors, level.least = arrays["errors"].copy(), arrays["least"].copy()
        level.trainer.restore(under("trainer", arrays))
        return level
