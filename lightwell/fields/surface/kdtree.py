"""A partition of space with one small network per leaf: radiance regression functions (Ren et al. 2013).

Start from the scene's box. Train one network per leaf; a leaf whose training *and* held-out error are below the goal
stays; any other is split at its middle into two, and so on, until the goal is met, the leaf has too few samples for its
weights, or the caps on depth and leaves are reached: such leaves are marked, not looped on. All leaves of a level are
trained at once; with ``axes='try'`` every leaf tries all three cuts and keeps the one with the least held-out error.

The error rule is ``raw``, mean |f − y| / (y + ε), which on noisy targets can stay above any goal for ever, or
``corrected``, the root of the mean of (f − A)(f − B) / (f² + ε²), which the noise of the targets does not raise; a leaf
is above the goal when this is so by two standard errors.

Notation: L leaves, E candidates (halves of leaves that are being split).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.fields.surface.field import SurfaceField
from lightwell.fields.surface.kd_level import HELD_OUT, WHOLE, KdLevel, Rule, is_trained
from lightwell.fields.surface.partition import Partition
from lightwell.fields.surface.segmented import NetworkPreset, SegmentedFit
from lightwell.files import Arrays, prefixed, under
from lightwell.graph import Builder
from lightwell.networks import TrainingSettings
from lightwell.networks.batched import BatchedTrainer, initial_batch
from lightwell.networks.checkpoint import check_rows
from lightwell.networks.levenberg import LevenbergMarquardt
from lightwell.networks.loop import REPORT_TRAINING
from lightwell.transport.samples import Query

# Status of a leaf: above the goal and to be split; at the goal; or finally above it, because it has too few samples, is
# as deep as allowed, would exceed the number of leaves, or got no better by a split.
OPEN, MET, FEW, DEEP, FULL, WORSE = range(6)
STATUS = ("open", "met", "few samples", "deep", "no room", "no gain")
# Levels beyond those after which evenly halved leaves have too few samples: the first, and one for uneven halves.
SPARE_LEVELS = 2
# Candidates of a level whose steps cost as much again as a single network's: levels of more have fewer steps, but not
# fewer than a share of them.
DEAR, LEAST_SHARE = 64, 1 / 16
# The error of a level is measured at most so often, because that costs as much as many steps.
LOOKS = 4
# Factors between the seeds of fits and of levels.
SEED_STEP, LEVEL_STEP = 1_000_003, 100_003


@dataclass(frozen=True)
class KdPreset(NetworkPreset):
    """Settings of a ``kdtree`` field."""

    goal: float = 0.05
    """Error below which a leaf is not split."""
    rule: Rule = "corrected"
    axes: Literal["try", "cycle"] = "try"
    """Try three cuts and keep the best, or take x, y, z in turn."""
    leaves: int = 8192
    """Most leaves."""
    depth: int = 20
    """Most splits above a leaf."""
    samples_per_weight: float = 8.0
    """Leaves with fewer training samples per weight are not split."""
    optimiser: Literal["gradient", "lm"] = "gradient"
    most_rows: int | None = None
    """'lm' trains on at most so many samples of a leaf."""
    inherit: bool = False
    """Halves start from their parent's weights instead of random ones, and are given up when they are no better; when
    nothing is left to split, all leaves are trained on."""
    initial_range: float | None = None
    """Random weights are U(±this) instead of Glorot's."""


PRESETS: dict[str, KdPreset] = {
    # Local geometry as inputs, demodulated, halves start from their parent's weights, noise cannot force a split.
    "default": KdPreset(TrainingSettings(rate=1e-2, batch=256, evaluate_every=50, patience=0), inherit=True),
    # The networks of the 2013 report in Ren's tree, with its rule as published.
    "report": KdPreset(
        replace(REPORT_TRAINING, evaluate_every=100, patience=0),
        "raw",
        demodulated=False,
        activation="tanh",
        output="sigmoid",
        rule="raw",
        axes="cycle",
    ),
    # Ren: 15 inputs, 563 weights, linear output, full-batch Levenberg–Marquardt on about ten samples per weight,
    # weights U[−1, 1]. Which three numbers describe the surface there is not known; here they are the reflectance.
    "ren": KdPreset(
        TrainingSettings(loss="l2", evaluate_every=5, patience=0),
        "ren",
        demodulated=False,
        activation="tanh",
        output="identity",
        rule="raw",
        axes="cycle",
        optimiser="lm",
        most_rows=5630,
        initial_range=1.0,
    ),
}


class KdFit(SegmentedFit):
    """See ``lightwell.fields.base.Learner``."""

    preset: KdPreset

    def __init__(self, setup: FieldSetup, preset: KdPreset, seed: int) -> None:
        """Start a fit.

        Args:
            setup: Bounds, light and radiance unit of the scene.
            preset: Settings.
            seed: Seed of the weights.
        """
        super().__init__(setup, preset, seed)
        middle = np.asarray(setup.center)
        self.partition = Partition.of_box(middle - setup.half_extent, middle + setup.half_extent)
        # Per leaf: weights, training and held-out error, status, and on how many samples its halves were no better.
        self._weights = self._initial(np.array([seed]))
        self._errors = np.full((1, 2), np.inf)
        self._status = np.array([OPEN])
        self._declined = np.zeros(1, np.int64)
        # Steps per level, fixed when training starts; levels done; the one in training.
        self._level_steps = 0
        self._levels = 0
        self._level: KdLevel | None = None
        # Levels when the facts were last written.
        self._described = -1

    def _initial(self, seeds: np.ndarray) -> dict[str, np.ndarray]:
        weights = initial_batch(self.mlp, seeds, self.preset.training.initial_bias)
        if (bound := self.preset.initial_range) is not None:
            rng = np.random.default_rng([int(s) for s in seeds])
            weights = {k: rng.uniform(-bound, bound, v.shape).astype(np.float32) for k, v in weights.items()}
        return weights

    # ------------------------------------------------------------------ what the base needs

    @property
    def macs(self) -> int:
        """Multiply-accumulates of one network; the walk to the leaf is table reads."""
        return self.mlp.macs

    @property
    def weights(self) -> dict[str, np.ndarray]:
        """Weights of the leaves; during the first level, of the network in training."""
        return self._level.trainer.best if self._levels == 0 and self._level else self._weights

    def segment(self, query: Query) -> np.ndarray:
        """Find the leaf of each point.

        Args:
            query: N queries.

        Returns:
            [N] int leaf.
        """
        return self.partition.locate(np.asarray(query.position, np.float32))

    def _lower_segment(self, b: Builder, x: str) -> str:
        return b.tree("position", self.partition.rows, self.partition.levels)

    def _rearrange(self) -> None:
        if self._level:
            self._level.forget()

    # ------------------------------------------------------------------ steps

    @property
    def _fewest(self) -> int:
        """Training samples below which a leaf is not split."""
        weights = sum(a * b + b for a, b in zip(self.mlp.sizes, self.mlp.sizes[1:]))
        return int(self.preset.samples_per_weight * weights)

    def _planned_levels(self) -> int:
        """Levels until evenly halved leaves have too few samples."""
        ratio = len(self.examples) * (1 - 1 / HELD_OUT) / max(self._fewest, 1)
        halvings = int(np.ceil(np.log2(max(ratio, 1))))
        return min(halvings + SPARE_LEVELS, self.preset.depth + 1)

    def _steps_of(self, level: KdLevel) -> int:
        """Steps of a level: levels take about the same time, whatever their number of networks."""
        if self.preset.optimiser == "lm":
            return self._level_steps
        return max(int(self._level_steps * max(1 / (1 + len(level) / DEAR), LEAST_SHARE)), 1)

    def _step(self, total: int) -> bool:
        self._level_steps = self._level_steps or max(total // self._planned_levels(), 1)
        level = self._begun_level() if self._level is None else self._level
        if level is None:
            return True
        self._level = level
        level.arrange(self.partition, self.examples, self._seed, self.preset.most_rows)
        steps = self._steps_of(level)
        level.step(steps)
        self.state.samples_seen += len(level) * self.preset.training.batch
        ended = level.steps >= steps or level.finished
        if ended or level.steps % max(steps // LOOKS, self.preset.training.evaluate_every) == 0:
            level.judge(self.mlp, self.examples, self.preset.rule)
        if ended:
            self._end_level(level)
        return False

    def _look(self) -> tuple[float, float]:
        # A finer partition replaces a coarser one: the best error is that of the graph that would be written.
        self.state.best_error = np.inf
        if self._described != self._levels:
            self._describe()
        error = self._validation_error()
        trained = self._errors[np.isfinite(self._errors[:, 0]), 0]
        return float(trained.mean()) if len(trained) else error, error

    # ------------------------------------------------------------------ levels

    def _begun_level(self) -> KdLevel | None:
        """The halves of all leaves that are to be split, else all leaves once more; None when nothing is left."""
        if self._levels == 0:
            parent, axis, side = np.array([0]), np.array([WHOLE]), np.array([0])
        else:
            splitting = self._splitting()
            if not len(splitting):
                return self._whole_leaves() if self.preset.inherit else None
            cuts = 3 if self.preset.axes == "try" else 1
            parent = np.repeat(splitting, 2 * cuts)
            cycled = self.partition.depth[parent] % 3
            axis = np.tile(np.repeat(np.arange(3), 2), len(splitting)) if cuts == 3 else cycled
            side = np.tile([0, 1], cuts * len(splitting))
        return KdLevel(parent, axis, side, self._trainer(len(parent), parent))

    def _whole_leaves(self) -> KdLevel:
        """A level that continues the training of all leaves, because none is to be split."""
        leaf = np.arange(len(self.partition))
        return KdLevel(leaf, np.full(len(leaf), WHOLE), np.zeros_like(leaf), self._trainer(len(leaf), leaf))

    def _trainer(self, count: int, parent: np.ndarray | None = None) -> BatchedTrainer | LevenbergMarquardt:
        """For so many candidates; parent [E]: the leaves from which they start."""
        seeds = self._seed * SEED_STEP + self._levels * LEVEL_STEP + np.arange(count)
        inherit = self.preset.inherit and self._levels > 0 and parent is not None
        initial = {k: v[parent] for k, v in self._weights.items()} if inherit else self._initial(seeds)
        if self.preset.optimiser == "lm":
            return LevenbergMarquardt(self.mlp, seeds, initial=initial)
        return BatchedTrainer(self.mlp, self.preset.training, seeds, initial)

    def _splitting(self) -> np.ndarray:
        """[K] leaves that are split next: all that may be; the worst where there is no room for all."""
        trained = self.examples.query.position[is_trained(self.examples)]
        count = np.bincount(self.partition.locate(trained), minlength=len(self.partition))
        status = np.where(self._status == MET, MET, OPEN)
        for excluded, reason in (
            (count < self._fewest, FEW),
            (self._declined == len(self.examples), WORSE),
            (self.partition.depth >= self.preset.depth, DEEP),
        ):
            status[excluded & (status == OPEN)] = reason
        candidates = np.flatnonzero(status == OPEN)
        room = max(self.preset.leaves - len(self.partition), 0)
        worst = np.argsort(-self._errors[candidates, 1] * count[candidates], kind="stable")
        status[candidates[worst[room:]]] = FULL
        self._status = status
        return np.sort(candidates[worst[:room]])

    def _end_level(self, level: KdLevel) -> None:
        """Apply the best cut of every parent where it lowers the error, and copy the weights to the leaves."""
        self._level = None
        if (level.axis == WHOLE).all():
            better = np.flatnonzero(level.errors[:, 1] < self._errors[level.parent, 1])
            self._settle(level.parent[better], level, better)
        else:
            parent, below, above = self._best_cuts(level)
            upper = np.array([self.partition.split(p, a) for p, a in zip(parent, level.axis[below])], np.int64)
            self._grow(parent)
            self._settle(np.concatenate([parent, upper]), level, np.concatenate([below, above]))
        self._levels += 1
        self._splitting()

    def _best_cuts(self, level: KdLevel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """[K] leaves to split and the candidates that are their halves: the cut with the least held-out error."""
        cuts = 3 if self.preset.axes == "try" else 1
        pairs = np.arange(len(level)).reshape(-1, cuts, 2)  # (below, above) of each cut of each parent
        parent, held = level.parent[pairs[:, 0, 0]], level.held_count[pairs]
        error = (np.nan_to_num(level.errors[pairs, 1]) * held).sum(axis=2) / np.maximum(held.sum(axis=2), 1)
        # A cut that leaves one side empty is considered last.
        empty = (held == 0).any(axis=2)
        best = np.lexsort((error, empty), axis=1)[:, 0]
        chosen = np.arange(len(pairs)), best
        keep = np.ones(len(pairs), bool)
        if self.preset.inherit:
            keep = error[chosen] < self._errors[parent, 1]
            self._declined[parent[~keep]] = len(self.examples)
        below, above = pairs[chosen][keep].T
        return parent[keep], below, above

    def _grow(self, parent: np.ndarray) -> None:
        """Append the upper halves of split leaves [K]; they start as copies of their parents."""
        copied = lambda values: np.concatenate([values, values[parent]])  # noqa: E731
        self._weights = {name: copied(value) for name, value in self._weights.items()}
        self._errors, self._status, self._declined = (copied(a) for a in (self._errors, self._status, self._declined))

    def _settle(self, leaf: np.ndarray, level: KdLevel, candidate: np.ndarray) -> None:
        """Copy weights of candidates [K] to leaves [K]; a half without samples keeps those of its parent."""
        errors, least = level.errors[candidate], level.least[candidate]
        known = ~np.isnan(errors).all(axis=1)
        # Where one of the two errors is missing, the other is used in its place.
        errors, least = (np.where(np.isnan(e), e[:, ::-1], e) for e in (errors, least))
        self._errors[leaf] = np.where(known[:, None], errors, 0.0)
        for name, value in level.trainer.best.items():
            self._weights[name][leaf[known]] = value[candidate[known]]
        met = ~known | (least < self.preset.goal).all(axis=1)
        self._status[leaf] = np.where(met, MET, OPEN)
        self._declined[leaf] = 0

    # ------------------------------------------------------------------ facts and checkpoints

    def _describe(self) -> None:
        """Facts about the tree, as JSON values."""
        leaf = self.segment(self.examples.query)
        count = np.bincount(leaf, minlength=len(self.partition))
        sizes = np.bincount(np.ceil(np.log2(np.maximum(count, 1))).astype(int))
        depths = np.bincount(self.partition.depth)
        states = np.bincount(self._status, minlength=len(STATUS))
        self._described = self._levels
        self.facts |= {
            "rule": self.preset.rule,
            "goal": self.preset.goal,
            "leaves": len(self.partition),
            "levels": self._levels,
            "leaves_by_depth": {str(d): int(n) for d, n in enumerate(depths) if n},
            "leaves_by_most_samples": {str(1 << s): int(n) for s, n in enumerate(sizes) if n},
            "leaves_by_status": {name: int(n) for name, n in zip(STATUS, states) if n},
        }

    _varying = ("errors", "status", "declined", "weights.", "partition.", "level.")

    def _arrays(self) -> Arrays:
        arrays = {"errors": self._errors, "status": self._status, "declined": self._declined}
        arrays["levels"] = np.array([self._level_steps, self._levels])
        arrays |= prefixed("weights", self._weights) | prefixed("partition", self.partition.arrays())
        return arrays | (prefixed("level", self._level.arrays()) if self._level else {})

    def _restore(self, arrays: Arrays) -> None:
        partition = Partition.of(under("partition", arrays))
        mine = self._arrays()
        rows = {
            name: mine[name] for name in mine if name in ("errors", "status", "declined") or name.startswith("weights.")
        }
        check_rows(arrays, rows, len(partition))
        self._errors, self._status, self._declined = (arrays[n].copy() for n in ("errors", "status", "declined"))
        self._level_steps, self._levels = (int(n) for n in arrays["levels"])
        self._weights = {name: arrays[f"weights.{name}"].copy() for name in self._weights}
        self.partition = partition
        if ((self._status < 0) | (self._status >= len(STATUS))).any():
            raise ValueError("'status' holds a state that leaves do not have")
        level = under("level", arrays)
        self._level = KdLevel.of_arrays(level, self._trainer) if level else None
        if self._level is not None and not (self._level.parent < len(partition)).all():
            raise ValueError("'level.parent' names a leaf that does not exist")


FIELD = SurfaceField("kdtree", PRESETS, KdFit)
