"""A regression tree with constant leaves: the baseline that the 2013 report tried first and rejected.

CART on variance reduction (Breiman et al. 1984; scikit-learn, at bake time only) over the raw inputs; the smallest leaf
is chosen on the validation samples. Steps between leaves are visible, and it generalises badly; it is a comparison for
the networks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.fields.base import FieldSetup, Progress
from lightwell.fields.features import open_builder
from lightwell.fields.surface.examples import Examples
from lightwell.fields.surface.field import SurfaceField
from lightwell.fields.surface.inputs import Inputs, Kind
from lightwell.fields.surface.lowering import as_radiance
from lightwell.fields.surface.partition import check_nodes, walk
from lightwell.fields.surface.segmented import STATE_VARYING, state_arrays, state_of
from lightwell.files import Arrays
from lightwell.graph import Graph, quantise
from lightwell.networks.checkpoint import check_like
from lightwell.networks.losses import EPSILON
from lightwell.networks.training import TrainingState
from lightwell.transport.samples import Query, Samples

# A random part of more samples than this is grown on: growing takes n log n, 10 s for 200,000.
MOST_ROWS = 1 << 19


@dataclass(frozen=True)
class TreePreset:
    """Settings of a ``tree`` field."""

    inputs: Kind
    demodulated: bool
    logarithmic: bool
    """Grow on ln(y + ε), so that dark regions have weight; the leaves hold plain means."""
    smallest_leaves: tuple[int, ...] = (8, 32, 128, 512)
    """Sizes of the smallest leaf, samples, that are tried; the best on validation stays."""
    depth: int = 24
    leaves: int = 1 << 15
    """Most leaves."""
    storage: str = "float16"


PRESETS: dict[str, TreePreset] = {
    "default": TreePreset("local", demodulated=True, logarithmic=True),
    "report": TreePreset("raw", demodulated=False, logarithmic=False),
}


class TreeFit:
    """See ``lightwell.fields.base.Learner``. The tree is grown in one step; further steps change nothing."""

    macs = 0

    def __init__(self, setup: FieldSetup, preset: TreePreset, seed: int) -> None:
        """Start a fit.

        Args:
            setup: Bounds, light and radiance unit of the scene.
            preset: Settings.
            seed: Seed of the selection of samples.
        """
        self.setup, self.preset, self.seed = setup, preset, seed
        self.inputs = Inputs(setup, preset.inputs)
        self.state = TrainingState()
        self.facts: dict[str, Any] = {}
        # Rows of the op ``tree``, the value of each leaf, levels; one black leaf until it is grown.
        self._nodes = np.array([[0, 0, -1, -1]], np.float32)
        self._values = np.zeros((1, 3), np.float32)
        self._depth = 1
        # Set by ``learn_from`` and ``validate_on``.
        self._examples: Examples
        self._validation: Examples
        self._grown = False

    # ------------------------------------------------------------------ data

    def learn_from(self, samples: Samples) -> None:
        """Set the training samples; the next ``train`` grows a new tree.

        Args:
            samples: Path-traced samples.
        """
        if len(samples) > MOST_ROWS:
            samples = samples[np.random.default_rng(self.seed).permutation(len(samples))[:MOST_ROWS]]
        self._examples = Examples.of(samples, self.setup, self.inputs, self.preset.demodulated)
        self.facts["dropped_samples"] = self._examples.dropped
        self._grown = False

    def validate_on(self, samples: Samples) -> None:
        """Set the samples by which the size of the leaves is chosen.

        Args:
            samples: Path-traced samples.
        """
        self._validation = Examples.of(samples, self.setup, self.inputs, self.preset.demodulated)

    # ------------------------------------------------------------------ fit

    def train(
        self, until: int, total: int, progress: Progress | None = None, checkpoint: Callable[[], None] | None = None
    ) -> bool:
        """Grow the tree, unless that has been done for these samples, and set the step to ``until``.

        Args:
            until: Step to train to.
            total: Steps of the schedule.
            progress: Called with the state and ``total``.
            checkpoint: Called at the end.

        Returns:
            False: the training does not stop early.
        """
        if not self._grown:
            self._grow()
        self.state.step = until
        if progress:
            progress(self.state, total)
        if checkpoint:
            checkpoint()
        return False

    def _grow(self) -> None:
        tried = []
        for smallest in self.preset.smallest_leaves:
            candidate = self._grow_one(smallest)
            error = self._error(candidate)
            tried.append({"smallest_leaf": smallest, "leaves": len(candidate[1]), "error": error})
            if error == min(row["error"] for row in tried):
                best = candidate
        self._nodes, self._values, self._depth = best
        self._grown = True
        self.state.best_error = min(row["error"] for row in tried)
        self.state.best_step = self.state.step
        self.state.history.append((self.state.step, self.state.best_error, self.state.best_error))
        self.facts |= {"leaves": len(self._values), "depth": self._depth, "tried": tried}

    def _grow_one(self, smallest: int) -> tuple[np.ndarray, np.ndarray, int]:
        from sklearn.tree import DecisionTreeRegressor

        examples, preset = self._examples, self.preset
        target = examples.target
        tree = DecisionTreeRegressor(min_samples_leaf=smallest, max_depth=preset.depth, random_state=self.seed)
        grown_on = np.log(target + EPSILON) if preset.logarithmic else target
        tree.fit(examples.features, grown_on, sample_weight=examples.weight)
        nodes, leaf_of, depth = node_rows(tree.tree_)
        leaf = leaf_of[tree.apply(examples.features)]
        weight = np.bincount(leaf, examples.weight)
        sums = [np.bincount(leaf, examples.weight * target[:, c]) for c in range(3)]
        values = (np.stack(sums, axis=1) / weight[:, None]).astype(np.float32)
        if len(values) > preset.leaves:
            return self._grow_one(2 * smallest)
        return nodes, values, depth

    def _error(self, tree: tuple[np.ndarray, np.ndarray, int]) -> float:
        nodes, values, _ = tree
        output = values[walk(nodes, self._validation.features)]
        return float(self._validation.relative_error(output).mean())

    def predict(self, query: Query) -> np.ndarray:
        """Predict radiance before the leaves are quantised.

        Args:
            query: N queries.

        Returns:
            [N, 3] radiance, reflectance included.
        """
        scale = self.setup.unit * (query.reflectance if self.preset.demodulated else 1.0)
        return self._values[walk(self._nodes, self.inputs.rows(query))] * scale

    # ------------------------------------------------------------------ lower

    def lower(self) -> Graph:
        """Return the shading graph: the walk to the leaf, and a table of the leaves' values.

        Returns:
            The graph.
        """
        b = open_builder()
        leaf = b.tree(self.inputs.node(b), self._nodes, self._depth)
        radiance = as_radiance(b, b.rows(leaf, self._values), self.preset.demodulated, self.setup.unit)
        return quantise(b.build(radiance=radiance, segment=leaf), self.preset.storage)

    # ------------------------------------------------------------------ checkpoints

    def arrays(self) -> Arrays:
        """Return the state of the fit.

        Returns:
            Arrays [...] by name.
        """
        tree = {"nodes": self._nodes, "values": self._values, "depth": np.array(self._depth)}
        return state_arrays(self.state, self.facts) | tree | {"grown": np.array(self._grown)}

    def restore(self, arrays: Arrays) -> None:
        """Restore the state of a fit of the same preset and samples.

        Args:
            arrays: Result of ``arrays``.

        Raises:
            ValueError: The arrays do not describe a tree of this field.
        """
        check_like(arrays, self.arrays(), (*STATE_VARYING, "nodes", "values"))
        state, facts = state_of(arrays)
        nodes, values, depth = arrays["nodes"], arrays["values"], int(arrays["depth"])
        if values.dtype != np.float32 or values.ndim != 2 or values.shape[1] != 3:
            raise ValueError("'values' is not a colour for each leaf")
        check_nodes(nodes, len(values), self.inputs.width, depth)
        self.state = state
        self.facts |= facts
        self._nodes, self._values, self._depth, self._grown = nodes, values, depth, bool(arrays["grown"])


def node_rows(tree: Any) -> tuple[np.ndarray, np.ndarray, int]:
    """Convert a scikit-learn tree to the nodes of the op ``tree``.

    scikit-learn goes left where x ≤ t in double precision, the op where x < t' in single precision: t' is the next
    float after the largest that is not above t.

    Args:
        tree: ``tree_`` of a scikit-learn decision tree.

    Returns:
        [n, 4] float32 nodes, the leaf number by scikit-learn's node number, and the number of levels.
    """
    left, right = tree.children_left, tree.children_right
    inner = left >= 0
    number = np.where(inner, np.cumsum(inner) - 1, np.cumsum(~inner) - 1)
    if not inner.any():
        return np.array([[0, 0, -1, -1]], np.float32), number, 1
    below = tree.threshold[inner].astype(np.float32)
    below = np.where(below > tree.threshold[inner], np.nextafter(below, np.float32(-np.inf)), below)
    threshold = np.nextafter(below, np.float32(np.inf))
    child = lambda c: np.where(inner[c], number[c], -1 - number[c])  # noqa: E731
    rows = np.stack([tree.feature[inner], threshold, child(left[inner]), child(right[inner])], axis=1)
    return rows.astype(np.float32), number, max(int(tree.max_depth), 1)


FIELD = SurfaceField("tree", PRESETS, TreeFit)
