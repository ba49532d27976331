"""Factored light transport: a hash grid of features over the scene, and a layer whose weights depend on the light.

A pixel costs a few table reads and two small layers, because everything about the light alone is computed once per
frame by a network that may be large. See ``lightwell.networks.factored`` for the formula.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np

from lightwell.core.lamps import parse_lamps
from lightwell.core.vary import parse_vary
from lightwell.core.work import WorkPart
from lightwell.fields.base import FieldSetup, Learner
from lightwell.fields.features import grid_point, light_features, local_features, mirrored_point, open_builder
from lightwell.fields.protocol import Job, Role, State, further_role, kind_of
from lightwell.fields.surface.field import SurfaceField, SurfaceFit
from lightwell.fields.surface.lamp_samples import LampTraining, trace_lamps
from lightwell.fields.surface.lamps import LampsFit, fit_lamps
from lightwell.fields.surface.lowering import graph_layers
from lightwell.fields.surface.network_fit import NetworkFit
from lightwell.fields.surface.options import SurfaceOptions
from lightwell.fields.surface.posed_lamp_samples import PosedLampTracer
from lightwell.fields.surface.posed_lamps import PosedLampsFit
from lightwell.fields.surface.poses import moving_state
from lightwell.fields.surface.sample_weights import by_object
from lightwell.fields.surface.training import SurfaceSamples
from lightwell.fields.tabulate import Tabulated
from lightwell.graph import Buffer, Builder, Graph, pack
from lightwell.graph.layers import add_layers
from lightwell.networks import Trainer, TrainingSettings
from lightwell.networks.factored import FactoredNetwork
from lightwell.networks.hashgrid import HashGrid
from lightwell.networks.light_major import LightMajorSet, light_runs
from lightwell.scenes.lamps import group_lamps
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.posing import declared_movers
from lightwell.scenes.variables import Variable, by_light, declare, surrounds
from lightwell.transport.samples import Query, Samples

# Without decay, fine levels fit the noise of the samples; the coarsest level holds the smooth part. Four scenes, 3,000
# steps: decay (0, 0.1, 1, 3) 0.05 to 0.06 mottle, (0, 0.2, 2, 6) 0.046, ten times the first -0.8 dB in a house; growth
# 1.9 in place of 2 for a light network of 128 and 64 units +0.3 dB on average.
_DEFAULT_GRID = HashGrid(levels=4, base=7, growth=1.9, entries_log2=15, decay=(0.0, 0.2, 2.0, 6.0))
# 'adam_grid' against 'adam', 1,500 steps: courtyard +0.46 dB, veach-ajar +0.47, modern-house +0.34, drake-living-room
# +0.10, recast-dungeon +0.05.
_DEFAULT_TRAINING = TrainingSettings(
    loss="relative1_5", optimiser="adam_grid", rate=2e-2, batch=1 << 13, evaluate_every=200, patience=0
)


# How far above the surface the grid is read, in cells of its finest level.
LIFT = 0.5


@dataclass(frozen=True)
class FactoredPreset:
    """Settings of a ``factored`` field."""

    grid: HashGrid = _DEFAULT_GRID
    light_hidden: tuple[int, ...] = (128, 64)
    hidden: tuple[int, ...] = (28, 16)
    mirror: HashGrid | None = None
    """Grid that is read where the mirrored ray leaves the scene, for scenes with glossy surfaces ..."""
    glossy_hidden: tuple[int, ...] | None = None
    """... and the units of the hidden layers there; None: ``hidden``."""
    light_octaves: int = 4
    light_falloff: float = 0.5
    training: TrainingSettings = _DEFAULT_TRAINING
    table_storage: str = "int8"
    """Type of the stored grid and of the light network's last layer, which is most of it."""
    storage: str = "float16"
    """Type of all other weights."""


# 3,000 steps, 300 kB with it: veach-ajar +1.9 dB, drake +0.5, living-room-2 +0.5, courtyard, whose box is not that of a
# room, +0.1.
_MIRROR = HashGrid(levels=2, base=7, growth=2, entries_log2=13)

# Where something moves, each pose has few samples of the scene's own light, each of one view: the grids fitted them as
# white specks and streaks (doorway, at defaults, looked at). Decay of the main grid times this, and of the mirror,
# which has none elsewhere: +0.2 dB (courtyard) and -0.2 dB (drake-living-room). Three times in place of ten: -1.9 dB
# (doorway, 4,000 steps, four times as many points).
_MOVING_DECAY, _MOVING_MIRROR_DECAY = 10.0, (1.0, 10.0, 30.0)
# Units of the light network's first layer at most where poses are among its inputs: below 300 kB with a sky, too.
_MOVING_UNITS = 120

PRESETS: dict[str, FactoredPreset] = {
    "default": FactoredPreset(mirror=_MIRROR, glossy_hidden=(24, 16)),
    # As small as the report's ten experts.
    "small": FactoredPreset(
        HashGrid(levels=3, base=4, growth=2, entries_log2=8), light_hidden=(32, 12), hidden=(36, 20), storage="int8"
    ),
    # For furnished rooms, in at most 250 kB: a wider head lowers the error more than a finer grid.
    "large": FactoredPreset(
        HashGrid(levels=3, base=8, growth=2, entries_log2=13, channels=8),
        light_hidden=(128, 64),
        hidden=(64, 32),
        storage="int8",
    ),
    # Of --quality draft and best: with a second field for the scene's own emitters at most 100 and 1,000 kB.
    "draft": FactoredPreset(
        HashGrid(levels=3, base=7, growth=2, entries_log2=12, decay=(0.0, 0.1, 1.0)), light_hidden=(32, 32)
    ),
    "best": FactoredPreset(
        HashGrid(levels=5, base=7, growth=2, entries_log2=15, decay=(0.0, 0.2, 2.0, 6.0, 20.0)),
        hidden=(48, 24),
        mirror=replace(_MIRROR, levels=3),
    ),
}

# The default in scenes with light of their own: two fields, together at most 300 kB and, with glossy surfaces, 1,950
# multiply-adds. At most 1,500, by heads of 20-6 for the moving light, cost little at 1,000 steps (-0.12 dB, seven
# scenes), but the more at as many steps as a bake has (2,700: -1.8 dB in bevy-cornell, -0.1 dB in drake-living-room;
# whole bakes: six of six scenes worse, by 0.9 dB and a FLIP of 0.009). The scene's own light needs less.
TWO_FIELDS: dict[str, FactoredPreset] = {
    "indirect": FactoredPreset(
        replace(_DEFAULT_GRID, growth=1.7, entries_log2=14), mirror=_MIRROR, glossy_hidden=(24, 16)
    ),
    "static": FactoredPreset(
        HashGrid(levels=4, base=7, growth=1.6, entries_log2=14, decay=(0.0, 0.2, 2.0, 6.0)),
        hidden=(20, 12),
        mirror=replace(_MIRROR, levels=1),
        glossy_hidden=(12, 6),
    ),
}


# Lights, nodes and clips that vary in one bake, at most: what the runtime takes.
MOST_VARIABLES = 4


@dataclass
class FactoredFit(NetworkFit):
    """See ``lightwell.fields.base.Learner``."""

    preset: FactoredPreset
    network: FactoredNetwork = field(init=False)
    mirror: HashGrid | None = field(init=False)
    """Grid of what glossy surfaces reflect; None where no surface is glossy."""
    hidden: tuple[int, ...] = field(init=False)
    """Units of the hidden layers of the head."""
    _inputs: Tabulated = field(init=False)

    def __post_init__(self) -> None:
        preset = self.preset
        self.mirror = None if self.setup.matte else preset.mirror
        grid = preset.grid
        if self.setup.movers and self.setup.light == "static":
            grid = replace(grid, decay=tuple(_MOVING_DECAY * weight for weight in grid.decay))
            mirror = self.mirror
            self.mirror = mirror and replace(mirror, decay=_MOVING_MIRROR_DECAY[: mirror.levels])
        self.hidden = (preset.glossy_hidden if self.mirror else None) or preset.hidden
        b = open_builder(self.setup.relief, movers=self.setup.movers)
        point, pixel, frame = self._nodes(b)
        if self.mirror:
            point = b.concat(point, *self._mirrored(b))
        outputs = {"point": point, "pixel": b.concat(*pixel)} | ({"frame": b.concat(*frame)} if frame else {})
        self._inputs = Tabulated(b.build(**outputs))
        width = self._inputs.width("frame") if frame else 0
        light_hidden = preset.light_hidden
        if self.setup.movers and self.setup.light != "static":
            light_hidden = (min(light_hidden[0], _MOVING_UNITS), *light_hidden[1:])
        self.network = FactoredNetwork(grid, self._inputs.width("pixel"), width, light_hidden, self.hidden, self.mirror)
        self._trainer = Trainer(self.network, preset.training, self.seed)

    def _nodes(self, b: Builder) -> tuple[str, list[str], list[str]]:
        """(place in the grid, other inputs of a pixel, inputs of the light network)."""
        frame = light_features(b, self.setup, self.preset.light_octaves, self.preset.light_falloff)
        at = grid_point(b, self.setup, LIFT / self.preset.grid.layout[-1].cells)
        return at, local_features(b, self.setup, self._normal), frame

    @property
    def _normal(self) -> str:
        """Normal maps bend learned light as they bend direct light."""
        return "shading_normal" if self.setup.relief else "normal"

    @property
    def macs(self) -> int:
        """Multiply-accumulates per pixel; without table reads and the part that runs once per frame."""
        head = self.network.head_sizes
        first = (self.network.features + self.network.pixel) * head[0]
        return first + sum(a * b for a, b in pairwise(head))

    # ------------------------------------------------------------------ data

    def _rows(self, query: Query) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(points [N, 3] or [N, 7], pixel inputs [N, G], frame inputs [K, F]) of rows in light-major order."""
        table = self._inputs(query, "point", "pixel")
        return table["point"], table["pixel"], self._frames(query, light_runs(_frame_of(query)))

    def _frames(self, query: Query, run: int) -> np.ndarray:
        """Frame inputs [K, F] of rows in light-major order, of which ``run`` share a light."""
        if "frame" not in self._inputs.graph.outputs:
            return np.zeros((len(query) // run, 1), np.float32)
        return self._inputs(query[::run], "frame")["frame"]

    def learn_from(self, samples: Samples) -> None:
        """Set the training samples, ordered by light; whole lights are put in random order.

        Args:
            samples: Path-traced samples.
        """
        run = light_runs(_frame_of(samples.query))
        lights = np.random.default_rng((self.seed, len(samples))).permutation(len(samples) // run)
        shuffled = samples.in_runs(lights, run)
        target = shuffled.radiance / self._modulation(shuffled.query)
        finite = np.isfinite(target).all(axis=1)
        weight = np.where(finite, by_object(shuffled.shape, shuffled.weight), 0)
        target, weight = np.where(finite[:, None], target, 0), weight / max(weight.mean(), 1e-12)
        # Points and inputs of pixels are hundreds of megabytes, and stay on the device.
        table, frame = self._inputs.tensors(shuffled.query, "point", "pixel"), self._frames(shuffled.query, run)
        self._data = LightMajorSet.of(table["point"], table["pixel"], frame, target, weight[:, None])

    # ------------------------------------------------------------------ lower

    def lower(self) -> Graph:
        """Return the shading graph: the network of the light per frame; grid, predicted layer and head per pixel.

        Returns:
            The graph.
        """
        b = open_builder(self.setup.relief, movers=self.setup.movers)
        point, pixel, frame = self._nodes(b)
        weights, grid, act = self._trainer.best, self.preset.grid, self.network.activation
        values, steps = grid.even(weights["grid"])
        table = pack(values, self.preset.table_storage, per_row=False)
        u = b.hashgrid(point, table, grid.levels, grid.base, grid.growth, grid.entries_log2)
        if self.mirror:
            v, more = self._reflected(b)
            u, steps = b.concat(u, v), np.concatenate([steps, more])
        small = partial(pack, type=self.preset.storage)
        x = b.linear(b.concat(*pixel), small(weights["pixel_w"].T), small(np.zeros(self.hidden[0])))
        x = b.activate(b.add(x, self._emitted(b, u, frame, small, steps)), act)
        head = graph_layers(weights, range(len(self.hidden)), small)
        x = add_layers(b, x, head, self.network.head_activations)
        return b.build(radiance=b.scale(x, self.setup.unit))

    def _mirrored(self, b: Builder) -> tuple[str, str]:
        """(place where the mirrored ray leaves the scene, share of what is read there)."""
        return mirrored_point(b, self.setup, self._normal), b.affine("roughness", [-1.0], [1.0])

    def _reflected(self, b: Builder) -> tuple[str, np.ndarray]:
        """Features of what the point reflects, and the magnitudes that the table was divided by."""
        assert self.mirror
        grid, (at, gloss) = self.mirror, self._mirrored(b)
        values, steps = grid.even(self._trainer.best["mirror"])
        table = pack(values, self.preset.table_storage, per_row=False)
        v = b.hashgrid(at, table, grid.levels, grid.base, grid.growth, grid.entries_log2)
        return b.multiply(v, b.concat(*[gloss] * grid.width)), steps

    def _emitted(
        self, b: Builder, u: str, frame: list[str], small: Callable[[np.ndarray], Buffer], steps: np.ndarray
    ) -> str:
        """W u + b of the layer that depends on the light (constant without one); u is divided by ``steps`` [U]."""
        weights, units, width = self._trainer.best, self.network.hidden[0], self.network.features
        # The graph's matrices are [out, in] row by row; training emits [in, out], then the bias.
        rows = np.arange(width * units).reshape(width, units).T.ravel()
        # The columns of W take up what the table was divided by.
        scale = np.append(np.tile(steps, units), np.ones(units)).astype(np.float32)
        rows = np.append(rows, np.arange(width * units, (width + 1) * units))
        if not frame:
            layer = weights["emit_b"][0][rows] * scale
            return b.linear(u, small(layer[: width * units].reshape(units, width)), small(layer[width * units :]))
        x = b.concat(*frame, per_frame=True)
        hidden = len(self.preset.light_hidden)
        layers = graph_layers(weights, range(hidden), small, prefix="light_")
        x = add_layers(b, x, layers, (self.network.activation,) * hidden, per_frame=True)
        emit, bias = weights["emit_w"].T[rows] * scale[:, None], weights["emit_b"][0][rows] * scale
        large = partial(pack, type=self.preset.table_storage)
        matrix = b.linear(x, large(emit[: width * units]), small(bias[: width * units]), per_frame=True)
        offset = b.linear(x, large(emit[width * units :]), small(bias[width * units :]), per_frame=True)
        return b.add(b.matvec(matrix, u, units), offset)


def _frame_of(query: Query) -> np.ndarray:
    """[N, C] what is the same for a whole frame: the light, and the pose where something moves."""
    return query.light if query.pose is None else np.concatenate([query.light, query.pose], axis=1)


def _widest(lights: Sequence[Variable]) -> Variable:
    """The light around which people look farthest: one from all around first, then a sun."""
    return max(lights, key=lambda light: (surrounds(light), light.kind == "sun"))


class FactoredField(SurfaceField):
    """The default field: a moving light by ``FactoredFit``, the scene's own lamps by ``LampsFit``."""

    learns_movers = True
    """Whether a node may move."""

    def prepare(self, job: Job) -> State:
        """Find the variable light, and the groups of the scene's own lamps.

        Args:
            job: Scene and settings.

        Returns:
            The prepared scene.

        Raises:
            ValueError: ``--lamps`` names no light, or comes with ``--no-static``.
        """
        movers = declared_movers(job.request.vary, job.scene)
        if (count := len(by_light(job.request.vary)) + len(movers)) > MOST_VARIABLES:
            raise ValueError(
                f"vary: {count} lights, nodes and clips vary, more than the {MOST_VARIABLES} that a page can show; "
                "bake fewer of them together"
            )
        state = self._lights(job)
        if movers:
            state = moving_state(state, job, movers)
        if job.request.lamps:
            # Refused where the scene has no light, or none by these names, before anything is traced.
            lamps = group_lamps(job.scene, parse_lamps(job.request.lamps))
            if lamps and not job.request.static:
                raise ValueError("bake: --lamps needs the scene's own light, which --no-static leaves out; drop one")
            state.lamps = lamps if "static" in state.roles else ()
        return state

    def _lights(self, job: Job) -> State:
        """The state with all declared lights, each with a role of its own."""
        first, *others = by_light(job.request.vary)
        if not others:
            return super().prepare(job)
        names = ", ".join(parse_vary(texts[0]).name for texts in others)
        if job.shared:
            raise ValueError(f"compare: fields are compared under one light; drop {names} from --vary")
        if getattr(job.options, "rebake", None):
            raise ValueError(f"bake: --rebake knows one light; bake whole, or drop {names} from --vary")
        state = super().prepare(replace(job, request=replace(job.request, vary=first)))
        # A suggestion of the scene is for its first light.
        bare = replace(job.scene, vary=())
        more = tuple(declare(texts, bare) for texts in others)
        for light in more:
            sample_lights(job.scene, light, 1, job.request.seed)
        further = tuple(further_role(light.name) for light in more)
        roles = ("indirect", *further, *state.roles[1:])
        return replace(state, job=job, more=more, looked=_widest((state.variable, *more)), roles=roles)

    def maker(self, preset: str, role: Role, roles: int) -> Callable[[FieldSetup, int], Learner]:
        """Return a function that makes an untrained learner of a preset; two fields are smaller than one alone.

        Args:
            preset: Name of the preset.
            role: The part of the light to learn.
            roles: Roles of the bake, ≥ 1.

        Returns:
            Function of set-up and seed.
        """
        if preset == "default" and roles > 1:
            return lambda setup, seed: FactoredFit(setup, TWO_FIELDS[kind_of(role)], seed)
        return super().maker(preset, role, roles)

    def sample(self, state: State, role: Role) -> SurfaceSamples | LampTraining:
        """Trace samples of a role, or read those of an interrupted bake.

        Args:
            state: The prepared scene.
            role: The part of the light to sample.

        Returns:
            The samples; shares of all groups of lamps for the scene's own light.
        """
        if role == "static" and state.lamps:
            return trace_lamps(state, PosedLampTracer if state.scene.movers else None)
        return super().sample(state, role)

    def fit(
        self, state: State, role: Role, samples: SurfaceSamples | LampTraining, part: WorkPart | None = None
    ) -> SurfaceFit:
        """Fit a role.

        Args:
            state: The prepared scene.
            role: The part of the light that the samples hold.
            samples: Samples from ``sample``.
            part: Part of the bake that stores plan and checkpoints; None: that of the role.

        Returns:
            The finished fit.
        """
        if isinstance(samples, LampTraining):
            return fit_lamps(state, samples, PosedLampsFit if state.scene.movers else LampsFit)
        return super().fit(state, role, samples, part)


FIELD = FactoredField("factored", PRESETS, FactoredFit, SurfaceOptions)
