"""The field ``probes``: a surface field whose lattice and light are solved before its network is trained."""

from __future__ import annotations

from collections.abc import Callable

from lightwell.core.work import WorkPart
from lightwell.fields.base import FieldSetup, Learner
from lightwell.fields.probes.fit import PRESETS, ProbesFit, solved
from lightwell.fields.probes.options import ProbesOptions
from lightwell.fields.probes.rebake import RebakeState, rebaked
from lightwell.fields.protocol import Fit, Job, Role, State
from lightwell.fields.surface.field import SurfaceField
from lightwell.fields.surface.training import SurfaceSamples


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
        """Trace the samples of the light's network; an incremental bake needs none.

        Args:
            state: The prepared scene.
            role: The part of the light to sample.

        Returns:
            The samples; None for an incremental bake.
        """
        return None if isinstance(state, RebakeState) else super().sample(state, role)

    def fit(self, state: State, role: Role, samples: SurfaceSamples | None, part: WorkPart | None = None) -> Fit:
        """Solve the probes and train the light's network, or solve again the probes that a change affects.

        Args:
            state: The prepared scene.
            role: The part of the light that the samples hold.
            samples: Samples from ``sample``.
            part: Part of the bake that stores plan and checkpoints; None: the field chooses it.

        Returns:
            The finished fit.
        """
        return rebaked(state, role) if isinstance(state, RebakeState) else super().fit(state, role, samples, part)

    def starter(self, state: State, role: Role) -> Callable[[FieldSetup, int], Learner]:
        """Return a function that solves the probes' light and makes an untrained network of the light.

        Args:
            state: The prepared scene.
            role: The part of the light to learn.

        Returns:
            Function of set-up and seed.
        """
        name, spacing = state.job.request.preset, state.job.options.spacing

        def start(setup: FieldSetup, seed: int) -> ProbesFit:
            return self.start(setup, name, seed, spacing)

        return start

    def start(self, setup: FieldSetup, preset: str, seed: int, spacing: float | None = None) -> ProbesFit:
        """Solve the probes' light and make an untrained network of the light.

        Args:
            setup: Set-up of the scene, made by ``FieldSetup.of``.
            preset: Name of a preset.
            seed: Seed of sampler and weights.
            spacing: Distance of neighbouring probes, metres; None: an eighth of the scene's extent.

        Returns:
            The learner.
        """
        made = PRESETS[preset]
        return ProbesFit(setup, made, seed, solved(setup, made, seed, spacing), name=preset)


FIELD = ProbesField("probes", PRESETS, ProbesFit)
