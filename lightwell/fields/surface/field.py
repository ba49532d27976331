"""Base of all surface fields: sampling and training, independent of the representation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.core.store import Store
from lightwell.core.sun_path import DAY_EXAMPLE
from lightwell.core.work import WorkPart
from lightwell.fields.base import FieldSetup, Learner
from lightwell.fields.no_options import NoOptions
from lightwell.fields.protocol import ExtraFile, Job, Lowered, Role, Shown, State, Traced, Training
from lightwell.fields.surface.edit_state import EditState
from lightwell.fields.surface.edits import (
    EditedScene,
    FirstState,
    edited_learner,
    edited_samples,
    keep_edited,
    traced_facts,
)
from lightwell.fields.surface.network_fit import NetworkFit
from lightwell.fields.surface.roles import light_declared
from lightwell.fields.surface.training import SurfaceSamples, SurfaceTraining, surface_samples
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import declare
from lightwell.transport.queries import make_query
from lightwell.transport.samples import Query, SurfacePoints


@dataclass
class SurfaceFit:
    """A trained surface field of one role; see ``lightwell.fields.protocol.Fit``."""

    scene: Scene
    learner: Learner
    unit: float
    traced: Traced
    plan: dict[str, Any]
    training: Training
    keep: Callable[[Store, Shown], None] | None = None
    """Stores what an incremental bake starts from; None: there is none."""

    @property
    def facts(self) -> dict[str, Any]:
        """Facts about the learner for the report."""
        return getattr(self.learner, "facts", None) or {}

    @property
    def note(self) -> str:
        """One line about the files beside the asset."""
        return getattr(self.learner, "note", "")

    def query(self, points: SurfacePoints, light: np.ndarray) -> Query:
        """Return the inputs of the graph at surface points.

        Args:
            points: N surface points.
            light: [3] or [N, 3] position of the light in metres, or direction towards the sun.

        Returns:
            N queries.
        """
        return make_query(self.scene, points, light)

    def lower(self) -> Lowered:
        """Return the shading graph that is written.

        Returns:
            The graph.
        """
        return Lowered(self.learner.lower())

    def files(self, glb: Path, shown: Shown, store: Store | None = None) -> list[ExtraFile]:
        """List the files beside the asset: those of the learner, if it has any.

        Args:
            glb: Path of the asset.
            shown: The light under which the bake is shown first.
            store: Where to keep what an incremental bake starts from; None: it is not kept.

        Returns:
            The files.
        """
        if store is not None and self.keep is not None:
            self.keep(store, shown)
        more = getattr(self.learner, "files", None)
        return more(glb, shown, store) if more else []


class SurfaceField:
    """Base of fields that are fitted to samples at surface points; see ``lightwell.fields.protocol.Field``."""

    shares = "surface"
    learns_sky = True
    """Whether the direct light of a sky is in its samples."""
    learns_turning = True
    """Whether the light of an environment map that turns is in its samples."""

    def __init__(
        self,
        name: str,
        presets: Mapping[str, Any],
        learner: Callable[[FieldSetup, Any, int], Learner],
        options: type = NoOptions,
    ) -> None:
        """Declare a field.

        Args:
            name: What ``--field`` calls it.
            presets: Settings by name, the default first.
            learner: Makes an untrained learner from (setup, settings, seed).
            options: Dataclass of the field's own options.
        """
        self.name, self.presets, self._learner, self.Options = name, dict(presets), learner, options

    def start(self, setup: FieldSetup, preset: str, seed: int) -> Learner:
        """Make an untrained learner.

        Args:
            setup: Bounds, light and radiance unit of the scene.
            preset: Name of a preset.
            seed: Seed of the weights.

        Returns:
            The learner.
        """
        return self._learner(setup, self.presets[preset], seed)

    def prepare(self, job: Job) -> State:
        """Find the variable light; a range without free air is refused.

        A scene that has light of its own, and no air for a light that nobody has declared, such as a floor alone, keeps
        its own.

        Args:
            job: Scene and settings.

        Returns:
            The prepared scene.

        Raises:
            ValueError: A declaration is wrong, or there is no free air for the light; one line.
        """
        if getattr(job.options, "rebake", None):
            return EditedScene.of(job, self.name)
        request = job.request
        variable = declare(request.vary, job.scene)
        static = request.static and job.scene.has_static_light and not job.shared
        try:
            sample_lights(job.scene, variable, 1, request.seed)
        except ValueError:
            if light_declared(job):
                raise
            if not static:
                raise ValueError(
                    f"vary: scene '{job.scene.name}' has neither air for a light that moves nor light of its own; "
                    f"declare one beside it, --vary light.position=box(x0,y0,z0,x1,y1,z1), or --vary {DAY_EXAMPLE}"
                ) from None
            told = f"scene '{job.scene.name}' has no air for a light that moves: only its own light is baked"
            return State(job, job.scene, None, ("static",), [told])
        return State(job, job.scene, variable, ("indirect", "static") if static else ("indirect",))

    def sample(self, state: State, role: Role) -> SurfaceSamples | EditState:
        """Trace area-uniform samples, or read those of an interrupted bake.

        Args:
            state: The prepared scene.
            role: The part of the light to sample.

        Returns:
            The samples.
        """
        return (
            edited_samples(state, role)
            if isinstance(state, EditedScene)
            else surface_samples(state.for_role(role), role)
        )

    def fit(
        self, state: State, role: Role, samples: SurfaceSamples | EditState, part: WorkPart | None = None
    ) -> SurfaceFit:
        """Train, trace more samples where the error is large, and continue training.

        Args:
            state: The prepared scene.
            role: The part of the light that the samples hold.
            samples: Samples from ``sample``.
            part: Part of the bake that stores plan and checkpoints; None: that of the role.

        Returns:
            The finished fit.
        """
        if isinstance(samples, EditState):
            return self._edited(state, role, samples)
        training = SurfaceTraining(state.for_role(role), role, samples, self.starter(state, role), part)
        learner, traced = training.run(), training.traced
        keep = None
        still = state.variable is not None and not (state.scene.movers or state.more)
        if isinstance(learner, NetworkFit) and still and not state.job.shared:
            shards = samples.plan.shards
            keep = FirstState(state, role, self.name, samples.training, learner, shards, traced.paths)
        summary = training.summary(learner)
        return SurfaceFit(state.scene, learner, samples.unit, traced, training.plan, summary, keep)

    def _edited(self, state: EditedScene, role: Role, samples: EditState) -> SurfaceFit:
        """The fit of an incremental bake."""
        make = self.maker(samples.facts["preset"], role, len(state.before))
        learner, training = edited_learner(state, role, samples, make)
        keep, traced = partial(keep_edited, state, role, samples, learner), traced_facts(samples, state.touched[role])
        return SurfaceFit(state.scene, learner, learner.setup.unit, traced, {}, training, keep)

    def starter(self, state: State, role: Role) -> Callable[[FieldSetup, int], Learner]:
        """Return a function that makes an untrained learner.

        Args:
            state: The prepared scene.
            role: The part of the light to learn.

        Returns:
            Function of set-up and seed.
        """
        return self.maker(state.job.request.preset, role, len(state.roles))

    def maker(self, preset: str, role: Role, roles: int) -> Callable[[FieldSetup, int], Learner]:
        """Return a function that makes an untrained learner of a preset.

        Args:
            preset: Name of the preset.
            role: The part of the light to learn.
            roles: Roles of the bake, ≥ 1; fields that share the bytes of an asset are smaller.

        Returns:
            Function of set-up and seed.
        """
        return lambda setup, seed: self.start(setup, preset, seed)
