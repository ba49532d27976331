"""A scene with its atlas, samples of its light, and the finished light map."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.core.store import Store
from lightwell.core.work import WorkPart
from lightwell.fields.lightmap.fit import DEFAULT, PRESETS, LightmapFit, LightmapPreset
from lightwell.fields.lightmap.fitting import atlas_facts, fallback, texel_facts
from lightwell.fields.lightmap.lamp_shares import LampTexels, LampTracer
from lightwell.fields.lightmap.trace import AtlasIrradiance
from lightwell.fields.lightmap.views import ViewSamples
from lightwell.fields.protocol import ExtraFile, Lowered, Role, Shown, State, Traced, Training
from lightwell.scenes.atlas import Atlas, charted
from lightwell.scenes.scene import Scene
from lightwell.transport.lightmap_query import LightmapQuery, query_of_lightmap
from lightwell.transport.samples import SurfacePoints

# Paths per sample of radiance towards views.
EYE_PATHS = 8
# Paths per second that the reference's budget assumes until the scene's rate is measured.
RATE = 3e5


@dataclass
class LightmapState(State):
    """A scene with its atlas."""

    preset: LightmapPreset = PRESETS["default"]
    atlas: Atlas = field(init=False)
    paths: int = 0
    """Paths per texel."""
    gathers: int = 0
    """Paths per texel that end at known light; 0: all paths are full."""
    eyes: int = 0
    """Number of samples of radiance towards views."""
    rate: float = RATE
    """Paths per second."""
    round: int = 0
    """Of an error budget: each has twice the paths, radiance samples and steps of the last."""
    facts: dict[str, Any] = field(default_factory=lambda: {"textures": {}, "atlas": {}})

    keep: Callable[[FittedLightmap, Store], None] = lambda fitted, store: None
    """Stores what an incremental bake starts from."""
    tracer: LampTracer | None = None
    """Traces the groups of lamps that have switches."""

    @property
    def part(self) -> WorkPart:
        """Part of the bake that stores the results of this round."""
        counts: dict[str, Any] = {"size": self.atlas.size, "paths": self.paths, "eyes": self.eyes, "round": self.round}
        if self.lamps:
            counts["lamps"] = [[group.name, *group.emitters] for group in self.lamps]
        if self.gathers:
            counts["gathers"] = self.gathers
        if self.preset.codec != DEFAULT.codec:
            counts["codec"] = f"{self.preset.base} {self.preset.codec}"
        return self.job.work.part(field="lightmap", **counts)

    @property
    def size(self) -> int:
        """Edge of the atlas that viewers read; that of the fallback's light may be smaller."""
        return self.job.options.size or max(self.preset.size, self.atlas.size)

    @property
    def shipped(self) -> Scene:
        """The scene with the atlas's coordinates; its lights are in the light map."""
        return replace(charted(self.scene, self.atlas), lights=[])


@dataclass(frozen=True)
class StillSamples:
    """Samples of the light of the scene's own emitters: irradiance at texels and radiance towards views."""

    chart: AtlasIrradiance
    eyes: ViewSamples
    lamps: LampTexels | None = None
    """Light of each group of lamps, where they have switches."""


@dataclass
class FittedLightmap:
    """See ``lightwell.fields.protocol.Fit``."""

    state: LightmapState
    role: Role
    map: LightmapFit
    paths: int
    seconds: float
    chart: AtlasIrradiance | None = None
    note: str = ""
    lamp_facts: Mapping[str, Any] = field(default_factory=dict)
    """Errors of groups of lamps."""

    @property
    def unit(self) -> float:
        """Radiance unit S."""
        return self.map.unit

    @property
    def traced(self) -> Traced:
        """Cost of the samples."""
        return Traced(self.paths, 0, self.state.eyes, self.state.rate, self.state.paths if self.chart else EYE_PATHS)

    @property
    def training(self) -> Training:
        """Summary of the training."""
        return Training(self.seconds, self.map.history[-1][0] if self.map.history else 0)

    @property
    def plan(self) -> dict[str, Any]:
        """Counts that the budget bought."""
        texel_paths = self.state.paths if self.chart else 0
        return {
            "size": self.state.size,
            "texel_paths": texel_paths,
            "texel_gathers": self.state.gathers if self.chart else 0,
            "eye_samples": self.state.eyes,
            "steps": self.training.steps,
        }

    @property
    def facts(self) -> dict[str, Any]:
        """Facts about the atlas and the stored pictures for the report, of all roles so far."""
        self.state.facts["textures"][self.role] = {name: len(p.data) for name, p in self.map.pictures.items()}
        self.state.facts["atlas"] |= atlas_facts(self.state.atlas) | (texel_facts(self.chart) if self.chart else {})
        return self.state.facts | dict(self.lamp_facts)

    def query(self, points: SurfacePoints, light: np.ndarray) -> LightmapQuery:
        """Return the inputs of the graph at surface points.

        Args:
            points: N surface points.
            light: [3] or [N, 3] position of the light in metres, or direction towards the sun.

        Returns:
            N queries.
        """
        return query_of_lightmap(self.state.scene, self.state.atlas, points, light)

    def lower(self) -> Lowered:
        """Return the shading graph that is written, with its pictures and an ordinary light map for other viewers.

        Returns:
            The graph and what is stored beside it.
        """
        ordinary = fallback(self.chart) if self.chart else None
        name = f"lightmap {self.role}"
        return Lowered(self.map.lower(), self.map.pictures, ordinary, name, self.map.frame)

    def files(self, glb: Path, shown: Shown, store: Store | None = None) -> list[ExtraFile]:
        """List the files beside the asset: a light map has none.

        Args:
            glb: Path of the asset.
            shown: The light under which the bake is shown first.
            store: Where to keep what an incremental bake starts from; None: it is not kept.

        Returns:
            An empty list.
        """
        # An incremental bake can start from light that stands still alone.
        if store is not None and self.chart is not None and len(self.state.roles) == 1 and not self.state.lamps:
            self.state.keep(self, store)
        return []
