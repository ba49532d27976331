"""The field ``probes``: a surface field whose lattice and light are solved before the samples of a role are traced."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from lightwell.core.work import WorkPart
from lightwell.fields.base import FieldSetup, Learner
from lightwell.fields.probes.fit import PRESETS, ProbesFit, ProbesPreset, solved, weights_of
from lightwell.fields.probes.options import ProbesOptions
from lightwell.fields.probes.plan import ALONE_SHARE, probe_plan
from lightwell.fields.probes.rebake import RebakeState, rebaked
from lightwell.fields.protocol import Fit, Job, Role, State
from lightwell.fields.surface.field import SurfaceField
from lightwell.fields.surface.training import SurfaceSamples
from lightwell.probes.lattice import default_spacing

# Shards of samples, which give the unit of the light.
SHARDS = 1


class ProbesField(SurfaceField):
    """See ``lightwell.fields.protocol.Field``."""

    Options = ProbesOptions
    learns_sky = False
    learns_turning = False

    def prepare(self, job: Job) -> State:
        """Find the variable light, or read the probes that an incremental bake starts from.

        Args:
            job: Scene and settings.

        Returns:
            The prepared scene.
        """
        return RebakeState.of(job) if job.options.rebake else super().prepare(job)

    def sample(self, state: State, role: Role) -> SurfaceSamples | None:
        """Solve the probes of all roles before the first samples are planned, then trace the samples of a role.

        Args:
            state: The prepared scene.
            role: The part of the light to sample.

        Returns:
            The samples, which score the probes; None for an incremental bake.
        """
        if isinstance(state, RebakeState):
            return None
        if role == state.roles[0] and not state.job.shared:
            self._solve(state)
        return super().sample(with_few_samples(state), role)

    def _solve(self, state: State) -> None:
        """Solve the probes of all roles in their share of the time; they are kept with the scene."""
        job = state.job
        with job.work.timed("probes"), job.progress.stage("probes", len(state.roles), "fields") as stage:
            for role in state.roles:
                preset, spacing = planned(state, role)
                solved(setup_of(state, role), preset, job.request.seed, spacing)
                stage.advance()

    def fit(self, state: State, role: Role, samples: SurfaceSamples | None, part: WorkPart | None = None) -> Fit:
        """Solve the probes or solve again the probes that a change affects.

        Args:
            state: The prepared scene.
            role: The part of the light that the samples hold.
            samples: Samples from ``sample``.
            part: Part of the bake that stores plan and checkpoints; None: the field chooses it.

        Returns:
            The finished fit.
        """
        if isinstance(state, RebakeState):
            return rebaked(state, role)
        return super().fit(with_few_samples(state), role, samples, part)

    def starter(self, state: State, role: Role) -> Callable[[FieldSetup, int], Learner]:
        """Return a function that makes the probes of a set-up.

        Args:
            state: The prepared scene.
            role: The part of the light to learn.

        Returns:
            Function of set-up and seed.
        """
        name = state.job.request.preset
        preset, spacing = planned(state, role)

        def start(setup: FieldSetup, seed: int) -> ProbesFit:
            return ProbesFit(setup, preset, seed, solved(setup, preset, seed, spacing), name=name)

        return start

    def start(self, setup: FieldSetup, preset: str, seed: int, spacing: float | None = None) -> ProbesFit:
        """Solve the probes' light.

        Args:
            setup: Set-up of the scene, made by ``FieldSetup.of``.
            preset: Name of a preset.
            seed: Seed of sampler and weights.
            spacing: Distance of neighbouring probes, metres; None: see ``default_spacing``.

        Returns:
            The learner.
        """
        made = PRESETS[preset]
        return ProbesFit(setup, made, seed, solved(setup, made, seed, spacing), name=preset)


def setup_of(state: State, role: Role) -> FieldSetup:
    """Make the set-up by which the probes of a role are solved.

    Args:
        state: The prepared scene.
        role: The part of the light.

    Returns:
        The set-up, of unit 1.
    """
    variable = None if role == "static" else state.for_role(role).variable
    return FieldSetup.of(state.scene, 1.0, "static" if variable is None else variable.kind, variable)


def with_few_samples(state: State) -> State:
    """Fix the samples of a bake with a time: nothing is trained on them, and timing them costs more than they do.

    Args:
        state: The prepared scene.

    Returns:
        The scene whose bake traces few; ``state`` itself where the counts are fixed, or other fields share them.
    """
    job, request = state.job, state.job.request
    if job.shared or request.steps or request.shards or not request.budget.seconds:
        return state
    # What the sun is given beside its place is among the declarations already.
    few = replace(request, shards=SHARDS, north=None, sky=False, turbidity=None)
    return replace(state, job=replace(job, request=few))


def planned(state: State, role: Role) -> tuple[ProbesPreset, float]:
    """Plan the probes of a bake in their share of its time, and give a role its counts.

    Args:
        state: The prepared scene.
        role: The part of the light.

    Returns:
        Settings of the probes, and their distance, metres.
    """
    job, setups = state.job, {own: setup_of(state, own) for own in state.roles}
    preset, setup = PRESETS[job.request.preset], setups[role]
    spacing = job.options.spacing or default_spacing(state.scene.core, preset.along)
    variables = {own: made.variable for own, made in setups.items()}
    wanted = {own: 1 if v is None else preset.states_of(v) for own, v in variables.items()}
    geometry = partial(weights_of, setup, preset)
    plan = probe_plan(job, state.scene, preset, spacing, variables, wanted, geometry, ALONE_SHARE)
    return plan.applied(preset, role), plan.spacing


FIELD = ProbesField("probes", PRESETS, ProbesFit)
