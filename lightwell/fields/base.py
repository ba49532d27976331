"""What every learned representation offers, and what it is told of the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from lightwell.graph import Graph
from lightwell.networks.training import TrainingState
from lightwell.scenes.scene import Material, Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.samples import Query, Samples

# The radiance unit is this many times the mean target, so that the mean is 0.25 and the ε of an error has a meaning.
UNIT_FACTOR = 4.0

Progress = Callable[[TrainingState, int], None]


@dataclass(frozen=True)
class FieldSetup:
    """What a fit knows of the scene besides its samples."""

    center: tuple[float, float, float]
    """Middle of the scene's bounds, metres."""
    half_extent: float
    """Half of the longest edge of the bounds, metres; one scale for all axes keeps distances comparable."""
    unit: float
    """Radiance unit S: targets are divided by it."""
    light: Literal["point", "sun", "static"]
    """What the declared light is; 'static' fields have none."""
    size: tuple[float, float, float] | None = None
    """Edges of the scene's bounds, metres; None: a cube of ``half_extent``."""
    matte: bool = False
    """Whether all surfaces look alike from everywhere: no glossy reflection, so no need to know the eye."""
    scene: Scene | None = field(default=None, repr=False, compare=False)
    """The scene itself, for fields that trace rays of their own."""
    variable: Variable | None = field(default=None, repr=False, compare=False)
    """What the declared light may do, for the same."""

    @staticmethod
    def of(
        scene: Scene,
        unit: float,
        light: Literal["point", "sun", "static"],
        variable: Variable | None = None,
    ) -> FieldSetup:
        """The set-up for a loaded scene."""
        center, size = (tuple(float(c) for c in v) for v in (scene.center, scene.bounds[1] - scene.bounds[0]))
        matte = all(is_matte(scene.materials[mesh.material]) for mesh in scene.meshes)
        return FieldSetup(center, 0.5 * scene.extent, unit, light, size, matte, scene, variable)


# The box that a field resolves holds all samples but this share at each end of each axis, and a margin of its longest
# edge: a ground plane of kilometres, mountains or a dome of sky leave no cell to a room.
OUTLIERS, BOX_MARGIN = 0.01, 0.05


def around_samples(setup: FieldSetup, samples: Samples) -> FieldSetup:
    """The set-up with its box drawn to where samples and their lights are, if that is smaller."""
    places = samples.query.position
    low, high = np.quantile(places, [OUTLIERS, 1 - OUTLIERS], axis=0)
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
        return setup
    as_tuple = lambda v: tuple(float(c) for c in v)  # noqa: E731
    return replace(setup, center=as_tuple(center), half_extent=half_extent, size=as_tuple(size))


# Index of refraction up to which a surface reflects nothing but diffusely.
MATTE_IOR = 1.01


def is_matte(material: Material) -> bool:
    """Whether a surface of this material is Lambertian: it looks the same from everywhere.

    Burley's diffuse term is not, even at full roughness: it brightens towards grazing views.
    """
    layers = (material.metallic, material.clearcoat, material.sheen, material.transmission)
    return material.ior <= MATTE_IOR and not (material.delta or any(layers))


class Learner(Protocol):
    """A representation of light at surfaces, being fitted: ``learn_from`` samples, ``train``, both again with more."""

    macs: int
    """Multiply-accumulates per pixel of the result."""

    def learn_from(self, samples: Samples) -> None:
        """Set the training samples; later calls replace them."""

    def validate_on(self, samples: Samples) -> None:
        """Set the held-out samples of early stopping."""

    def train(
        self, until: int, total: int, progress: Progress | None = None, checkpoint: Callable[[], None] | None = None
    ) -> bool:
        """Train to step ``until`` of a schedule of ``total`` steps; returns whether early stopping ended it."""

    def predict(self, query: Query) -> np.ndarray:
        """[N, 3] indirect radiance by the best weights so far, reflectance included, for a unit light."""

    def lower(self) -> Graph:
        """The shading graph of the best weights so far; its output ``radiance`` is divided by the reflectance."""

    def save(self, path: Path) -> None:
        """Write a checkpoint atomically."""

    def load(self, path: Path) -> None:
        """Go on from a checkpoint."""

    @property
    def state(self) -> TrainingState:
        """Steps, errors and history."""


def radiance_unit(samples: Samples) -> float:
    """S = 4 × area-uniform mean of the targets over points, paths and colour channels."""
    mean = float(np.average(samples.radiance.mean(axis=1), weights=samples.weight))
    if not mean > 0:
        raise ValueError(
            "bake: no indirect light reaches any sampled surface point; "
            "move the light into the scene's air with --vary light.position=box(x0,y0,z0,x1,y1,z1)"
        )
    return UNIT_FACTOR * mean


def query_inputs(query: Query) -> dict[str, np.ndarray]:
    """The named inputs of a shading graph, [N, C] each."""
    names = ("position", "normal", "view", "light", "reflectance", "roughness", "metallic")
    names += ("uv1", "shading_normal") if hasattr(query, "uv1") else ()
    return {name: np.ascontiguousarray(getattr(query, name), np.float32) for name in names}
