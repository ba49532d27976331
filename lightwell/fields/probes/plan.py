"""The plan of probes, alone or beside a field: how far apart they are, and how much is traced in their share of time.

The plan is measured once and stored before the work that it plans. Notation: S states of the light.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from time import perf_counter

import numpy as np

from lightwell.core.formats import JSON
from lightwell.fields.probes.fit import ProbesPreset
from lightwell.fields.protocol import Job
from lightwell.probes.bake import Geometry
from lightwell.probes.gathered import bin_light, gathers
from lightwell.probes.samples import ProbeSampling, places
from lightwell.probes.trace import air_light
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable

# Share of the whole time that all probes take beside a field, which is learned in the rest; and alone.
PROBES_SHARE, ALONE_SHARE = 0.2, 0.3
# Share of that for rays, trust and weights; what it leaves is for tracing, and at least so much of it.
GEOMETRY_SHARE, LEAST_TRACING = 0.5, 0.25
# Probes are at most so many times farther apart than the preset has them.
WIDEST = 2.0
# Fewest states of a declared light.
FEWEST_STATES = 12
# Samples of noisy cells have more paths: all samples together about so many times those of the plan.
NOISY = 2.0
# Bricks trace about as much again: they need so many times the time of a volume without.
BRICKS = 2.0
# Points and paths of the call that measures the rate of tracing.
TIMED_POINTS, TIMED_PATHS = 256, 128
# Where states share their rays, a state costs this share of a path for each ray: a product in place of a path.
STATE_OF_RAY = 1 / 300
# Fewest paths of a sample, and of a probe.
LEAST_PATHS, LEAST_PROBE_PATHS = 8, 16


@dataclass(frozen=True)
class ProbePlan:
    """Counts of a probe bake."""

    spacing: float
    """Distance of neighbouring probes, metres."""
    states: dict[str, int]
    """States of the light by role."""
    paths: float = 1.0
    """Factor of the preset's paths, in (0, 1]."""
    bricks: bool = True
    """Whether cells with large errors get denser probes."""

    def applied(self, preset: ProbesPreset, role: str) -> ProbesPreset:
        """Give a preset the counts of the plan.

        Args:
            preset: The preset.
            role: Role of the light.

        Returns:
            The preset with them.
        """
        names = ("sampling", "static_sampling", "gathered_sampling")
        counts = {name: self.sampling(getattr(preset, name)) for name in names}
        bricks, count = preset.bricks if self.bricks else 0.0, self.states[role]
        return replace(preset, **counts, bricks=bricks, states=count, places=count)

    def sampling(self, preset: ProbeSampling) -> ProbeSampling:
        """Scale the paths of a preset.

        Args:
            preset: Numbers of the preset.

        Returns:
            Even numbers of paths.
        """
        if self.paths >= 1:
            return preset
        paths = _even(preset.paths * self.paths, LEAST_PATHS)
        probe_paths = _even(preset.probe_paths * self.paths, LEAST_PROBE_PATHS)
        return replace(preset, paths=paths, probe_paths=probe_paths, most=min(preset.most, 2))


def probe_plan(
    job: Job,
    scene: Scene,
    preset: ProbesPreset,
    spacing: float,
    variables: dict[str, Variable | None],
    wanted: dict[str, int],
    geometry: Callable[[float], Geometry],
    share: float = PROBES_SHARE,
) -> ProbePlan:
    """Plan the probes of a bake; a plan that is stored is read.

    Args:
        job: The bake; ``options.spacing`` is kept where it is given.
        scene: The scene.
        preset: Settings of the probes.
        spacing: Distance of the probes where the time allows it, metres.
        variables: Declared light by role; None: the scene's own emitters.
        wanted: States by role where the time allows them.
        geometry: Computes the weights for a distance of the probes.
        share: Share of the whole time.

    Returns:
        The plan; that of the preset where the counts of the bake are fixed, or its budget is an error.
    """
    request = job.request
    if (request.steps and request.shards) or not request.budget.seconds:
        return ProbePlan(spacing, wanted, 1.0, preset.bricks > 0)
    allowed = share * request.budget.seconds

    def make() -> dict[str, object]:
        begin = perf_counter()
        distance = spacing if job.options.spacing else affordable_spacing(spacing, GEOMETRY_SHARE * allowed, geometry)
        found = geometry(distance)
        _light_bins(scene, variables, request.seed)
        rate = _rate(scene, found, request.seed)
        left = max(allowed - (perf_counter() - begin), LEAST_TRACING * allowed)
        return asdict(counts_within(found, preset, distance, variables, wanted, left * rate))

    stored = job.work.part(probes=True).get("plan.probes", make, JSON)
    return ProbePlan(**stored)


def affordable_spacing(spacing: float, seconds: float, geometry: Callable[[float], Geometry]) -> float:
    """Choose the distance of probes by the time that their weights take.

    Args:
        spacing: Distance that is asked for, metres.
        seconds: Time of the weights.
        geometry: Makes weights of a distance; that of ``WIDEST`` times the distance is timed.

    Returns:
        Distance, metres: the one asked for, up to ``WIDEST`` times it.
    """
    begin = perf_counter()
    nodes = len(geometry(WIDEST * spacing).volume.lattice)
    cost = (perf_counter() - begin) / max(nodes, 1)
    # Eight times as many nodes at half the distance; those around the scene make it a little less.
    return spacing * float(np.clip((cost * nodes * WIDEST**3 / seconds) ** (1 / 3), 1.0, WIDEST))


def _light_bins(scene: Scene, variables: dict[str, Variable | None], seed: int) -> None:
    """Make the bins of lights that are gathered, whose time is not that of rays."""
    for variable in variables.values():
        if variable is not None and gathers(variable) and not scene.movers:
            bin_light(scene, variable, sample_lights(scene, variable, 1, seed))


def _rate(scene: Scene, geometry: Geometry, seed: int) -> float:
    """Paths per second through the air; the first call compiles."""
    at = places(geometry, ProbeSampling(1))[0]
    at = at[np.arange(TIMED_POINTS) % len(at)] if len(at) else np.zeros((TIMED_POINTS, 3))
    air_light(scene, at, TIMED_PATHS, seed)
    begin = perf_counter()
    air_light(scene, at, TIMED_PATHS, seed)
    return TIMED_POINTS * TIMED_PATHS / max(perf_counter() - begin, 1e-6)


def _even(count: float, least: int) -> int:
    return max(2 * round(count / 2), least)


def counts_within(
    geometry: Geometry,
    preset: ProbesPreset,
    spacing: float,
    variables: dict[str, Variable | None],
    wanted: dict[str, int],
    paths: float,
) -> ProbePlan:
    """Choose the counts that some paths are enough for: first fewer states that are path traced, then fewer paths.

    Args:
        geometry: The probes.
        preset: Their settings.
        spacing: Their distance, metres.
        variables: Declared light of each role; None: the scene's own emitters.
        wanted: States of each role.
        paths: Paths that there is time for.

    Returns:
        The plan.
    """
    alive = int(geometry.volume.alive.sum())

    def cost(role: str, states: int) -> float:
        sampling, gathered = preset.sampling_of(variables[role]), gathers(variables[role])
        traced = alive * sampling.probe_paths + NOISY * len(places(geometry, sampling)[0]) * sampling.paths
        return traced * (1 + states * STATE_OF_RAY if gathered else states)

    total = lambda states: sum(cost(role, count) for role, count in states.items())  # noqa: E731
    share, states = paths / max(total(wanted), 1.0), dict(wanted)
    if share < 1:
        for role in (role for role in states if variables[role] is not None and not gathers(variables[role])):
            # A light beside a mover is asked for in a multiple of the preset's states: it has more variables.
            fewest = FEWEST_STATES * max(states[role] // preset.states, 1)
            states[role] = int(np.clip(states[role] * share, min(fewest, states[role]), states[role]))
        share = paths / max(total(states), 1.0)
    bricks = preset.bricks > 0 and share >= BRICKS
    return ProbePlan(spacing, states, float(min(share, 1.0)), bricks)
