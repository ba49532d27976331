"""The field of the scene's own lamps: every group has a switch, a dimmer and a colour, at the price of one field.

See ``lightwell.networks.lamps``. The graph has one frame input, ``lamps``: what each group is multiplied by, red of all
groups, then green, then blue. The layers of the groups are added up by ``per_frame`` nodes.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from lightwell.core.formats import ARRAYS, JSON
from lightwell.fields.base import UNIT_FACTOR, FieldSetup, around_samples, usual_level
from lightwell.fields.features import grid_point, local_features, open_builder
from lightwell.fields.protocol import GoodEnough, Lowered, State, Training
from lightwell.fields.surface.clock import Clock
from lightwell.fields.surface.field import SurfaceFit
from lightwell.fields.surface.lamp_samples import LampSamples, LampTraining
from lightwell.fields.surface.lowering import graph_layers
from lightwell.fields.surface.plan import FEWEST_STEPS, timed_step
from lightwell.fields.surface.sample_weights import by_object
from lightwell.fields.tabulate import Tabulated
from lightwell.graph import Buffer, Builder, Graph, pack
from lightwell.graph.layers import add_layers
from lightwell.networks import Trainer, TrainingSettings
from lightwell.networks.checkpoint import restore
from lightwell.networks.hashgrid import HashGrid
from lightwell.networks.lamps import LampNetwork, LampSet
from lightwell.networks.losses import EPSILON
from lightwell.transport.samples import Query

# Against four times the batch, a quarter of the steps and 'adam', in the same time, all lamps on, where people look:
# needle-lightmap-house 22 to 20 %, loft 13.2 to 12.7 %, pyraxia-hallway 55 to 49 %. The loss with the power 1.5 against
# 'relative2', equal steps, the same error: staircase2 20 to 13 %, pyraxia-hallway 61 to 48 %, needle-lightmap-house 22
# to 21 %, loft, veach-bidir, veach-ajar 1 to 3 % less of it, bevy-cornell 5.6 to 5.9 %, living-room-2 38 to 43 %; over
# all surfaces nowhere more, 6 % less in the geometric mean. A grid of what glossy surfaces reflect: staircase2 13 to
# 11 %, but bevy-cornell 5.9 to 10 %, because each point has one view here.
_TRAINING = TrainingSettings(
    loss="relative1_5_to_white", optimiser="adam_grid", rate=2e-2, batch=1 << 11, evaluate_every=100, patience=0
)
# How far above the surface the grid is read, in cells of its finest level.
LIFT = 0.5
# Random settings of the dimmers that are trained beside each group alone and all together.
RANDOM_STATES = 8
CHECKPOINT, CLOCK = "lamps.checkpoint", "clock"


@dataclass(frozen=True)
class LampPreset:
    """Settings of the field of the lamps."""

    grid: HashGrid
    hidden: tuple[int, ...] = (48, 48)
    training: TrainingSettings = _TRAINING
    table_storage: str = "int8"
    storage: str = "float16"


# By quality; no larger than the field of a scene whose lights have no switch.
PRESETS = {
    "draft": LampPreset(HashGrid(levels=3, base=7, growth=1.9, entries_log2=12, decay=(0.0, 0.2, 2.0)), (32, 32)),
    "good": LampPreset(HashGrid(levels=4, base=7, growth=1.7, entries_log2=13, decay=(0.0, 0.2, 2.0, 6.0))),
    "best": LampPreset(
        HashGrid(levels=5, base=7, growth=1.7, entries_log2=15, decay=(0.0, 0.2, 2.0, 6.0, 18.0)), (64, 64)
    ),
}


def state_matrix(groups: int, seed: int) -> np.ndarray:
    """Choose the settings of the dimmers that are trained: each group alone, all, and random switches.

    Args:
        groups: K.
        seed: Seed of the random ones.

    Returns:
        [S, K] factors, each 0 or 1.
    """
    alone, together = np.eye(groups), np.ones((1, groups))
    if groups == 1:
        return alone
    random = (np.random.default_rng([seed, 0x51]).random((RANDOM_STATES, groups)) < 0.5).astype(np.float64)
    return np.concatenate([alone, together, random[random.sum(axis=1) > 0]])


def facts_of_states(names: Sequence[str], states: np.ndarray, errors: Sequence[float]) -> dict[str, Any]:
    """Name the errors of the settings of the dimmers, for the report.

    Args:
        names: K groups.
        states: [S, K] what ``state_matrix`` returned.
        errors: Relative error of each setting.

    Returns:
        Error of each group alone, of all, and of random switches: their mean, and the worst with the groups that
        are on.
    """
    groups = len(names)
    facts: dict[str, Any] = {"error_of_each_lamp": dict(zip(names, errors))}
    if groups > 1:
        facts["error_of_all_lamps"] = errors[groups]
    if len(errors) > groups + 1:
        worst = groups + 1 + int(np.argmax(errors[groups + 1 :]))
        on = [name for name, factor in zip(names, states[worst]) if factor]
        facts["error_of_random_lamps"] = float(np.mean(errors[groups + 1 :]))
        facts["worst_random_lamps"] = {"relative_error": errors[worst], "on": on}
    return facts


@dataclass
class LampsFit:
    """A learner of the lamps; it has what ``lightwell.fields.surface.field.SurfaceFit`` asks of one."""

    setup: FieldSetup
    preset: LampPreset
    names: tuple[str, ...]
    """Names of the K groups."""
    seed: int
    network: LampNetwork = field(init=False)

    def learn_from(self, samples: LampSamples) -> None:
        """Set the training samples, in random order.

        Args:
            samples: Shares at N points.
        """
        self._inputs = Tabulated(self._input_graph())
        self.network = self._network(samples)
        self._trainer = Trainer(self.network, self.preset.training, self.seed)
        target = samples.radiance / samples.query.reflectance[:, None]
        # Each group has a unit of its own: a dim lamp alone is looked at with another exposure.
        self.units = np.maximum(UNIT_FACTOR * usual_level(target.mean(axis=2)), 1e-12 * self.setup.unit)
        self._states = state_matrix(len(self.names), self.seed)
        whole = self._states @ self.units
        # [3 K, 3 S]: the same for red, green and blue.
        matrix = np.kron((self._states * self.units / whole[:, None]).T, np.eye(3))
        order = self._order(samples)
        weight = by_object(samples.shape, np.ones(len(samples.shape)))[order]
        rows = (target / self.units[:, None]).reshape(len(target), -1)[order]
        self._data = self._set(samples.query, order, rows, weight / weight.mean(), matrix)

    def validate_on(self, samples: LampSamples) -> None:
        """Set the held-out samples of early stopping.

        Args:
            samples: Shares at N points.
        """
        self._validation = (self.rows(samples.query), samples.radiance, samples.query.reflectance[:, None])

    def train(self, until: int, total: int, progress: Any = None, checkpoint: Callable[[], None] | None = None) -> bool:
        """Train; ``learn_from`` and ``validate_on`` come first.

        Args:
            until: Step to train to.
            total: Steps of the schedule.
            progress: Called with the state and ``total`` after each evaluation.
            checkpoint: Called when a checkpoint is due.

        Returns:
            Whether early stopping ended the training.
        """
        return self._trainer.fit(self._data, self._error, until, total, progress, checkpoint)

    @property
    def state(self) -> Any:
        """Steps, errors and history of the training."""
        return self._trainer.state

    @property
    def trainer(self) -> Trainer[LampNetwork]:
        """The training itself, for checkpoints."""
        return self._trainer

    @property
    def macs(self) -> int:
        """Multiply-adds per pixel, the same for any number of groups."""
        return self.network.macs

    @property
    def facts(self) -> dict[str, Any]:
        """Errors of switch states at held-out points, for the report."""
        return facts_of_states(self.names, self._states, self.state_errors(self._trainer.best))

    def state_errors(self, parameters: dict[str, np.ndarray], bounded: bool = False) -> list[float]:
        """Compute the relative error of every trained state at the held-out points, its reference's noise included.

        Args:
            parameters: Weights [...] by name.
            bounded: Divide by the larger one of learned and reference, so that a few places in the dark are not most
                of the error.

        Returns:
            One number per row of ``state_matrix``.
        """
        rows, reference, scale = self._validation
        identity = np.eye(3 * len(self.names), dtype=np.float32)
        output = self.network.evaluate(parameters, (*rows, identity)).reshape(reference.shape)
        shares, errors = output * self.units[:, None] * scale, []
        for state in self._states:
            f, y = (np.einsum("k,nkc->nc", state, x) for x in (shares, reference))
            unit = 4 * max(float(y.mean()), 1e-30)
            below = np.maximum(f, y) if bounded else y
            errors.append(float(np.mean(np.abs(f - y) / (below + EPSILON * unit))))
        return errors

    def _error(self, parameters: dict[str, np.ndarray]) -> float:
        return float(np.mean(self.state_errors(parameters, bounded=True)))

    # ------------------------------------------------------------------ data

    def _network(self, samples: LampSamples) -> LampNetwork:
        """The untrained network for samples."""
        return LampNetwork(self.preset.grid, self._inputs.width("pixel"), len(self.names), self.preset.hidden)

    def _order(self, samples: LampSamples) -> np.ndarray:
        """Rows that are trained, in random order."""
        return np.random.default_rng((self.seed, len(samples.shape))).permutation(len(samples.shape))

    def rows(self, query: Query) -> tuple[np.ndarray, ...]:
        """Compute what the network reads at points.

        Args:
            query: N points.

        Returns:
            Grid points [N, 3] and other inputs [N, G].
        """
        table = self._inputs(query)
        return table["point"], table["pixel"]

    def _set(
        self, query: Query, order: np.ndarray, target: np.ndarray, weight: np.ndarray, states: np.ndarray
    ) -> LampSet:
        """The rows of an order on the device; ``target`` and ``weight`` are in that order."""
        points, pixel = self.rows(query)
        return LampSet.from_numpy(points[order], pixel[order], target, weight, states)

    # ------------------------------------------------------------------ graph

    def _builder(self) -> Builder:
        """A graph with the inputs of the field."""
        return open_builder(self.setup.relief, len(self.names))

    def _nodes(self, b: Builder) -> tuple[str, str]:
        """(place in the grid, other inputs of a pixel)."""
        normal = "shading_normal" if self.setup.relief else "normal"
        lift = LIFT / self.preset.grid.layout[-1].cells
        return grid_point(b, self.setup, lift), b.concat(*local_features(b, self.setup, normal))

    def _input_graph(self) -> Graph:
        b = open_builder(self.setup.relief, movers=self.setup.movers)
        point, pixel = self._nodes(b)
        return b.build(point=point, pixel=pixel)

    def lower(self) -> Graph:
        """Return the shading graph: the layers of the groups added up per frame; grid, trunk and the sum per pixel.

        Returns:
            The graph.
        """
        b, small = self._builder(), partial(pack, type=self.preset.storage)
        x = self._trunk(b, small)
        merged = self._merged(b, small)
        return b.build(radiance=b.matvec(b.concat(*merged, per_frame=True), x, 3))

    def _trunk(self, b: Builder, small: Callable[[np.ndarray], Buffer]) -> str:
        """Features of the trunk."""
        weights = self._trainer.best
        x = b.activate(self._first(b, small, weights["b0"][0]), self.network.activations[0])
        rest = graph_layers(weights, range(1, len(self.network.hidden)), small)
        return add_layers(b, x, rest, self.network.activations[1:])

    def _first(self, b: Builder, small: Callable[[np.ndarray], Buffer], bias: np.ndarray) -> str:
        """The trunk's first layer, without its activation."""
        point, pixel = self._nodes(b)
        weights, grid = self._trainer.best, self.preset.grid
        values, steps = grid.even(weights["grid"])
        table = pack(values, self.preset.table_storage, per_row=False)
        u = b.hashgrid(point, table, grid.levels, grid.base, grid.growth, grid.entries_log2)
        first = np.concatenate([weights["grid_w"] * steps[:, None], weights["pixel_w"]])
        return b.linear(b.concat(u, pixel), small(first.T), small(bias))

    def _dimmers(self, b: Builder) -> str:
        """What each group's layer is multiplied by: red of all groups, then green, then blue."""
        # Units are numbers of the graph, not of the buffers: a dim lamp keeps its precision.
        return b.affine("lamps", np.tile(self.units, 3), np.zeros(3 * len(self.names)), per_frame=True)

    def _merged(self, b: Builder, small: Callable[[np.ndarray], Buffer]) -> list[str]:
        """The layers of all groups, added up; one node per colour."""
        groups, width = len(self.names), self.network.hidden[-1]
        dimmers = self._dimmers(b)
        layers, none = np.square(self._trainer.best["lamps"]).reshape(width, groups, 3), small(np.zeros(width))
        return [
            b.linear(
                b.slice(dimmers, channel * groups, groups, per_frame=True), small(layers[..., channel]), none,
                per_frame=True,
            )
            for channel in range(3)
        ]  # fmt: skip


# ---------------------------------------------------------------------- fit


def fit_lamps(state: State, samples: LampTraining, kind: type[LampsFit] = LampsFit) -> SurfaceFit:
    """Train the field of the lamps in the time that is left of the budget, from the checkpoint where there is one.

    Args:
        state: The prepared scene.
        samples: Its samples.
        kind: The learner.

    Returns:
        The finished fit.
    """
    job = state.job
    part = job.work.part(role="static", lamps=[group.name for group in state.lamps])
    learner, found = _prepared(state, samples, kind), part.find(CHECKPOINT, ARRAYS)
    clock = Clock(found.pop(CLOCK, None)) if found else Clock()
    if found:
        try:
            restore(learner.trainer, found)
        except ValueError as error:
            job.progress.say(f"[yellow]lamps: trained anew:[/] {error}")
            learner, clock = _prepared(state, samples, kind), Clock()
    with job.work.timed("plan"):
        steps = job.request.steps or part.get("plan.lamps.steps", partial(_steps, state, samples, kind), JSON)
    with job.work.timed("train"), job.progress.stage("train lamps", steps, "steps") as stage:

        def look(training: Any, _: int) -> None:
            clock.mark(training.step)
            stage.move_to(training.step, f"error {training.best_error:.1%}")
            clock.skip(job.wait())

        def save() -> None:
            part.put(CHECKPOINT, {**learner.trainer.arrays(), CLOCK: clock.array()}, ARRAYS)

        with contextlib.suppress(GoodEnough):
            learner.train(steps, steps, look, checkpoint=save)
    curve = [(clock.at(step), error) for step, _, error in learner.state.history]
    plan = {"lamp_points": len(samples.training.shape), "lamp_steps": steps}
    training = Training(clock.seconds, learner.state.step, curve)
    return _LampSurfaceFit(state.scene, learner, samples.unit, samples.traced, plan, training)


@dataclass
class _LampSurfaceFit(SurfaceFit):
    """A fit whose graph is scored with all lamps as the scene has them."""

    def lower(self) -> Lowered:
        """Return the shading graph, and its dimmers as the scene has them.

        Returns:
            The graph and the input that all points share.
        """
        graph = self.learner.lower()
        return replace(Lowered(graph), frame={"lamps": np.ones(graph.inputs["lamps"], np.float32)})


def _prepared(state: State, samples: LampTraining, kind: type[LampsFit]) -> LampsFit:
    request = state.job.request
    setup = FieldSetup.of(state.scene, samples.unit, "static")
    setup = around_samples(setup, samples.training.whole())
    names = tuple(group.name for group in state.lamps)
    learner = kind(setup, PRESETS[request.quality], names, request.seed)
    learner.learn_from(samples.training)
    learner.validate_on(samples.validation)
    return learner


def _steps(state: State, samples: LampTraining, kind: type[LampsFit]) -> int:
    """Steps for the time that is left, by the time of some on a learner of their own."""
    scratch = _prepared(state, samples, kind)
    every = PRESETS[state.job.request.quality].training.evaluate_every
    cost = timed_step(scratch.train, every)
    return max(math.floor((samples.end - state.job.work.elapsed) / max(cost, 1e-6)), FEWEST_STEPS)
