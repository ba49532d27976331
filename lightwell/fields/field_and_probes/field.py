"""The field ``factored+probes``: one bake learns the light of surfaces as ``factored`` does, and probes in their air.

The walls and all that stands still show the field; what a page adds, a character or a thing that is carried about, is
lit by the probes. Both are in one file. A fifth of the time (``plan.PROBES_SHARE``) is for the probes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.core.store import Store
from lightwell.core.work import WorkPart
from lightwell.fields.field_and_probes.light import ProbeLight, RoleProbes
from lightwell.fields.field_and_probes.options import FieldAndProbesOptions
from lightwell.fields.protocol import ExtraFile, Job, Lowered, Role, Shown, State, Traced, Training
from lightwell.fields.surface.factored import PRESETS, FactoredField, FactoredFit
from lightwell.fields.surface.field import SurfaceFit
from lightwell.fields.surface.lamp_samples import LampTraining
from lightwell.fields.surface.training import SurfaceSamples
from lightwell.files import write_atomically
from lightwell.graph import Graph
from lightwell.probes.code import StateMix
from lightwell.probes.file import encode_volume
from lightwell.scenes.variables import Variable, has_sky
from lightwell.transport.samples import Query, SurfacePoints


@dataclass
class FieldAndProbesFit:
    """A fit of one role and its probes; see ``lightwell.fields.protocol.Fit``."""

    role: Role
    surface: SurfaceFit
    probes: RoleProbes
    graph: Graph
    """Shading graph of the probes."""
    variable: Variable | None = None
    """The declared light of the role."""
    note: str = ""

    @property
    def unit(self) -> float:
        """Radiance unit S."""
        return self.surface.unit

    @property
    def traced(self) -> Traced:
        """Cost of the samples of the field."""
        return self.surface.traced

    @property
    def plan(self) -> dict[str, Any]:
        """Counts that the budget bought."""
        return self.surface.plan | {"probes": int(self.probes.volume.alive.sum())}

    @property
    def training(self) -> Training:
        """How the field was trained."""
        return self.surface.training

    @property
    def facts(self) -> dict[str, Any]:
        """Facts about the field and, under a name of their own, about the probes."""
        return self.surface.facts | {f"{self.role}_probes": self.probes.facts | {"bytes": self.graph.nbytes}}

    def query(self, points: SurfacePoints, light: np.ndarray) -> Query:
        """Return the inputs of the graph at surface points.

        Args:
            points: N surface points.
            light: [3] or [N, 3] position of the light in metres, or direction towards the sun.

        Returns:
            N queries.
        """
        return self.surface.query(points, light)

    def lower(self) -> Lowered:
        """Return the shading graphs of the field and of the probes.

        Returns:
            What is written.
        """
        return replace(self.surface.lower(), probes=self.graph)

    def files(self, glb: Path, shown: Shown, store: Store | None = None) -> list[ExtraFile]:
        """List the files beside the asset: the probes under the light that is shown first, for game engines.

        Args:
            glb: Path of the asset.
            shown: The light under which the bake is shown first.
            store: Not used: an incremental bake starts from a bake of one field.

        Returns:
            The files; none where a node moves, because such a file has one pose.
        """
        told, error = self.probes.facts, self.probes.facts["error_in_the_air"]
        known = "" if error is None else f", error in the air {error:.1%}"
        self.note = f"{told['count']} probes {told['spacing']:.2g} m apart{known}; they follow {told['follows']}"
        if self.probes.mixing is not None and "pose" in self.probes.mixing.inputs:
            return []
        lit = self._shown(shown)
        volume = self.probes.volume.lit(lit)
        mean = float(np.abs(lit[volume.alive, 0]).mean()) if volume.alive.any() else 1.0
        data, _ = encode_volume(volume, self.probes.coding, unit=max(mean, 1e-20))
        name = f"probes-{self.role}.lwp"
        return [ExtraFile(name, "application/octet-stream", partial(_write, data))]

    def _shown(self, shown: Shown) -> np.ndarray:
        """[P + F, 9, 3] light of the probes as it is shown first."""
        probes = self.probes
        if probes.mixing is None:
            return probes.basis[..., 0]
        if isinstance(probes.mixing, StateMix):
            return probes.basis @ probes.mixing.mix.sum(axis=(0, 1))
        factors = probes.mixing.factors(np.reshape(shown.light, (1, 3)))[0]
        # A day is learned for light divided by its level.
        level = float(self.variable.level(shown.light)) if has_sky(self.variable) else 1.0
        return (probes.basis @ factors) * np.broadcast_to(level * shown.intensity, 3)


def _write(data: bytes, path: Path) -> None:
    write_atomically(path, data)


class FieldAndProbes(FactoredField):
    """See ``lightwell.fields.protocol.Field``."""

    def prepare(self, job: Job) -> State:
        """Find what varies; the probes follow whatever the field does.

        Args:
            job: Scene and settings.

        Returns:
            The prepared scene.

        Raises:
            ValueError: Fields are compared.
        """
        if job.shared:
            raise ValueError("compare: 'factored+probes' is two fields in one file; compare factored and probes")
        return super().prepare(job)

    def sample(self, state: State, role: Role) -> SurfaceSamples | LampTraining:
        """Solve the probes of all roles before the first samples are planned, then trace the samples of a role.

        Args:
            state: The prepared scene.
            role: The part of the light to sample.

        Returns:
            The samples.
        """
        if role == state.roles[0]:
            ProbeLight(state).solve()
        return super().sample(state, role)

    def fit(
        self, state: State, role: Role, samples: SurfaceSamples | LampTraining, part: WorkPart | None = None
    ) -> FieldAndProbesFit:
        """Fit the field of a role after its probes.

        Args:
            state: The prepared scene.
            role: The part of the light that the samples hold.
            samples: Samples from ``sample``.
            part: Part of the bake that stores plan and checkpoints; None: that of the role.

        Returns:
            The finished fit.
        """
        probes = ProbeLight(state).fitted(role, samples.unit)
        surface = super().fit(state, role, samples, part)
        return FieldAndProbesFit(role, surface, probes, probes.lower(), state.for_role(role).variable)


FIELD = FieldAndProbes("factored+probes", PRESETS, FactoredFit, FieldAndProbesOptions)
