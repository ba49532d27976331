"""The strategy of light probes: a surface field whose lattice and light are solved for before its network trains."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

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

    def prepare(self, job: Job) -> State:
        """Find the light that moves, or the probes that an edit starts from."""
        return RebakeState.of(job) if job.options.rebake else super().prepare(job)

    def sample(self, state: State, role: Role) -> SurfaceSamples | None:
        """Trace the samples of the light's network; an edit needs none."""
        return None if isinstance(state, RebakeState) else super().sample(state, role)

    def fit(self, state: State, role: Role, samples: SurfaceSamples | None, folder: Path | None = None) -> Fit:
        """Solve and train, or solve again what an edit touches."""
        return rebaked(state, role) if isinstance(state, RebakeState) else super().fit(state, role, samples, folder)

    def starter(self, state: State) -> Callable[[FieldSetup, int], Learner]:
        """Return what solves the probes' light and makes an untrained network of the light's place."""
        name, spacing = state.job.request.preset, state.job.options.spacing

        def start(setup: FieldSetup, seed: int) -> ProbesFit:
            return self.start(setup, name, seed, spacing)

        return start

    def start(self, setup: FieldSetup, preset: str, seed: int, spacing: float | None = None) -> ProbesFit:
        """Make an untrained learner with a named preset; ``spacing`` of the probes in metres, None: by the scene."""
        made = PRESETS[preset]
        return ProbesFit(setup, made, seed, solved(setup, made, seed, spacing), name=preset)


FIELD = ProbesField("probes", PRESETS, ProbesFit)
