"""Learned light probes: spherical harmonics on a lattice, with learned interpolation weights, so that walls block
light.

The geometry (``lightwell.probes``) is independent of light. A variable light makes the probes relightable: the light of
some states is solved, a few bases express all of them (``lightwell.probes.low_rank``), and a spline of the light's
position, evaluated once per frame, mixes these. Nothing is trained on samples.

Notation: P nodes, S states, K bases, N samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.core.store import Store
from lightwell.fields.base import FieldSetup
from lightwell.fields.probes.baked import BakedProbes
from lightwell.fields.probes.mixing import MixedFit
from lightwell.fields.protocol import ExtraFile, Shown
from lightwell.graph import Graph
from lightwell.graph.pose_basis import PoseBasis
from lightwell.networks import TrainingSettings
from lightwell.probes import ddgi, sh
from lightwell.probes.bake import Geometry, bake_geometry
from lightwell.probes.baselines import compare
from lightwell.probes.gathered import gathers
from lightwell.probes.generator import fit_with
from lightwell.probes.lattice import default_spacing
from lightwell.probes.light import SolvedVolume, light_volume, refined
from lightwell.probes.low_rank import LowRank
from lightwell.probes.samples import ProbeSampling
from lightwell.probes.spline import SplineMix
from lightwell.probes.states import JointStates, Lights, states_of
from lightwell.probes.volume import ProbeVolume, coefficients
from lightwell.probes.weights import Fit
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.posing import posed
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.variables import PointLight, Variable
from lightwell.transport.samples import Query

# Probes along the longest edge where no spacing is asked for.
ALONG = 8
# Rows whose harmonics are evaluated together.
CHUNK = 1 << 14
# Tracing settings for each light state, for a fixed light, and for all states whose rays are shared; training settings.
MOVING, STILL = ProbeSampling(24, 64, 256, most=4), ProbeSampling(32, 256, 1024, most=8)
GATHERED = ProbeSampling(12, 256, 1024, most=4)
TRAINING = TrainingSettings(rate=3e-3, batch=1 << 13)
# Most bases where cells have bricks: while a pixel reads a brick, it holds 27 numbers of each base four times, and may
# hold 2,048 numbers (format/FORMAT.md, *Budget*).
MOST_BESIDE_BRICKS = 16
# The seed of the light states is this far from that of the samples.
STATE_SEED = 7919
# Random stream of the order of the poses.
POSE_ORDER = 0x905E


GEOMETRY = Derived[Geometry]("probes.geometry", most=2)
Solved = tuple[SolvedVolume, LowRank | None, dict[str, Any]]
# One for each light that may vary in a bake.
LIGHT = Derived[Solved]("probes.light", most=4)


@dataclass(frozen=True)
class ProbesPreset:
    """Settings of a probe field."""

    function: str = "relu-field"
    """Weight function, one of ``lightwell.probes.weights.FUNCTIONS``."""
    sampling: ProbeSampling = MOVING
    """Of each state of a light that is path traced."""
    gathered_sampling: ProbeSampling = GATHERED
    """Of all states of a light that is gathered, together."""
    static_sampling: ProbeSampling = STILL
    states: int = 48
    """Number of states that are solved of a light that moves along a line."""
    places: int = 256
    """Number of states that are solved of a light that moves in a box: all of them share their rays."""
    rank: int = 16
    """Number of bases that are kept (K)."""
    generator: bool = False
    """Whether fits start from the generator: needed for a network per probe, not for the convex problem of a grid."""
    refine: bool = True
    """Whether the generator's weights are refined, probe by probe."""
    coding: str = "zh3"
    """Number format of the light in files: 'l2' or 'zh3'."""
    bricks: float = 1.0
    """Fine probes per live probe of the lattice, at most; 0: no bricks. A light that moves in a box has none: bases
    are worth more (FLIP of balls without and with bricks: Cornell box 0.096 and 0.096, dungeon 0.179 and 0.171, with
    1.5 to 1.7 times the bytes)."""
    hidden: tuple[int, ...] = ()
    """Not used: nothing is trained."""
    training: TrainingSettings = TRAINING
    """Of samples that only measure the error."""
    along: int = ALONG
    """Probes along the longest edge where no spacing is asked for."""

    def bases_of(self, volume: ProbeVolume) -> int:
        """Return how many bases of the light of a volume are kept.

        Args:
            volume: The probes.

        Returns:
            K.
        """
        return self.rank if volume.bricks is None else min(self.rank, MOST_BESIDE_BRICKS)

    def states_of(self, variable: Variable | None) -> int:
        """Return how many states of a variable are solved.

        Args:
            variable: The declared light.

        Returns:
            S.
        """
        return self.places if isinstance(variable, PointLight) else self.states

    def sampling_of(self, variable: Variable | None) -> ProbeSampling:
        """Return how much is traced for a variable.

        Args:
            variable: The declared light; None: the scene's own emitters.

        Returns:
            Numbers of samples and paths.
        """
        if variable is None:
            return self.static_sampling
        return self.gathered_sampling if gathers(variable) else self.sampling


DRAFT = ProbesPreset(
    sampling=ProbeSampling(8, 16, 64, most=1),
    gathered_sampling=ProbeSampling(8, 128, 512, most=1),
    static_sampling=ProbeSampling(8, 64, 128, most=1),
    states=12,
    places=64,
    rank=8,
)
# The weights hat × ratio: default (a ReLU field of 4³ bytes) and others by name; ``bare-``: the published forms.
PRESETS: dict[str, ProbesPreset] = {
    "default": ProbesPreset(),
    "draft": DRAFT,
    "l2": ProbesPreset(coding="l2"),
    **{name: ProbesPreset(function=name) for name in ("relu-field", "relu-field-5", "product-field")},
    "mlp": ProbesPreset(function="mlp", generator=True),
    "mlp-generated": ProbesPreset(function="mlp", generator=True, refine=False),
    "mlp-direct": ProbesPreset(function="mlp"),
    **{name: ProbesPreset(function=name) for name in ("bare-relu-field-5", "bare-product-field", "bare-mlp")},
    # Of --quality best.
    "fine": ProbesPreset(along=12, states=96, rank=24),
}


@dataclass
class ProbesFit(MixedFit):
    """See ``lightwell.fields.base.Learner``."""

    preset: ProbesPreset
    solved: Solved
    """Result of ``solved`` for this set-up, preset and seed."""
    facts: dict[str, Any] = field(default_factory=dict)
    name: str = "default"
    """Of the preset."""

    def __post_init__(self) -> None:
        self._lit, self._rank, baselines = self.solved
        self._spline = None if self._rank is None else spline_of(self.setup, self._lit, self._rank)
        self._basis = self.baked.basis
        self._start(self._basis.shape[-1])
        # Bases and spline follow from the solve: there is nothing to train.
        self._untrained = True
        volume = self._lit.geometry.volume
        self.facts |= {
            "probes": int(volume.alive.sum()),
            "nodes": len(volume.lattice),
            "bricks": 0 if volume.bricks is None else len(volume.bricks.table),
            "spacing": volume.lattice.spacing,
            "weights": volume.function,
            "coding": self.preset.coding,
            "bytes_per_probe": volume.bytes_per_probe(self.preset.coding),
            "bytes_of_distance_moments": ddgi.BYTES,
            "weight_seconds": self._lit.geometry.seconds,
            "baselines": baselines,
        }

    def _factors(self, query: Query) -> np.ndarray:
        """[N, 3] radiance over reflectance at the points, unit S."""
        volume, k = self._lit.geometry.volume, self._basis.shape[-1]
        out = np.empty((len(query), 3), np.float32)
        factors = np.ones((len(query), 1)) if self._spline is None else self._spline.factors(query.light)
        flat = self._basis.reshape(len(volume.state), -1)
        for start in range(0, len(query), CHUNK):
            part = slice(start, start + CHUNK)
            normal = np.asarray(query.normal[part], np.float64)
            node, share, _ = coefficients(volume, query.position[part], normal)
            e = np.zeros((len(node), flat.shape[1]), np.float32)
            for corner in range(node.shape[1]):
                e += share[:, corner, None].astype(np.float32) * flat[node[:, corner]]
            values = np.einsum("nb,nbck->nck", sh.basis(normal), e.reshape(len(node), 9, 3, k))
            out[part] = np.einsum("nck,nk->nc", values, factors[part]) / (np.pi * self.setup.unit)
        return out

    @property
    def baked(self) -> BakedProbes:
        """The baked probes."""
        return BakedProbes(self._lit, self._rank, self._spline, self.setup.unit, self.name, self.preset.coding)

    def lower(self) -> Graph:
        """Return the shading graph.

        Returns:
            The graph.
        """
        return self.baked.lower()

    def volume(self, light: np.ndarray | None = None, intensity: np.ndarray | float = 1.0) -> ProbeVolume:
        """Compute the probe volume under a light.

        Args:
            light: [3] position of the light in metres, or direction towards the sun; None: without a variable light.
            intensity: Intensity in cd or lx: a scalar or [3] by colour.

        Returns:
            The volume.
        """
        return self.baked.volume(light, intensity)

    def files(self, glb: Path, shown: Shown, store: Store | None = None) -> list[ExtraFile]:
        """List the files beside the asset.

        Args:
            glb: Path of the asset.
            shown: The light under which the bake is shown first.
            store: Where to keep what an incremental bake starts from; None: it is not kept.

        Returns:
            The files.
        """
        role = "static" if self._spline is None else "indirect"
        files, in_file = self.baked.files(role, glb, self.setup.scene, shown, store)
        self.facts["file_bytes_per_probe"] = in_file
        self.note = payload(self._lit.geometry.volume, self.preset.coding, in_file)
        return files


def payload(volume: ProbeVolume, coding: str, in_file: dict[str, float]) -> str:
    """Describe the bytes of a probe in one line.

    Args:
        volume: The probes.
        coding: Number format of the stored light.
        in_file: Bytes per live probe in the file, by part.

    Returns:
        The line.
    """
    parts = volume.bytes_per_probe(coding)
    told = ", ".join(f"{name} {value:.0f}" for name, value in parts.items() if name != "record")
    return (
        f"{int(volume.alive.sum())} probes of {len(volume.state)} nodes, {volume.function}; payload "
        f"{parts['record']:.0f} B a record, {sum(parts.values()) - parts['record']:.0f} B a probe on average ({told}), "
        f"{sum(in_file.values()):.0f} B in the file; distance moments take {ddgi.BYTES} B"
    )


def weights_of(setup: FieldSetup, preset: ProbesPreset, spacing: float | None) -> Geometry:
    """Compute the interpolation weights of a scene; they are kept with it.

    Args:
        setup: Set-up of the scene, made by ``FieldSetup.of``.
        preset: Settings of the probes.
        spacing: Distance of neighbouring probes, metres; None: that of the preset.

    Returns:
        The weights, without light.
    """
    spacing = spacing or default_spacing(setup.scene.core, preset.along)
    make = lambda: bake_geometry(setup.scene, spacing, preset.function, fit=fit_of(preset))  # noqa: E731
    arguments = (float(spacing), preset.function, preset.generator, preset.refine)
    return setup.scene.cache.get(GEOMETRY, make, arguments)


def fit_of(preset: ProbesPreset) -> Fit | None:
    """Return the function that fits interpolation weights.

    Args:
        preset: Settings.

    Returns:
        The function; None: weights are fitted from scratch, also where the generator is missing.
    """
    return fit_with(preset.function, refine=preset.refine) if preset.generator else None


def solved(
    setup: FieldSetup,
    preset: ProbesPreset,
    seed: int,
    spacing: float | None = None,
    poses: PoseBasis | None = None,
) -> Solved:
    """Trace the light of all states; the result is kept with the scene.

    Args:
        setup: Set-up of the scene, made by ``FieldSetup.of``.
        preset: Settings of the probes.
        seed: Seed of the sampler.
        spacing: Distance of neighbouring probes, metres; None: see ``default_spacing``.
        poses: Poses in which a variable light is traced; None: nothing moves.

    Returns:
        The light of all states, the factors of the bases (None: one state), and the errors of volume and baselines
        in the air.

    Raises:
        ValueError: The set-up has no scene.
    """
    if setup.scene is None:
        raise ValueError("probes: the set-up has no scene; probes are traced in its air, make it with FieldSetup.of")
    geometry = weights_of(setup, preset, spacing)
    # The states of a variable light are drawn from its ranges.
    arguments = (geometry.volume.lattice.spacing, preset, setup.light, setup.variable, seed, poses)
    return setup.scene.cache.get(LIGHT, lambda: _solve(setup, preset, geometry, seed, poses), arguments)


def _solve(setup: FieldSetup, preset: ProbesPreset, geometry: Geometry, seed: int, poses: PoseBasis | None) -> Solved:
    static = setup.light == "static"
    variable = None if static else setup.variable
    lights: Lights = None
    if not static:
        lights = sample_lights(setup.scene, variable, preset.states_of(variable), seed + STATE_SEED)
        lights = lights if poses is None else in_poses(setup.scene, lights, poses, seed)
    sampling = preset.sampling_of(variable)
    lit = light_volume(setup.scene, geometry, sampling, seed, variable, lights)
    if not isinstance(variable, PointLight):
        lit = refined(setup.scene, lit, preset.bricks, fit_of(preset), variable)
    live = np.flatnonzero(lit.geometry.volume.alive)
    first = (lit.solution.light, lit.start) if static else (lit.solution.light[0], lit.start[0])
    state = states_of(setup.scene, variable, lights)[0]
    told = compare(state.scene, lit.geometry, *first, seed, state.variable, state.light)
    low = None if static else LowRank.of(lit.solution.light, live, preset.bases_of(lit.geometry.volume))
    return lit, low, told


def spline_of(setup: FieldSetup, lit: SolvedVolume, rank: LowRank, poses: np.ndarray | None = None) -> SplineMix:
    """Make the spline of the factors between the states of a light.

    Args:
        setup: Set-up of the scene.
        lit: The light of S states.
        rank: Factors of the bases in the states.
        poses: [S, M] sliders of what moves; None: nothing does.

    Returns:
        The spline.
    """
    lights = lit.lights.lights if isinstance(lit.lights, JointStates) else lit.lights
    assert lights is not None
    point, rows = setup.light == "point", np.zeros((len(lights), 0)) if poses is None else poses
    return SplineMix.of(lights, rows, rank.factors, directions=not point, levels=point)


def in_poses(scene: Scene, lights: np.ndarray, poses: PoseBasis, seed: int) -> JointStates:
    """Put what moves into a pose for each place of a light: all poses as often, in random order.

    Lights are points of a Sobol sequence: every second one, or fourth, lies in one part of the range.

    Args:
        scene: Scene with M movers.
        lights: [S, 3] positions, or directions.
        poses: The poses.
        seed: Seed of the order; the first state has the first pose.

    Returns:
        S joint states.
    """
    rows = pose_rows(len(lights), poses, seed)
    return JointStates(tuple(posed(scene, pose) for pose in rows), lights=lights)


def pose_rows(count: int, poses: PoseBasis, seed: int) -> np.ndarray:
    """Choose the pose of each state of a light.

    Args:
        count: S.
        poses: The poses.
        seed: Seed of the order; the first state has the first pose.

    Returns:
        [S, M] sliders.
    """
    known = poses.poses
    order = np.random.default_rng((seed, POSE_ORDER)).permutation(count - 1) + 1
    return known[np.concatenate([[0], order]) % len(known)]
