"""What a field is: a strategy that prepares a scene, takes samples, fits, and lowers what it has learned to a graph.

    state   = field.prepare(job)              atlas, lattice, the light that moves; cheap checks come first
    samples = field.sample(state, role)       path-traced
    fit     = field.fit(state, role, samples)
    lowered = fit.lower()                     what ships

A bake calls these four for each role of the state, scores what ships and writes it; it knows nothing else of a field.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from lightwell.core.progress import Progress
from lightwell.core.work import Work
from lightwell.fields.request import Request
from lightwell.graph import Graph
from lightwell.graph.pictures import Fallback, Picture
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.samples import Query, SurfacePoints

Role = Literal["indirect", "static"]


@dataclass(frozen=True)
class Job:
    """A scene to learn, what is asked, and the means."""

    scene: Scene
    request: Request
    options: Any
    """Instance of the field's ``Options``."""
    work: Work
    """Where work is kept until the bake is written."""
    progress: Progress
    shared: bool = False
    """Whether other fields learn from the same samples: none then depend on the fit, half of the budget traces them,
    and a training that turns out dearer than planned is cut off."""


@dataclass
class State:
    """A prepared scene. Fields derive from it what they keep between their stages."""

    job: Job
    scene: Scene
    """What is traced and scored; a field may have put a light into it."""
    variable: Variable | None
    """What may move; None: nothing."""
    roles: tuple[Role, ...]
    """What is learned, in this order; the first is what the report's headline figures are of."""
    warnings: list[str] = field(default_factory=list)
    """Notes of the field, for the report."""

    @property
    def shipped(self) -> Scene:
        """The scene as it is written: with the second texture coordinates of an atlas, for example."""
        return self.scene

    def finished(self, fits: Mapping[Role, Fit]) -> ReBake | None:
        """What is written instead of a report where only a part was baked again; None: a report."""
        return None


@dataclass(frozen=True)
class Shown:
    """How a bake is shown first."""

    light: np.ndarray
    """[3] place of the light, metres, or direction to the sun."""
    intensity: np.ndarray
    """[3] candela or lux, by colour."""


@dataclass(frozen=True)
class ExtraFile:
    """A file beside the asset."""

    name: str
    media_type: str
    write: Callable[[Path], None]
    """Writes it, whole or not at all, to a path."""


@dataclass(frozen=True)
class ReBake:
    """What an incremental bake says of itself, instead of a report."""

    shown: Shown
    facts: dict[str, Any]
    """Content of ``rebake.json``."""
    lines: list[str]
    """The same in words."""


@dataclass(frozen=True)
class Lowered:
    """What ships of one fit."""

    graph: Graph
    """What every runtime evaluates; its output ``radiance`` is divided by the reflectance."""
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    """Buffers of the graph that are stored as pictures."""
    fallback: Fallback | None = None
    """An ordinary light map for viewers that know no more."""
    name: str = ""
    """Of the field in the asset; empty: its role."""


@dataclass(frozen=True)
class Traced:
    """What the samples of a fit cost."""

    paths: int = 0
    """Light paths."""
    dropped: int = 0
    """... of which were NaN or infinite and left out."""
    samples: int = 0
    """Training samples."""
    rate: float = 0.0
    """Light paths per second as measured without finding surface points; 0: not measured."""


@dataclass(frozen=True)
class Training:
    """How a fit was trained."""

    seconds: float = 0.0
    """Wall time, what is made of the samples before the first step included."""
    steps: int = 0
    curve: list[tuple[float, float]] = field(default_factory=list)
    """(seconds of training, validation error)."""
    cut: bool = False
    """Whether the time ran out before the planned steps."""


class Fit(Protocol):
    """A finished fit of one role."""

    unit: float
    """Radiance unit S: targets were divided by it."""
    traced: Traced
    plan: dict[str, Any]
    """Counts that the budget bought; JSON values."""
    training: Training
    facts: dict[str, Any]
    """What the representation tells of itself for the report; JSON values, NumPy numbers included."""

    def query(self, points: SurfacePoints, light: np.ndarray) -> Query:
        """Give the graph's inputs at N surface points under a light [3] or [N, 3]."""

    def lower(self) -> Lowered:
        """Give what ships, rounded to the types that are stored."""

    note: str
    """One line about ``files`` for the terminal, known once they were asked for; or nothing."""

    def files(self, glb: Path, shown: Shown, keep: bool) -> list[ExtraFile]:
        """List the files that lie beside the asset ``glb``; ``keep``: also what an incremental bake starts from."""


class Field(Protocol):
    """A learned representation. ``lightwell.fields.registry`` finds it by name, also in other distributions."""

    name: str
    Options: type
    """Dataclass of the options that only this field has; see ``lightwell.core.options``."""
    presets: Mapping[str, Any]
    """Settings by name, the default first."""
    shares: str
    """Fields with the same word here learn from the same samples when they are compared."""

    def prepare(self, job: Job) -> State:
        """Check what is asked, find what may move, and make what samples need. ``ValueError`` for mistakes."""

    def sample(self, state: State, role: Role) -> Any:
        """Trace the samples of a role, or read those that an interrupted bake has left."""

    def fit(self, state: State, role: Role, samples: Any, folder: Path | None = None) -> Fit:
        """Learn from samples that ``sample`` gave, here or in another field that shares them.

        ``folder``: where checkpoints lie where several fields work in one bake; None: the field's own choice.
        """
