"""A feature volume as a field: the light of some states in the air, reduced to bases that a network mixes.

The grid (``lightwell.probes.split``) is independent of light. Like probes, the volume holds irradiance in free space,
for things that move; it is trained on samples of the same kind and, for a light that moves, mixed by the same network.
Notation: S states, K bases, F features, N samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.fields.probes.baked import singular_mix
from lightwell.fields.probes.fit import CHUNK, MOVING, STATE_SEED, STILL, TRAINING
from lightwell.fields.probes.mixing import MixedFit
from lightwell.graph import Graph
from lightwell.networks import TrainingSettings
from lightwell.probes import sh
from lightwell.probes.baselines import PATHS, held_out
from lightwell.probes.lattice import ProbeLattice, default_spacing
from lightwell.probes.metrics import score
from lightwell.probes.samples import ProbeSampling
from lightwell.probes.split.fit import compressed, node_light
from lightwell.probes.split.grid import split_grid
from lightwell.probes.split.lower import lower
from lightwell.probes.split.samples import volume_rows
from lightwell.probes.split.volume import FeatureVolume, query
from lightwell.probes.support import Support
from lightwell.probes.trace import air_light
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.scene_cache import Derived
from lightwell.transport.samples import Query

Solved = tuple[FeatureVolume, dict[str, Any]]
VOLUME = Derived[Solved]("volume.light", most=4)


@dataclass(frozen=True)
class VolumePreset:
    """Settings of a feature volume."""

    sampling: ProbeSampling = MOVING
    """Samples of each light state; the numbers are those of eight cells."""
    static_sampling: ProbeSampling = STILL
    states: int = 48
    """Number of light states that are traced (S)."""
    rank: int = 8
    """Number of bases that are kept (K)."""
    features: int = 12
    """Features of a node for light that does not change."""
    moving_features: int = 24
    """Features of a node for all bases together."""
    hidden: tuple[int, ...] = (48, 48)
    """Widths of the network of the light's position."""
    training: TrainingSettings = TRAINING
    along: int = 16
    """Nodes along the longest edge where no spacing is asked for."""


PRESETS: dict[str, VolumePreset] = {
    "default": VolumePreset(),
    "draft": VolumePreset(
        sampling=ProbeSampling(8, 16, 64, most=1), static_sampling=ProbeSampling(8, 64, 128, most=1), states=12, rank=4
    ),
    # Of --quality best.
    "fine": VolumePreset(along=24, states=96, rank=12, moving_features=32),
}


@dataclass
class VolumeFit(MixedFit):
    """See ``lightwell.fields.base.Learner``."""

    preset: VolumePreset
    solved: Solved
    """Result of ``solved`` for this set-up, preset and seed."""
    facts: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._volume, facts = self.solved
        self._start(self._volume.rank)
        self.facts |= facts

    @property
    def volume(self) -> FeatureVolume:
        """The features and their decoder, in radiance."""
        return self._volume

    def _factors(self, query: Query) -> np.ndarray:
        """[N, 3 K] radiance over reflectance of each basis at the points, unit S."""
        volume = self._volume
        out = np.empty((len(query), 3 * volume.rank), np.float32)
        for start in range(0, len(query), CHUNK):
            part = slice(start, start + CHUNK)
            normal = np.asarray(query.normal[part], np.float64)
            e = volume.harmonics(query.position[part] + volume.offset * volume.grid.lattice.spacing * normal)
            values = np.einsum("nb,nbck->nck", sh.basis(normal), e)
            out[part] = values.reshape(len(values), -1) / (np.pi * self.setup.unit)
        return out

    def lower(self) -> Graph:
        """Return the shading graph; the network of the light is evaluated once per frame.

        Returns:
            The graph.
        """
        return lower(self._volume, self.setup.unit, self.code)


def solved(setup: FieldSetup, preset: VolumePreset, seed: int, spacing: float | None = None) -> Solved:
    """Trace the light of all states and fit the volume; the result is kept with the scene.

    Args:
        setup: Set-up of the scene, made by ``FieldSetup.of``.
        preset: Settings of the volume.
        seed: Seed of the sampler.
        spacing: Distance of neighbouring nodes, metres; None: that of the preset.

    Returns:
        The volume, and facts for the report.

    Raises:
        ValueError: The set-up has no scene.
    """
    if setup.scene is None:
        raise ValueError("volume: the set-up has no scene; its air is traced, make it with FieldSetup.of")
    spacing = float(spacing or default_spacing(setup.scene.core, preset.along))
    arguments = (spacing, preset, setup.light, setup.variable, seed)
    return setup.scene.cache.get(VOLUME, lambda: _solve(setup, preset, spacing, seed), arguments)


def _solve(setup: FieldSetup, preset: VolumePreset, spacing: float, seed: int) -> Solved:
    static, scene = setup.light == "static", setup.scene
    variable = None if static else setup.variable
    lights = None if static else sample_lights(scene, variable, preset.states, seed + STATE_SEED)
    sampling = preset.static_sampling if static else preset.sampling
    grid, support = split_grid(scene, ProbeLattice.around(scene.core, spacing))
    light = node_light(grid, volume_rows(scene, support, sampling, seed, variable, lights))
    states = light.reshape(len(light), grid.count, 9, 3)
    mix = np.ones((1, 1)) if static else singular_mix(states, np.arange(grid.count), preset.rank)
    bases = np.einsum("spc,sk->pck", light, mix).reshape(grid.count, -1)
    volume = compressed(grid, bases, preset.features if static else preset.moving_features)
    first = None if static else lights[0]
    # Factors that give the first state back: its share of each basis.
    factors = None if static else np.linalg.lstsq(bases.reshape(-1, mix.shape[1]), light[0].ravel(), rcond=None)[0]
    error = _error(setup, volume, support, seed, variable, first, factors)
    return volume, _facts(volume, error)


def _facts(volume: FeatureVolume, error: float | None) -> dict[str, Any]:
    """Facts about the volume for the report."""
    grid = volume.grid
    return {
        "nodes": grid.count,
        "spacing": grid.lattice.spacing,
        "cells_with_a_wall": len(grid.cuts.plane),
        "features": volume.features.shape[1],
        "bases": volume.rank,
        "bytes": {name: int(value) for name, value in volume.bytes.items()},
        "error_in_the_air": error,
    }


def _error(
    setup: FieldSetup,
    volume: FeatureVolume,
    support: Support,
    seed: int,
    variable: Any,
    light: np.ndarray | None,
    factors: np.ndarray | None,
) -> float | None:
    """Symmetric relative error at places in the air that the fit has not seen, under the first state."""
    x, n = held_out(support, seed)
    if not len(x):
        return None
    truth = air_light(setup.scene, x, PATHS, seed + 977, variable=variable, light=light).sh
    truth = np.maximum(sh.evaluate(truth, n), 0)
    found = query(volume.in_air(), x, n, factors)
    return round(score(truth, found, np.zeros(len(x), int)).smape, 4)
