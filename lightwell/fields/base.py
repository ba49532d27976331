"""The interface of a learned representation, and the facts about the scene that it is given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import numpy as np

from lightwell.files import Arrays
from lightwell.graph import Graph
from lightwell.networks.loop import Progress as Progress
from lightwell.networks.loop import TrainingState
from lightwell.scenes.normal_maps import relief
from lightwell.scenes.scene import Material, Scene
from lightwell.scenes.variables import Sun, Variable, has_sky
from lightwell.transport.samples import Query, Samples, columns_of

# The radiance unit is this many times the mean target, so that the mean is 0.25 and the ε of an error has a meaning.
UNIT_FACTOR = 4.0
# One sample beside a lamp was 98 % of the mean in bevy-barn-lamp: all others were black in that unit, and three of four
# seeds trained a black field.
SPIKE = 100.0
# Indirect light below this share of the direct light is none: a lone triangle that stands askew has 1e-13.
ROUNDING = 1e-9
# Brightest light of the scene's own that is learned, in the radiance unit: more is white in any picture of the room.
# The wall next to a lamp may be 25,000 times as bright as the mean, and a cell's features serve its dark places too.
# Relative errors of own light without a limit, with 32: loft 34, 28 %; needle-lightmap-house 28, 28 %; staircase2 12,
# 12 %; +0.1 to +0.2 dB. Of random switches in loft, needle-lightmap-house, pyraxia-hallway: 46, 35, 273 % without; 36,
# 32, 86 % with 64; 35, 32, 84 % with 32; 34, 32, 72 % with 16, where pictures begin to be worse.
WHITE = 32.0


@dataclass(frozen=True)
class FieldSetup:
    """Facts about the scene that a fit needs besides its samples."""

    center: tuple[float, float, float]
    """Middle of the scene's bounds, metres."""
    half_extent: float
    """Half of the longest edge of the bounds, metres; one scale for all axes keeps distances comparable."""
    unit: float
    """Radiance unit S: targets are divided by it."""
    light: Literal["point", "sun", "static"]
    """Kind of the declared light; 'static' fields have none."""
    size: tuple[float, float, float] | None = None
    """Edges of the scene's bounds, metres; None: a cube of ``half_extent``."""
    matte: bool = False
    """Whether the radiance of all surfaces is view-independent: no glossy reflection."""
    relief: bool = False
    """Whether a material has a normal map."""
    movers: int = 0
    """How many parts of the scene move by sliders of their own; the field then reads the pose."""
    scene: Scene | None = field(default=None, repr=False, compare=False)
    """The scene itself, for fields that trace rays of their own."""
    variable: Variable | None = field(default=None, repr=False, compare=False)
    """Ranges of the declared light, for the same."""

    @staticmethod
    def of(
        scene: Scene,
        unit: float,
        light: Literal["point", "sun", "environment", "static"],
        variable: Variable | None = None,
    ) -> FieldSetup:
        """Make the set-up of a loaded scene.

        Args:
            scene: The scene.
            unit: Radiance unit S, > 0.
            light: Kind of the declared light; 'static' for the scene's own light. The north of an environment map is a
                direction as that of a sun.
            variable: Ranges of the declared light; None for 'static'.

        Returns:
            The set-up.
        """
        kind: Literal["point", "sun", "static"] = "sun" if light == "environment" else light
        low, high = scene.core
        center, size = _triple((low + high) / 2), _triple(high - low)
        matte = all(is_matte(scene.materials[mesh.material]) for mesh in scene.meshes)
        bumpy = bool(relief(scene).any())
        return FieldSetup(center, 0.5 * max(size), unit, kind, size, matte, bumpy, len(scene.movers), scene, variable)


# The box that a field resolves holds all samples but this share at each end of each axis, and a margin of its longest
# edge: a ground plane of kilometres, mountains or a dome of sky leave no cell to a room.
OUTLIERS, BOX_MARGIN = 0.01, 0.05
# The shares are found on about so many of the samples: of millions it takes a second.
JUDGED_PLACES = 1 << 18


def around_samples(setup: FieldSetup, samples: Samples) -> FieldSetup:
    """Shrink the bounds of a set-up to the samples and their lights, without outliers.

    Args:
        setup: The set-up.
        samples: Path-traced samples.

    Returns:
        The set-up with smaller bounds; ``setup`` itself where they would not be smaller.
    """
    places = samples.query.position
    if setup.movers:
        places = np.concatenate([places, samples.query.rest_position])
    judged = places[:: max(len(places) // JUDGED_PLACES, 1)]
    low, high = np.quantile(judged, [OUTLIERS, 1 - OUTLIERS], axis=0)
    if setup.light == "point":
        lights = samples.query.light
        low, high = np.minimum(low, lights.min(axis=0)), np.maximum(high, lights.max(axis=0))
    margin = BOX_MARGIN * float((high - low).max())
    low, high = np.maximum(low - margin, places.min(axis=0)), np.minimum(high + margin, places.max(axis=0))
    if setup.light == "point":
        low, high = np.minimum(low, lights.min(axis=0) - margin), np.maximum(high, lights.max(axis=0) + margin)
    center, size = 0.5 * (low + high), high - low
    half_extent = 0.5 * float(size.max())
    if half_extent >= setup.half_extent:
        # Objects are within the set-up's box (``Scene.core``); lights may have been declared beyond it.
        middle, edges = np.array(setup.center), np.array(setup.size or (2 * setup.half_extent,) * 3)
        beyond = setup.light == "point" and bool((np.abs(lights - middle) > edges / 2).any())
        return (
            setup if not beyond else replace(setup, center=_triple(center), half_extent=half_extent, size=_triple(size))
        )
    return replace(setup, center=_triple(center), half_extent=half_extent, size=_triple(size))


def _triple(v: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(c) for c in v)
    return x, y, z


# Index of refraction up to which a surface without metal or coat counts as purely diffuse.
MATTE_IOR = 1.01


def is_matte(material: Material) -> bool:
    """Test whether a material is Lambertian, so that its radiance is view-independent.

    Burley's diffuse term is not, even at full roughness: it brightens towards grazing views.

    Args:
        material: The material.

    Returns:
        True for a Lambertian material.
    """
    layers = (material.metallic, material.clearcoat, material.sheen, material.transmission)
    return material.ior <= MATTE_IOR and not (material.delta or any(layers))


class Learner(Protocol):
    """A representation of light at surfaces while it is fitted: ``learn_from``, then ``train``; both again with more
    samples.
    """

    @property
    def macs(self) -> int:
        """Return the multiply-accumulates per pixel of the result.

        Returns:
            Number of multiply-accumulates.
        """

    def learn_from(self, samples: Samples) -> None:
        """Set the training samples; later calls replace them.

        Args:
            samples: Path-traced samples.
        """

    def validate_on(self, samples: Samples) -> None:
        """Set the held-out samples of early stopping.

        Args:
            samples: Path-traced samples.
        """

    def train(
        self, until: int, total: int, progress: Progress | None = None, checkpoint: Callable[[], None] | None = None
    ) -> bool:
        """Train.

        Args:
            until: Step to train to.
            total: Steps of the schedule.
            progress: Called with the state and ``total`` after each evaluation.
            checkpoint: Called when a checkpoint is due.

        Returns:
            Whether early stopping ended the training.
        """

    def predict(self, query: Query) -> np.ndarray:
        """Predict indirect radiance with the best weights so far.

        Args:
            query: N queries.

        Returns:
            [N, 3] radiance for a unit light, reflectance included.
        """

    def lower(self) -> Graph:
        """Return the shading graph of the best weights so far; its output ``radiance`` is divided by the reflectance.

        Returns:
            The graph.
        """

    def arrays(self) -> Arrays:
        """Return the state that a resumed training needs.

        Returns:
            Arrays [...] by name.
        """

    def restore(self, arrays: Arrays) -> None:
        """Restore the state of a learner of the same settings and samples; arrays that do not fit together are a
        ``ValueError``.

        Args:
            arrays: Result of ``arrays``, perhaps of a learner of other settings.
        """

    @property
    def state(self) -> TrainingState:
        """Return steps, errors and history.

        Returns:
            The state.
        """


class NoLight(ValueError):
    """The light of a role reaches no sampled surface point; one line with the cure."""


def radiance_unit(samples: Samples, variable: Variable | None = None) -> float:
    """Compute the radiance unit S: 4 × the area-uniform mean of the targets over points, paths and colour channels.

    Targets of more than ``SPIKE`` times the 99.9th percentile count as so much.

    Args:
        samples: N samples.
        variable: The declared light that they are of, for the message; None: the scene's own.

    Returns:
        S, > 0.

    Raises:
        NoLight: All targets are black, but for what rounding makes of a surface that sees no other one.
    """
    value = samples.radiance.mean(axis=1)
    limit = SPIKE * float(np.percentile(value, 99.9))
    mean = float(np.average(np.minimum(value, limit) if limit > 0 else value, weights=samples.weight))
    if not mean > 0 or mean < ROUNDING * _straight(samples, variable):
        raise NoLight(f"bake: {_dark(variable)}")
    return UNIT_FACTOR * mean


def _straight(samples: Samples, variable: Variable | None) -> float:
    """Usual irradiance of a declared light in a straight line, if nothing is in its way; 0 where it is not known."""
    if variable is None or variable.kind == "environment":
        return 0.0
    if variable.kind == "sun":
        return 1.0
    distance2 = ((samples.query.light - samples.query.position) ** 2).sum(axis=1, dtype=np.float64)
    return float(1 / np.median(distance2))


def to_learn(samples: Samples, role: str, unit: float) -> Samples:
    """Limit what is learned of the scene's own light to ``WHITE``.

    Args:
        samples: N samples.
        role: Role of the field; other roles than 'static' have no limit.
        unit: Radiance unit S.

    Returns:
        The samples.
    """
    return samples.limited(WHITE * unit) if role == "static" else samples


def usual_level(light: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """Compute the level of what a light lights: the mean of log L, in which a point counts as L^0.25.

    The mean of L is that of the places next to lamps, where L may be 10,000 times that of the room.

    Args:
        light: [N, ...] radiance at N points, ≥ 0.
        weight: [N] weights, ≥ 0; None: all the same.

    Returns:
        [...] the levels; 0 where no point is lit.
    """
    counts = np.asarray(light, np.float64) ** 0.25
    if weight is not None:
        counts *= weight.reshape(-1, *[1] * (counts.ndim - 1))
    whole = counts.sum(axis=0)
    logarithms = np.log(np.maximum(light, np.finfo(np.float32).tiny), dtype=np.float64)
    mean = (counts * logarithms).sum(axis=0) / np.where(whole > 0, whole, 1)
    return np.where(whole > 0, np.exp(mean), 0)


def _dark(variable: Variable | None) -> str:
    """Say which light is none, and the cure."""
    if variable is None:
        return "no light of the scene's own reaches any sampled surface point; bake with --no-static"
    name, said = variable.name, "reaches any sampled surface point"
    if isinstance(variable, Sun):
        kind = "of sun and sky" if variable.sky else "of the sun"
        drop = f"'{name}'" if has_sky(variable) else f"{name}.direction"
        return f"no indirect light {kind} '{name}' {said}: the scene has no opening to it; drop {drop} from --vary"
    return (
        f"no indirect light of '{name}' {said}; "
        f"move it into the scene's air with --vary {name}.position=box(x0,y0,z0,x1,y1,z1)"
    )


def query_inputs(query: Query) -> dict[str, np.ndarray]:
    """Convert queries to the named inputs of a shading graph.

    Args:
        query: N queries.

    Returns:
        [N, C] float32 arrays by name of the input.
    """
    return {name: np.ascontiguousarray(values, np.float32) for name, values in columns_of(query).items()}
