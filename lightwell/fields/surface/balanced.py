"""Experts with continuous blending, balanced assignment and a lattice as the gate, without a gate network.

A lattice over the scene (``lattice.py``) gives the two of M small experts that shade a point and the share of
the second. It depends on position and normal alone, so that nothing changes abruptly when light or camera move, and it
costs table reads but no multiply-adds. The cells of the lattice are assigned to experts like this:

    start      k-means on position, normal and radiance under different lights (``cells.py``), with a minimum
               and a maximum for the samples of an expert;
    rounds     train all experts at once; the cost of a cell for an expert is the error on its samples; reassign the
               cells at the least total cost, within the same limits (``networks/assignment.py``);
    the rest   of the steps trains the experts with the last assignment.

Between cells of different experts the scores are interpolated. There two experts are blended, and both learn from the
samples there: the blend is continuous on every surface and the error at borders is that of the interior.

Each expert sees its inputs scaled to mean 0 and variance 1 over its own samples. The stored graph has the scaling
folded into the first layer.

Limits: a lattice with few steps cannot distinguish surfaces that are nearer to each other than a step and face the same
way.

M experts, N samples, F inputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from lightwell.fields.base import FieldSetup
from lightwell.fields.features import FeatureOctaves, open_builder
from lightwell.fields.surface.cells import Cells, balanced_means, describe
from lightwell.fields.surface.examples import Examples
from lightwell.fields.surface.field import SurfaceField
from lightwell.fields.surface.gate import append, share_facts, shares
from lightwell.fields.surface.lattice import Gate, Split, VertexLattice
from lightwell.fields.surface.lowering import as_radiance, graph_layers
from lightwell.fields.surface.segmented import NetworkPreset, SegmentedFit
from lightwell.files import Arrays, prefixed, under
from lightwell.graph import Graph, pack
from lightwell.graph.layers import Layer, add_layers
from lightwell.networks import TrainingSettings
from lightwell.networks.assignment import assign_cells
from lightwell.networks.batched import BatchedSet, BatchedTrainer
from lightwell.networks.grouped import GroupedRows, Runs, sort_into_runs
from lightwell.transport.samples import Query

# Share of all steps during which cells are reassigned, and the fewest steps between two rounds.
ROUNDS_SHARE, FEWEST_STEPS = 0.25, 25
# The shares of the experts are counted, and inputs scaled, on about so many samples; cells are assigned by more.
COUNTED, DEALT = 1 << 18, 1 << 20
# Samples per cell that estimate its cost, and the largest magnitude of the squared relative error of one of them.
PRICED_SAMPLES, LARGEST_PRICE = 96, 4.0
# Times that the limits are tightened, because the border of the stored gate runs through cells.
CORRECTIONS = 10
# ... and the margin beyond what they were missed by, relative to an equal share.
TIGHTER = 0.01
# Least standard deviation that an input is scaled by: normals of a flat region have none.
LEAST_SPREAD = 0.1
# Offset from the seeds of the first split.
EXPERT_SEED = 7919


@dataclass(frozen=True)
class BalancedPreset(NetworkPreset):
    """Settings of a ``balanced`` field."""

    experts: int = 16
    cells: int = 12
    """Steps of the lattice along the longest edge of the scene."""
    floor: float = 0.3
    """Least share of the samples that an expert has, relative to an equal share."""
    cap: float = 1.3
    """Largest share, likewise."""
    rounds: int = 3
    """Number of reassignments of the cells; fewer in short trainings."""
    compactness: float = 1.0
    """Cost of a neighbour with another expert, relative to the mean cost of a cell at its best expert."""
    passes: int = 0
    """How often the scores are averaged over neighbouring cells: 0 blends over one step of the lattice."""


# Four times the rate of other small networks, which inputs of mean 0 and variance 1 allow: of 1e-2 to 8e-2 this ended
# best on the Cornell box.
_TRAINING = TrainingSettings(rate=4e-2, batch=1024)
_OCTAVES = FeatureOctaves(position=0, light=1)

PRESETS: dict[str, BalancedPreset] = {
    "default": BalancedPreset(_TRAINING, "lean", hidden=(20, 16), octaves=_OCTAVES),
    "large": BalancedPreset(_TRAINING, "lean", hidden=(28, 20), octaves=_OCTAVES, experts=32, cells=16),
}


class BalancedFit(SegmentedFit):
    """See ``lightwell.fields.base.Learner``."""

    preset: BalancedPreset

    def __init__(self, setup: FieldSetup, preset: BalancedPreset, seed: int) -> None:
        """Start a fit.

        Args:
            setup: Bounds, light and radiance unit of the scene.
            preset: Settings.
            seed: Seed of weights and clusters.
        """
        super().__init__(setup, preset, seed)
        self.facts |= {"gate": "lattice", "curves": {}}
        self._trainer = BatchedTrainer(self.mlp, preset.training, seed * EXPERT_SEED + np.arange(preset.experts))
        # Number of assignments of cells so far, and the assignment by which the inputs are scaled.
        self._dealt = self._scaled = 0
        # The gate by which the experts are trained now; mean and spread [M, F] of each one's inputs.
        self._gate: Any = None
        self._center = np.zeros((preset.experts, self._inputs.width), np.float32)
        self._spread = np.ones_like(self._center)
        # Gate and weights with the least validation error.
        self._best_gate: Gate | None = None
        self._best = self._trainer.parameters
        # Computed from the samples when needed: training set; how the validation samples are split.
        self._data: Any = None
        self._watched: Any = None

    @property
    def macs(self) -> int:
        """Multiply-accumulates of two experts; the gate has none."""
        return 2 * self.mlp.macs

    @property
    def weights(self) -> dict[str, np.ndarray]:
        """Weights of the experts at the least validation error of the whole, for inputs as they are."""
        return self._best

    @property
    def gate(self) -> Gate:
        """Return the gate that belongs to ``weights``.

        Returns:
            The gate.

        Raises:
            RuntimeError: The field is not trained yet.
        """
        if self._best_gate is None:
            raise RuntimeError("balanced: there is no gate before the first training; call train")
        return self._best_gate

    def segment(self, query: Query) -> np.ndarray:
        """Find the expert with the larger share of each point.

        Args:
            query: N queries.

        Returns:
            [N] int expert.
        """
        return self.gate(query).first

    def _outputs(self, examples: Examples, weights: dict[str, np.ndarray] | None = None) -> np.ndarray:
        """[N, 3] outputs in unit S, blended; weights: None for the best so far."""
        return self._blended(examples.features, self.gate(examples.query), weights or self.weights)

    def predict(self, query: Query) -> np.ndarray:
        """Predict radiance with the best weights so far, before they are quantised.

        Args:
            query: N queries.

        Returns:
            [N, 3] radiance, reflectance included.
        """
        scale = self._setup.unit * (query.reflectance if self.preset.demodulated else 1.0)
        return self._blended(self._inputs.rows(query), self.gate(query), self.weights) * scale

    def _blended(self, features: np.ndarray, split: Split, weights: dict[str, np.ndarray]) -> np.ndarray:
        out = GroupedRows(features, split.first, self.preset.experts).evaluate(self.mlp, weights)
        band = split.band
        second = GroupedRows(features[band], split.second[band], self.preset.experts).evaluate(self.mlp, weights)
        out[band] += (second - out[band]) * split.share[band, None]
        return out

    def _rearrange(self) -> None:
        self._data = self._watched = None

    # ------------------------------------------------------------------ assignment of the cells

    @property
    def _counted(self) -> Query:
        """Evenly spread samples on which shares are counted."""
        return self.examples.query[:: max(len(self.examples) // COUNTED, 1)]

    @property
    def _dealing(self) -> Examples:
        """Evenly spread samples by which cells are assigned."""
        stride = max(len(self.examples) // DEALT, 1)
        return self.examples if stride == 1 else self.examples.take(np.arange(0, len(self.examples), stride))

    def _due(self, total: int) -> int:
        """Number of assignments of the cells that are due by now."""
        rounds = min(self.preset.rounds, int(ROUNDS_SHARE * total / FEWEST_STEPS))
        if not rounds:
            return 1
        return 1 + min(int(self.state.step * rounds / (ROUNDS_SHARE * total)), rounds)

    def _deal(self) -> None:
        """Assign every cell to an expert: initially by k-means, later by the measured error per expert."""
        preset, examples = self.preset, self._dealing
        lattice = self._gate.lattice if self._gate else VertexLattice.around(self._setup, examples.query, preset.cells)
        cells = Cells.of(lattice, examples)
        limits = preset.floor / preset.experts, preset.cap / preset.experts
        if self._gate is None:
            points = describe(cells, examples)
            looks = balanced_means(points, cells.weight, preset.experts, limits, self._seed)
            price = 1.0 - np.eye(preset.experts)[looks]
        else:
            price = self._prices(cells, examples)
        before = self._gate
        self._gate = self._within(limits, lattice, cells, price)
        self._describe(before, cells)
        self._dealt += 1
        self._data = self._watched = None

    def _within(self, limits: tuple[float, float], lattice: VertexLattice, cells: Cells, price: np.ndarray) -> Gate:
        """Find the gate of least cost whose experts keep the limits on the training samples.

        Cells keep them at once; the border of the gate runs through cells, so that a correction may be needed.
        """
        (floor, cap), experts = limits, self.preset.experts
        least, most = limits
        for _ in range(CORRECTIONS):
            expert = assign_cells(price, cells.weight, least, most)
            gate = Gate(lattice, lattice.scores(cells.number, expert, experts, self.preset.passes))
            share = shares(gate(self._counted).first, experts)
            if floor <= share.min() and share.max() <= cap:
                break
            # The limits move at most half of the way to equal shares.
            least += TIGHTER / experts + floor - share.min() if share.min() < floor else 0
            most -= TIGHTER / experts + share.max() - cap if share.max() > cap else 0
            least, most = min(least, 0.5 * (floor + 1 / experts)), max(most, 0.5 * (cap + 1 / experts))
        return gate

    def _prices(self, cells: Cells, examples: Examples) -> np.ndarray:
        """[K, M] cost of each cell per expert: noise-corrected squared error, plus neighbours of other experts."""
        rows = cells.pick(PRICED_SAMPLES, self._seed + self._dealt)
        part, weights = examples.take(rows), self._folded()
        of_sample, price = cells.of_sample[rows], np.empty((len(cells), self.preset.experts))
        count = np.bincount(of_sample, minlength=len(cells))
        for e in range(self.preset.experts):
            output = self.mlp.evaluate({name: value[e] for name, value in weights.items()}, part.features)
            square = np.clip(part.corrected_square(output), -LARGEST_PRICE, LARGEST_PRICE)
            price[:, e] = np.bincount(of_sample, square, len(cells)) / count
        touching = self._touching(cells)
        # The cost of neighbouring cells counts as much, because costs are noisy and regions should be connected.
        price = 0.5 * (price + touching @ price)
        owned = np.eye(self.preset.experts)[self._owner(self._gate, cells)]
        return price + self.preset.compactness * max(price.min(axis=1).mean(), 0) * (1 - touching @ owned)

    def _owner(self, gate: Gate, cells: Cells) -> np.ndarray:
        """[K] expert of each cell."""
        return gate.scores.reshape(len(gate.lattice), -1)[cells.number].argmax(axis=1)

    def _touching(self, cells: Cells) -> sparse.csr_array:
        """[K, K] mean over the cells that touch a cell; a cell without neighbours is its own mean."""
        pairs = self._gate.lattice.neighbours(cells.number)
        alone = np.setdiff1d(np.arange(len(cells)), pairs[:, 0])
        row, column = np.concatenate([pairs, np.stack([alone, alone], axis=1)]).T
        count = np.bincount(row, minlength=len(cells))
        return sparse.csr_array((1 / count[row], (row, column)), shape=(len(cells), len(cells)))

    def _describe(self, before: Gate | None, cells: Cells) -> None:
        """Add a point to the curves."""
        owner = self._owner(self._gate, cells)
        moved = 1.0 if before is None else float(cells.weight[owner != self._owner(before, cells)].sum())
        share = shares(self._gate(self._counted).first, self.preset.experts)
        values = {"moved": round(moved, 4), "share": [round(float(s), 4) for s in share]}
        append(self.facts["curves"], step=self.state.step, **values)
        self.facts |= {"cells": len(cells), "lattice": list(self._gate.lattice.shape)}

    # ------------------------------------------------------------------ fit

    def _arrange(self) -> None:
        """Assign every sample to its expert, and samples of two experts to both."""
        examples, experts = self.examples, self.preset.experts
        split = self._gate(examples.query)
        row = np.concatenate([np.arange(len(examples)), split.band])
        group = np.concatenate([split.first, split.second[split.band]])
        order, runs = sort_into_runs(group, experts, (self._seed, len(examples), self._dealt))
        row = row[order]
        features = examples.features[row]
        if self._scaled < self._dealt:
            self._scale(features, runs)
        for e, (first, count) in enumerate(zip(runs.first, runs.count)):
            own = features[first : first + count]
            own -= self._center[e]
            own /= self._spread[e]
        self._data = BatchedSet.from_numpy(features, examples.target[row], examples.weight[row], runs)

    def _scale(self, features: np.ndarray, runs: Runs) -> None:
        """Scale the inputs of each expert by its current samples; the outputs of the experts do not change."""
        folded = self._folded() if self._scaled else None
        most = max(COUNTED // len(runs), 1)
        for e, (first, count) in enumerate(zip(runs.first, runs.count)):
            if count:  # rows of a run are in random order
                own = features[first : first + min(count, most)].astype(np.float64)
                self._center[e], self._spread[e] = own.mean(axis=0), np.maximum(own.std(axis=0), LEAST_SPREAD)
        if folded:
            arrays = self._trainer.arrays()
            arrays["value.w0"] = folded["w0"] * self._spread[:, :, None]
            arrays["value.b0"] = folded["b0"] + np.einsum("ef,efo->eo", self._center, folded["w0"])[:, None]
            self._trainer.restore(arrays)
        self._scaled = self._dealt

    def _folded(self) -> dict[str, np.ndarray]:
        """[M, …] current weights for inputs as they are: W (x − c) / s + b = (W / s) x + (b − (W / s) c)."""
        weights = self._trainer.parameters
        weights["w0"] = weights["w0"] / self._spread[:, :, None]
        weights["b0"] = weights["b0"] - np.einsum("ef,efo->eo", self._center, weights["w0"])[:, None]
        return weights

    def _step(self, total: int) -> bool:
        if self._dealt < self._due(total):
            self._deal()
        if self._data is None:
            self._arrange()
        self._last = self._trainer.step(self._data, total)
        self.state.samples_seen += self.preset.training.batch * self.preset.experts
        return False

    def _look(self) -> tuple[float, float]:
        validation, weights = self._validation, self._folded()
        if self._watched is None:
            self._watched = self._gate(validation.query)
        each = validation.relative_error(self._blended(validation.features, self._watched, weights))
        error = float(each.mean())
        if error < self.state.best_error:
            self._best, self._best_gate = weights, self._gate
            self._judge(each)
        losses = self._trainer.losses(self._last)
        return float(losses @ self._data.runs.count / self._data.runs.count.sum()), error

    def _judge(self, each: np.ndarray) -> None:
        """Facts about the gate that is kept; each: [N] errors on the validation samples."""
        first, two = self._gate(self._counted).first, self._watched.share > 0
        share = shares(first, self.preset.experts)
        self.facts |= share_facts(first, self.preset.experts)
        facts: dict[str, Any] = {
            "smallest_share": share.min() * len(share),
            "largest_share": share.max() * len(share),
            "band": two.mean(),
        }
        if two.any() and not two.all():
            border, interior = each[two].mean(), each[~two].mean()
            facts |= {"border_error": border, "interior_error": interior, "border_over_interior": border / interior}
        self.facts |= {name: round(float(value), 4) for name, value in facts.items()}

    # ------------------------------------------------------------------ lower

    def lower(self) -> Graph:
        """Return the shading graph: the gate stored as bytes, two experts per pixel and their blend.

        Returns:
            The graph.
        """
        b = open_builder()
        x, top = self._inputs.node(b), self.gate.node(b)
        first, second, share = (b.slice(top, k, 1) for k in range(3))
        layers = self._packed()
        blend = b.blend(share, *(add_layers(b, x, layers, self.mlp.activations, index) for index in (first, second)))
        radiance = as_radiance(b, blend, self.preset.demodulated, self._setup.unit)
        return b.build(radiance=radiance, segment=first, overlap=share, second=second)

    def _packed(self) -> list[Layer]:
        """Layers as they are stored; both experts of a pixel read the same buffers.

        The first layer's biases stay float32: they hold the offset of the inputs, which is large beside their spread.
        """
        kinds = (("float16" if k else "float32") for k in range(self.mlp.layers))
        layers = graph_layers(self.weights, range(self.mlp.layers))
        return [(pack(weight, self.preset.storage), pack(bias, kind)) for (weight, bias), kind in zip(layers, kinds)]

    # ------------------------------------------------------------------ checkpoints

    _varying = ("gate.", "best_gate.")

    def _arrays(self) -> Arrays:
        arrays = {"counts": np.array([self._dealt, self._scaled]), "center": self._center, "spread": self._spread}
        arrays |= prefixed("trainer", self._trainer.arrays()) | prefixed("best", self._best)
        for name, gate in (("gate", self._gate), ("best_gate", self._best_gate)):
            arrays |= prefixed(name, gate.arrays() if gate else {})
        return arrays

    def _restore(self, arrays: Arrays) -> None:
        self._dealt, self._scaled = (int(n) for n in arrays["counts"])
        self._center, self._spread = arrays["center"].copy(), arrays["spread"].copy()
        self._trainer.restore(under("trainer", arrays))
        self._best = under("best", arrays)
        self._gate, self._best_gate = (
            Gate.of(found) if (found := under(name, arrays)) else None for name in ("gate", "best_gate")
        )


FIELD = SurfaceField("balanced", PRESETS, BalancedFit)
